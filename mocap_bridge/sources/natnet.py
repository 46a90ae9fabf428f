"""NatNet as a source: the sockets around a receiver."""

import select
import socket
from collections.abc import Callable

from mocap_bridge.natnet.wire import MAX_DATAGRAM_BYTES
from mocap_bridge.sources.base import SourceFrame, SourceStatus
from mocap_bridge.sources.natnet_receiver import NatNetReceiver
from mocap_bridge.sources.tape import Entry

RECEIVE_BUFFER_BYTES = 1 << 21
MAX_BATCH = 256
"""Datagrams taken at once, so that a flood cannot starve the rest of the loop."""

MAX_FOREIGN = 16
BROADCAST = "255.255.255.255"
IP_MULTICAST_ALL = 49
"""Linux: whether a socket hears groups that others have joined, on whatever interface."""
SEND_NS = 10_000_000
"""While frames come, what is due is sent this often."""
FRAMELESS_NS = 1_500_000_000
"""So long after a unicast server has answered without a frame, its data port is listened to as well."""


def data_socket(group: str, port: int, local_address: str) -> socket.socket:
    """A socket that hears the multicast group on the interface with ``local_address``, and on no other.

    Motive's "multicast as broadcast" has the group 255.255.255.255.
    """
    sock = _socket((group, port), shared=True)
    if group != BROADCAST:
        try:
            membership = socket.inet_aton(group) + socket.inet_aton(local_address)
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            sock.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)
        except OSError:
            sock.close()
            raise
    return sock


def _socket(address: tuple[str, int], shared: bool = False) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, shared)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        sock.bind(address)
    except OSError:
        sock.close()
        raise
    sock.setblocking(False)
    return sock


class NatNetSource:
    """The UDP shell. Unicast frames arrive on the command socket, multicast ones on a second.

    Some servers unicast to the data port instead. It is opened only where nothing has come otherwise,
    since a server on the same host may need it for itself.
    """

    def __init__(
        self, receiver: NatNetReceiver, server: str, command_port: int, local_address: str, group: str, data_port: int
    ) -> None:
        self.receiver = receiver
        self.tap: Callable[[Entry], None] | None = None
        """Sees every datagram sent and received, for recording."""
        self.frames_received = 0
        self.foreign_senders: set[str] = set()
        """Addresses that sent something but are not the server."""
        self._server = (socket.gethostbyname(server), command_port)
        self._local_address = local_address
        self._frameless_since_ns: int | None = None
        self._sent_ns = 0
        self._command = _socket((local_address, 0))
        self._sockets = [self._command]
        self._may_listen_more = True
        try:
            if group:
                self._sockets.append(data_socket(group, data_port, local_address))
                self._may_listen_more = False
        except OSError:
            self.close()
            raise
        self._buffer = bytearray(MAX_DATAGRAM_BYTES)
        self._view = memoryview(self._buffer)
        self._ready: list[socket.socket] | None = None
        self._by_fd: dict[int, socket.socket] = {}
        self._poll = select.poll()
        for sock in self._sockets:
            self._watch(sock)

    def _watch(self, sock: socket.socket) -> None:
        self._by_fd[sock.fileno()] = sock
        self._poll.register(sock, select.POLLIN)

    def wait(self, timeout_s: float) -> None:
        """Until a datagram is there, at most ``timeout_s``."""
        ready = self._poll.poll(max(timeout_s, 0.0) * 1000.0)
        self._ready = [self._by_fd[fd] for fd, _ in ready]

    def send(self, now_ns: int) -> None:
        """Send what the client has due; a server that is not there is silence, not an error."""
        for datagram in self.receiver.outbox(now_ns):
            if self.tap:
                self.tap(Entry("sent", now_ns, datagram))
            try:
                self._command.sendto(datagram, self._server)
            except OSError:
                self.receiver.counters["send_failed"] += 1

    def receive(self, now_ns: int) -> list[SourceFrame]:
        """The next datagram of every socket that :meth:`wait` saw readable; without a wait everything that is there."""
        frames: list[SourceFrame] = []
        if self._ready is None:
            for sock in self._sockets:
                for _ in range(MAX_BATCH):
                    if not self._take(sock, now_ns, frames):
                        break
        else:
            for sock in self._ready:
                self._take(sock, now_ns, frames)
        self._ready = None
        self.frames_received += len(frames)
        if not frames or now_ns - self._sent_ns >= SEND_NS:
            self._sent_ns = now_ns
            self.send(now_ns)
        if self._may_listen_more:
            self._listen_more(now_ns)
        return frames

    def _take(self, sock: socket.socket, now_ns: int, frames: list[SourceFrame]) -> bool:
        """Receive one datagram; False where there is none."""
        try:
            size, sender = sock.recvfrom_into(self._buffer)
        except BlockingIOError:
            return False
        except OSError:
            self.receiver.counters["port_unreachable"] += 1
            return False
        if sender[0] != self._server[0]:
            self.receiver.counters["foreign_sender"] += 1
            if len(self.foreign_senders) < MAX_FOREIGN:
                self.foreign_senders.add(sender[0])
            return True
        datagram = bytes(self._view[:size])
        if self.tap:
            self.tap(Entry("received", now_ns, datagram))
        frame = self.receiver.receive(datagram, now_ns)
        if frame is not None:
            frames.append(frame)
        return True

    def _listen_more(self, now_ns: int) -> None:
        client = self.receiver.client
        if self.frames_received:
            self._may_listen_more = False
        elif client.info is None or client.state == "refused":
            self._frameless_since_ns = None
        elif self._frameless_since_ns is None:
            self._frameless_since_ns = now_ns
        elif now_ns - self._frameless_since_ns > FRAMELESS_NS:
            self._may_listen_more = False
            try:
                sock = _socket((self._local_address, client.info.data_port))
            except OSError:
                self.receiver.counters["data_port_taken"] += 1
                return
            self._sockets.append(sock)
            self._watch(sock)

    def status(self) -> SourceStatus:
        return self.receiver.status()

    def close(self) -> None:
        for sock in self._sockets:
            sock.close()
