"""The emulated server on real sockets: command port, data port, loopback or any interface."""

import socket
import time
from collections.abc import Callable, Iterable

from mocap_bridge.mock.bodies import BodyState
from mocap_bridge.mock.server import EmulatedServer, Outgoing
from mocap_bridge.mock.tape_server import TapeServer
from mocap_bridge.natnet.wire import MAX_DATAGRAM_BYTES


class ServerShell:
    """Two UDP sockets around an :class:`EmulatedServer` or a :class:`TapeServer`, for an event loop of one's own.

    :param address: local address of both sockets.
    :param multicast_interface: address of the interface that multicast leaves from, if not ``address``.
    :raises OSError: a port is taken or the address is not this machine's.
    """

    def __init__(self, server: EmulatedServer | TapeServer, address: str, multicast_interface: str = "") -> None:
        mocap = server.settings.mocap
        self.server = server
        self.damage: Callable[[bytes], bytes] | None = None
        """What a faulty network does to every datagram that leaves."""
        self._command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if mocap.multicast_group:
                leaving = socket.inet_aton(multicast_interface or address)
                self._data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                self._data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, leaving)
                self._data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
                self._data.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            self._command.bind((address, mocap.command_port))
            self._data.bind((address, mocap.data_port))
        except OSError:
            self.close()
            raise
        self._command.setblocking(False)
        self._data.setblocking(False)

    def fds(self) -> list[int]:
        """File descriptors to watch for reading."""
        return [self._command.fileno(), self._data.fileno()]

    def on_readable(self, fd: int, now_ns: int) -> None:
        """Answer what has come."""
        sock = self._command if fd == self._command.fileno() else self._data
        while True:
            try:
                datagram, sender = sock.recvfrom(MAX_DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except OSError:
                self.server.counters["port_unreachable"] += 1
                return
            self._send(self.server.receive(datagram, sender, time.monotonic_ns()))

    @property
    def next_due_ns(self) -> int:
        """When :meth:`stream` has something to send again."""
        return self.server.next_due_ns

    def stream(self, now_ns: int, poses: Iterable[BodyState], clock: Callable[[], int] | None = None) -> None:
        """Send what is due; ``poses`` hold at ``now_ns``, a datagram is stamped by ``clock`` as it leaves."""
        self._send(self.server.stream(now_ns, poses, clock))

    def _send(self, datagrams: list[Outgoing]) -> None:
        for datagram in datagrams:
            sock = self._data if datagram.from_data_port else self._command
            data = self.damage(datagram.data) if self.damage else datagram.data
            try:
                sock.sendto(data, datagram.to)
            except OSError:
                self.server.counters["send_failed"] += 1

    def close(self) -> None:
        self._command.close()
        self._data.close()
