"""A NatNet server that says again, byte for byte, what a recorded one has said. Pure.

Frames leave as far apart as they came; clock, model list and answers to commands are the recorded
ones. What differs is where it is: ports, multicast group and receivers are this server's.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from mocap_bridge.mock.bodies import BodyState, ServerSettings
from mocap_bridge.mock.server import CLIENT_TIMEOUT_NS, DEFAULT_GROUP, Address, Outgoing
from mocap_bridge.natnet import handshake, version
from mocap_bridge.natnet.clock import ArrivalClock
from mocap_bridge.natnet.frame import decode_frame
from mocap_bridge.natnet.version import Layout, Version
from mocap_bridge.natnet.wire import Malformed, MessageId, Packet, open_packet, open_request, packet
from mocap_bridge.sources.tape import Entry

LEAD_NS = 1_000_000_000
"""Clients have this long to connect before the first frame."""
RESTART_NS = 1_000_000_000
"""The recorded server's clock fell by so much: it had restarted."""


class Recorded(NamedTuple):
    """What a tape says of its server."""

    info: handshake.ServerInfo
    layout: Layout
    """Of the frames, which an older client may have asked for."""
    models: bytes
    """First model list, as it came."""
    answers: dict[str, bytes]
    """Answer to each command."""


def survey(tape: Iterable[Entry]) -> Recorded:
    """What a tape says of its server.

    :raises ValueError: no server info, or of a version without a known layout.
    """
    info: handshake.ServerInfo | None = None
    asked = handshake.ANY_VERSION
    models, answers, pending = b"", dict[str, bytes](), ""
    for entry in tape:
        try:
            opened = open_packet(entry.data)
            if entry.way == "sent":
                if opened.id == MessageId.CONNECT:
                    asked = handshake.decode_connect(opened).bitstream
                elif opened.id == MessageId.REQUEST:
                    pending = handshake.decode_text(opened)
            elif opened.id == MessageId.SERVERINFO:
                info = info or handshake.decode_server_info(opened)
            elif opened.id == MessageId.MODELDEF:
                models = models or entry.data
            elif opened.id in (MessageId.RESPONSE, MessageId.UNRECOGNIZED) and pending:
                answers.setdefault(pending, entry.data)
                pending = ""
        except Malformed:
            continue
    if info is None:
        raise ValueError("no server has introduced itself in this recording")
    streamed = min(Version(*asked), info.natnet) if asked.major and not info.multicast else info.natnet
    return Recorded(info, version.layout(streamed), models, answers)


class TapeServer:
    """Plays a tape once; :attr:`ended` tells that its last frame has left.

    :param tape: gives the entries from the start, each time it is called.
    :raises ValueError: as :func:`survey`.
    """

    def __init__(self, settings: ServerSettings, tape: Callable[[], Iterator[Entry]]) -> None:
        self.settings = settings
        self.counters: Counter[str] = Counter()
        self.next_due_ns = 0
        self.ended = False
        self._recorded = survey(tape())
        self._models = self._recorded.models
        self._tape = iter(tape())
        self._next = self._advance()
        self._shift_ns: int | None = None
        self._clock = ArrivalClock()
        self._offset_ns, self._newest_ns = 0, 0
        self._clients: dict[Address, int] = {}

    @property
    def info(self) -> handshake.ServerInfo:
        """What the server says of itself."""
        mocap, recorded = self.settings.mocap, self._recorded
        group = mocap.multicast_group
        return recorded.info._replace(
            natnet=recorded.layout.version,
            data_port=mocap.data_port,
            multicast=bool(group),
            group=group or DEFAULT_GROUP,
        )

    def receive(self, datagram: bytes, sender: Address, now_ns: int) -> list[Outgoing]:
        """A datagram to the command port, and the answers to it; a malformed one is counted."""
        try:
            answer = self._answer(open_request(datagram), sender, now_ns)
        except Malformed:
            self.counters["malformed"] += 1
            return []
        return [] if answer is None else [Outgoing(False, sender, answer)]

    def _answer(self, opened: Packet, sender: Address, now_ns: int) -> bytes | None:
        match opened.id:
            case MessageId.CONNECT | MessageId.DISCOVERY:
                self._clients[sender] = now_ns
                return handshake.encode_server_info(self.info)
            case MessageId.KEEPALIVE:
                if sender in self._clients:
                    self._clients[sender] = now_ns
            case MessageId.DISCONNECT:
                self._clients.pop(sender, None)
            case MessageId.REQUEST_MODELDEF:
                return self._models or None
            case MessageId.ECHO_REQUEST:
                return handshake.encode_echo_response(handshake.decode_echo_request(opened), self.ticks(now_ns))
            case MessageId.REQUEST:
                return self._recorded.answers.get(handshake.decode_text(opened), packet(MessageId.UNRECOGNIZED))
            case _:
                return packet(MessageId.UNRECOGNIZED)
        return None

    def ticks(self, now_ns: int) -> int:
        """The recorded server's clock, as if its fastest frame had taken no time."""
        return max(now_ns - self._offset_ns, 0) * self._recorded.info.tick_hz // 1_000_000_000

    def stream(
        self, now_ns: int, poses: Iterable[BodyState] = (), clock: Callable[[], int] | None = None
    ) -> list[Outgoing]:
        """Recorded frames due by ``now_ns``; the other arguments are those of a server with bodies of its own."""
        if self._shift_ns is None and self._next is not None:
            self._shift_ns = now_ns + LEAD_NS - self._next.stamp_ns
            self._keep_time(self._next, now_ns + LEAD_NS)
        out: list[Outgoing] = []
        while self._next is not None and self._shift_ns is not None:
            due_ns = self._next.stamp_ns + self._shift_ns
            if due_ns > now_ns:
                self.next_due_ns = due_ns
                return out
            self._keep_time(self._next, due_ns)
            out += [Outgoing(True, address, self._next.data) for address in self._receivers(now_ns)]
            self._next = self._advance()
        self.ended = True
        self.next_due_ns = now_ns + LEAD_NS
        return out

    def _receivers(self, now_ns: int) -> list[Address]:
        mocap = self.settings.mocap
        if mocap.multicast_group:
            return [(mocap.multicast_group, mocap.data_port)]
        for address, heard_ns in list(self._clients.items()):
            if now_ns - heard_ns > CLIENT_TIMEOUT_NS:
                del self._clients[address]
                self.counters["client_timeout"] += 1
        return list(self._clients)

    def _advance(self) -> Entry | None:
        """The next frame, the model lists before it taken note of."""
        for entry in self._tape:
            if entry.way == "received" and entry.data[:2] == b"\x05\x00":
                self._models = entry.data
            elif entry.way == "received" and entry.data[:2] == b"\x07\x00":
                return entry
        return None

    def _keep_time(self, entry: Entry, due_ns: int) -> None:
        tick_hz = self._recorded.info.tick_hz
        try:
            ticks = decode_frame(entry.data, self._recorded.layout).transmit_ticks
        except Malformed:
            self.counters["malformed_frames"] += 1
            return
        if not tick_hz or not ticks:
            return
        server_ns = ticks * 1_000_000_000 // tick_hz
        if server_ns < self._newest_ns - RESTART_NS:
            self._clock = ArrivalClock()
            self._newest_ns = 0
        if server_ns > self._newest_ns:
            self._newest_ns = server_ns
            self._offset_ns = self._clock.local_ns(server_ns, due_ns) - server_ns
