"""The bridge's Zenoh session, and where it is for the bridge to begin it, the router beside it."""

import os
import signal
import socket

from contract import network
from contract.allocator import share_arenas
from contract.exposure import host_of
from mocap_bridge.router import Router

os.environ.setdefault("ZENOH_RUNTIME", network.RUNTIME)

import zenoh


def is_local(endpoint: str) -> bool:
    """Whether the host of an endpoint such as ``tcp/192.168.7.1:7447`` is this machine."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host_of(endpoint), 0, type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind(address)
    except OSError:
        return False
    return True


class Joined:
    """A client session of the network, and the router's process if that is a child of this one."""

    def __init__(self, session: zenoh.Session, router: Router | None = None) -> None:
        self.session = session
        self.router = router

    def __enter__(self) -> "Joined":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def tend(self) -> None:
        """Mend a router that has ended (:meth:`mocap_bridge.router.Router.tend`).

        :raises mocap_bridge.router.RouterError: it cannot be mended.
        """
        if self.router is not None:
            self.router.tend()

    def close(self) -> None:
        """The session first, so that its last words still go out."""
        try:
            self.session.close()  # type: ignore[no-untyped-call]
        finally:
            if self.router is not None:
                self.router.close()


def open_session(endpoint: str, identity: network.Identity | None = None) -> Joined:
    """A client session of the router at ``endpoint``, which begins first if there are no keys and it is this host's.

    :raises mocap_bridge.router.RouterError: the address is taken.
    :raises zenoh.ZError: no router answers.
    """
    router = Router(endpoint) if identity is None and is_local(endpoint) else None
    config = zenoh.Config()
    for key, value in network.client_config(endpoint, identity=identity):
        config.insert_json5(key, value)
    share_arenas()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    try:
        return Joined(zenoh.open(config), router)
    except BaseException:
        if router is not None:
            router.close()
        raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def publisher(session: zenoh.Session, key: str, channel: str) -> zenoh.Publisher:
    """A publisher with the quality of service of a channel of :data:`contract.network.QOS`."""
    qos = network.QOS[channel]
    return session.declare_publisher(
        key,
        priority=getattr(zenoh.Priority, qos.priority),
        congestion_control=getattr(zenoh.CongestionControl, qos.congestion),
        reliability=getattr(zenoh.Reliability, qos.reliability),
        express=qos.express,
    )
