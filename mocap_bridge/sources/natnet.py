"""NatNet as a source: the pure receiver, and the sockets around it."""

import select
import socket
from collections import Counter
from collections.abc import Mapping

from mocap_bridge.natnet.client import Client
from mocap_bridge.natnet.frame import EDIT_MODE, Body
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import MAX_DATAGRAM_BYTES
from mocap_bridge.sequence import Sequence
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus

RECEIVE_BUFFER_BYTES = 1 << 21
MAX_BATCH = 256
"""Datagrams taken at once, so that a flood cannot starve the rest of the loop."""


class NatNetReceiver:
    """Client, frame order and names of one server: datagrams in, frames by name out. Pure."""

    def __init__(self, name: str, wanted: Version, multicast: bool) -> None:
        self.client = Client(name, wanted, multicast)
        self.session = 0
        self.counters: Counter[str] = Counter()
        self._sequence = Sequence()
        self._dropped = 0
        self._restarts = 0

    def receive(self, datagram: bytes, now_ns: int) -> SourceFrame | None:
        """One datagram from the server; a frame comes back only if it is newer than all before."""
        stamped = self.client.receive(datagram, now_ns)
        if self.client.restarts != self._restarts:
            self._begin_session()
        if stamped is None:
            return None
        frame = stamped.frame
        order = self._sequence.judge(frame.number, frame.timestamp_s, now_ns)
        if order != "new":
            self.counters[order] += 1
            if order == "restart":
                self.client.restart()
                self._begin_session()
            return None
        names = self.client.models
        try:
            bodies: Mapping[str, Body] = {names[body[0]]: body for body in frame.bodies}
        except KeyError:
            bodies = self._known(frame.bodies, now_ns)
        return SourceFrame(
            self.session,
            frame.number,
            stamped.exposure_ns,
            stamped.transmit_ns,
            now_ns,
            stamped.clock_error_ns,
            bodies,
            bool(frame.params & EDIT_MODE),
        )

    def _known(self, bodies: list[Body], now_ns: int) -> Mapping[str, Body]:
        names, known_ids = self.client.models, self.client.known_ids
        if any(body[0] not in known_ids for body in bodies):
            self.counters["unknown_id"] += 1
            self.client.request_models(now_ns)
        return {names[body[0]]: body for body in bodies if body[0] in names}

    def _begin_session(self) -> None:
        self._restarts = self.client.restarts
        self._dropped += self._sequence.dropped
        self._sequence = Sequence()
        self.session += 1

    def outbox(self, now_ns: int) -> list[bytes]:
        """Datagrams due now, for the server's command port."""
        return self.client.outbox(now_ns)

    def status(self) -> SourceStatus:
        """State of the connection, with the words for what is wrong."""
        client = self.client
        problem = client.problem
        if client.state == "streaming" and abs(client.units_to_millimetres - 1000.0) > 1.0:
            problem = (
                f"the server's unit is {client.units_to_millimetres:g} mm, not 1000 mm: "
                "set metres in the streaming settings"
            )
        elif client.state == "streaming" and client.counters["unsynchronised"] and not client.clock.ready:
            problem = "the server answers no clock echo: stamps are taken from arrivals"
        return SourceStatus(
            name=client.info.name[:64] if client.info else "natnet",
            phase=client.state if client.state != "streaming" else STEADY,
            problem=problem,
            nominal_rate_hz=client.nominal_rate_hz,
            frames_dropped=self._dropped + self._sequence.dropped,
            malformed=client.counters["malformed"],
            counters=client.counters + self.counters,
            names=frozenset(client.models.values()),
            duplicate_names=client.duplicate_names,
        )


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
                    continue
                frame = self.receiver.receive(datagram, now_ns)
                if frame is not None:
                    frames.append(frame)
        self.send(now_ns)
        return frames

    def status(self) -> SourceStatus:
        return self.receiver.status()

    def close(self) -> None:
        for sock in self._sockets:
            sock.close()
