"""The bridge's Zenoh session: without keys the router of the network when its address is this host's."""

import socket

import zenoh

from contract import joining, network
from contract.exposure import host_of


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
    session: zenoh.Session = joining.open_session(settings)
    return session


def publisher(session: zenoh.Session, key: str, channel: str) -> zenoh.Publisher:
    """A publisher with the quality of service of a channel of :data:`contract.network.QOS`."""
    made: zenoh.Publisher = joining.publisher(session, key, channel)
    return made
