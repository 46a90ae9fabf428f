"""This machine's network interfaces and who answers on them, as the kernel tells."""

import fcntl
import ipaddress
import socket
import struct
from pathlib import Path
from typing import NamedTuple

from mocap_bridge.evidence import Neighbour

_SIOCGIFADDR, _SIOCGIFNETMASK = 0x8915, 0x891B
_COMPLETE = 0x02


class Interface(NamedTuple):
    """An interface that has an IPv4 address; a second address of the same interface is not told."""

    name: str
    network: ipaddress.IPv4Interface

    @property
    def address(self) -> str:
        return str(self.network.ip)


def interfaces() -> list[Interface]:
    """Every interface with an address."""
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            try:
                address, mask = (_ask(probe, request, name) for request in (_SIOCGIFADDR, _SIOCGIFNETMASK))
            except OSError:
                continue
            found.append(Interface(name, ipaddress.IPv4Interface(f"{address}/{mask}")))
    return found


def _ask(probe: socket.socket, request: int, name: str) -> str:
    answer = fcntl.ioctl(probe.fileno(), request, struct.pack("256s", name.encode()[:15]))
    return socket.inet_ntoa(answer[20:24])


def route_address(server: str, port: int) -> str:
    """This machine's address on the way to the server; empty if there is no way."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((server, port))
        except OSError:
            return ""
        return str(probe.getsockname()[0])


def in_a_local_subnet(server: str) -> bool:
    """Whether any interface is in the server's subnet; True for a name that does not resolve."""
    try:
        address = ipaddress.IPv4Address(socket.gethostbyname(server))
    except OSError:
        return True
    return any(address in interface.network.network for interface in interfaces())


def neighbour(server: str, table: str | None = None) -> Neighbour:
    """Whether a host of a local subnet has answered an ARP request; "unknown" if none was sent.

    :param table: text of ``/proc/net/arp``, read where not given.
    """
    try:
        address = socket.gethostbyname(server)
        lines = (Path("/proc/net/arp").read_text() if table is None else table).splitlines()
    except OSError:
        return "unknown"
    flags = [int(words[2], 16) for words in map(str.split, lines[1:]) if words[:1] == [address]]
    if not flags:
        return "unknown"
    return "present" if any(flag & _COMPLETE for flag in flags) else "absent"
