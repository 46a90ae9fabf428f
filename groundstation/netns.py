"""A small network in one computer: members in network namespaces of their own, a switch between them. Needs root.

Every member has one interface ``eth0``; its other end is a port of the switch's namespace, called as the member. A
wired member's port is plugged into a bridge, a radio member's is left to :mod:`groundstation.relay`, whose uplink
is plugged in there. Leaving the ``with`` block removes everything, processes excepted.
"""

import array
import contextlib
import fcntl
import os
import socket
import struct
import subprocess
from collections.abc import Sequence

NETWORK = "10.77.0"
SIOCETHTOOL = 0x8946
OFFLOADS = (0x17, 0x1F, 0x24, 0x2C)
"""ETHTOOL_STXCSUM, STSO, SGSO, SGRO: with them a frame read raw lacks its checksum, or is many at once."""
NEAR, FAR = "ahdc-near", "ahdc-far"
"""Names of a new cable's ends until they are where they belong."""
UPLINK = "uplink"


class NamespaceError(RuntimeError):
    """The kernel refused; the text is what ``ip`` said."""


class Namespaces:
    """:param wired: members on the bridge; :param radio: members behind the relay."""

    def __init__(self, wired: Sequence[str], radio: Sequence[str] = ()) -> None:
        self.wired = tuple(wired)
        self.radio = tuple(radio)
        self._prefix = f"ahdc{os.getpid()}"

    def name(self, member: str) -> str:
        """Its namespace."""
        return f"{self._prefix}-{member}"

    def address(self, member: str) -> str:
        """Its IPv4 address."""
        return f"{NETWORK}.{[*self.wired, *self.radio].index(member) + 1}"

    @property
    def switch(self) -> str:
        """The namespace with everybody's ports."""
        return self.name("switch")

    def inside(self, member: str) -> list[str]:
        """What to put before a command to run it there; ``switch`` is a member, too."""
        return ["ip", "netns", "exec", self.name(member)]

    def __enter__(self) -> "Namespaces":
        try:
            self._build()
        except NamespaceError:
            self.remove()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self.remove()

    def remove(self) -> None:
        """Every namespace, and with it its links."""
        for member in (*self.wired, *self.radio, "switch"):
            subprocess.run(["ip", "netns", "del", self.name(member)], capture_output=True, check=False)

    def plug(self, member: str, on: bool) -> None:
        """Plug a member's cable in or pull it."""
        _ip("-n", self.switch, "link", "set", member, "up" if on else "down")

    def _build(self) -> None:
        _ip("netns", "add", self.switch)
        _ip("-n", self.switch, "link", "add", "hub", "type", "bridge")
        _ip("-n", self.switch, "link", "set", "hub", "up")
        for member in (*self.wired, *self.radio):
            name = self.name(member)
            _ip("netns", "add", name)
            self._cable(member, name, "eth0")
            _ip("-n", name, "addr", "add", f"{self.address(member)}/24", "dev", "eth0")
            _ip("-n", name, "link", "set", "lo", "up")
            _ip("-n", name, "link", "set", "eth0", "up")
            if member in self.wired:
                _ip("-n", self.switch, "link", "set", member, "master", "hub")
            self.plug(member, True)
        if self.radio:
            self._cable(UPLINK, self.switch, "air")
            _ip("-n", self.switch, "link", "set", "air", "master", "hub", "up")
            self.plug(UPLINK, True)

    def _cable(self, port: str, space: str, end: str) -> None:
        """From the switch's ``port`` to the interface ``end`` of a namespace; no work left to its ends."""
        _ip("link", "add", NEAR, "type", "veth", "peer", "name", FAR)
        for name in (NEAR, FAR):
            switch_off(name)
        _ip("link", "set", NEAR, "netns", self.switch, "name", port)
        _ip("link", "set", FAR, "netns", space, "name", end)


def switch_off(interface: str) -> None:
    """Have the kernel finish every frame before it is on this interface; what it cannot switch it has not got."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        for command in OFFLOADS:
            value = array.array("B", struct.pack("II", command, 0))
            with contextlib.suppress(OSError):
                fcntl.ioctl(asker, SIOCETHTOOL, struct.pack("16sP", interface.encode(), value.buffer_info()[0]))


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NamespaceError(f"ip {' '.join(words)}: {done.stderr.strip()}")
