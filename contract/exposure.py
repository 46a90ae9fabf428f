"""Who can reach a link: loopback or beyond, with keys or without, and what the loader refuses."""

import ipaddress
from collections.abc import Iterator, Sequence

from contract.tables import Fault, show

ENCRYPTED = ("quic", "tls")
ROLES = ("router", "station", "operator", "bridge", "external", "mock")
"""Holders of certificates beside the robots (docs/network.md)."""
RESERVED = frozenset({*ROLES, "authority"})
WARNING = "INSECURE LINK: anybody on this network can drive the robots"


def protocol_of(endpoint: str) -> str:
    """``quic`` of ``quic/192.168.7.1:7447``."""
    return endpoint.partition("/")[0]


def host_of(endpoint: str) -> str:
    """``192.168.7.1`` of ``quic/192.168.7.1:7447``; brackets of an IPv6 address are taken off."""
    return endpoint.partition("/")[2].partition("?")[0].rpartition(":")[0].strip("[]")


def is_loopback(endpoint: str) -> bool:
    """Whether nobody but this computer can reach the endpoint. A name other than localhost is not trusted to be."""
    host = host_of(endpoint)
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def exposure(endpoints: Sequence[str], keys: str) -> str:
    """What every screen has to say of these endpoints; empty where there is nothing to say."""
    return "" if keys or all(map(is_loopback, endpoints)) else WARNING


def link_faults(router: str, listen: Sequence[str], keys: str, insecure: bool) -> Iterator[Fault]:
    """What is wrong between the keys of ``[link]``."""
    named = [("link.router", router), *((f"link.listen[{index}]", entry) for index, entry in enumerate(listen))]
    try:
        if ipaddress.ip_address(host_of(router)).is_unspecified:
            text = "no address to connect to; give the router's own address here, this one in link.listen"
            yield Fault("link.router", show(router), text)
    except ValueError:
        pass
    for path, endpoint in named:
        encrypted = protocol_of(endpoint) in ENCRYPTED
        if encrypted and not keys:
            text = 'quic/ and tls/ need certificates: set link.keys = "keys", then ahdc-groundstation keys init'
            yield Fault(path, show(endpoint), text)
        elif keys and not encrypted:
            yield Fault(path, show(endpoint), "link.keys protects quic/ and tls/ alone; write quic/ in place of tcp/")
        elif not keys and not insecure and not is_loopback(endpoint):
            text = (
                "reachable from other computers without certificates; use quic/ with link.keys (docs/network.md), "
                "or accept that anybody on the network can drive the robots with link.insecure = true"
            )
            yield Fault(path, show(endpoint), text)
    if keys and insecure:
        yield Fault("link.insecure", "true", "link.keys is set; remove one of them")
    if listen and protocol_of(router) not in map(protocol_of, listen):
        yield Fault("link.listen", show(list(listen)), f"has no {protocol_of(router)}/ endpoint for link.router")
