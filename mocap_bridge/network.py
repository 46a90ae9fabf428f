"""The bridge's Zenoh session: without keys the router of the network when its address is this host's."""

import os
import signal
import socket

from contract import network
from contract.allocator import share_arenas
from contract.exposure import host_of

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


def open_session(endpoint: str, identity: network.Identity | None = None) -> zenoh.Session:
    """The router session, or a client session of the router at ``endpoint``; with an identity always a client.

    :raises zenoh.ZError: the address is taken, or no router answers.
    """
    if identity is None and is_local(endpoint):
        settings = network.router_config(endpoint)
    else:
        settings = network.client_config(endpoint, identity=identity)
    config = zenoh.Config()
    for key, value in settings:
        config.insert_json5(key, value)
    share_arenas()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    try:
        return zenoh.open(config)
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
