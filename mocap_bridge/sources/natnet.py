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


def data_socket(group: str, port: int, local_address: str) -> socket.socket:
    """A socket that has joined the multicast group on the interface with ``local_address``."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    sock.bind((group, port))
    membership = socket.inet_aton(group) + socket.inet_aton(local_address)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    sock.setblocking(False)
    return sock


class NatNetSource:
    """The UDP shell. Unicast frames arrive on the command socket, multicast ones on a second."""

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
        self._command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sockets = [self._command]
        try:
            self._command.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            self._command.bind((local_address, 0))
            self._command.setblocking(False)
            if group:
                self._sockets.append(data_socket(group, data_port, local_address))
        except OSError:
            self.close()
            raise
        self._poll = select.poll()
        for sock in self._sockets:
            self._poll.register(sock, select.POLLIN)

    def wait(self, timeout_s: float) -> None:
        """Until a datagram is there, at most ``timeout_s``."""
        self._poll.poll(max(timeout_s, 0.0) * 1000.0)

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
        """Every frame that has arrived."""
        frames: list[SourceFrame] = []
        for sock in self._sockets:
            for _ in range(MAX_BATCH):
                try:
                    datagram, sender = sock.recvfrom(MAX_DATAGRAM_BYTES)
                except BlockingIOError:
                    break
                except OSError:
                    self.receiver.counters["port_unreachable"] += 1
                    break
                if sender[0] != self._server[0]:
                    self.receiver.counters["foreign_sender"] += 1
                    if len(self.foreign_senders) < MAX_FOREIGN:
                        self.foreign_senders.add(sender[0])
                    continue
                if self.tap:
                    self.tap(Entry("received", now_ns, datagram))
                frame = self.receiver.receive(datagram, now_ns)
                if frame is not None:
                    frames.append(frame)
        self.frames_received += len(frames)
        self.send(now_ns)
        return frames

    def status(self) -> SourceStatus:
        return self.receiver.status()

    def close(self) -> None:
        for sock in self._sockets:
            sock.close()
