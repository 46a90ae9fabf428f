"""The client's side of a NatNet session as a state machine: datagrams and time in, datagrams out. Pure.

searching -> CONNECT until SERVERINFO -> models -> REQUEST_MODELDEF until MODELDEF -> streaming;
silence leads back to searching, a version without a known layout to refused.
"""

from collections import Counter, deque
from typing import Literal

from mocap_bridge.natnet import handshake, version
from mocap_bridge.natnet.frame import MODELS_CHANGED, decode_frame
from mocap_bridge.natnet.modelnames import ModelNames, names_of, read_models
from mocap_bridge.natnet.stamps import Stamped, Stamper
from mocap_bridge.natnet.version import Layout, Version
from mocap_bridge.natnet.wire import Malformed, MessageId, Packet, open_packet, packet

MILLISECOND = 1_000_000
QUICK_RETRY_NS = 100 * MILLISECOND
QUICK_RETRIES = 20
SLOW_RETRY_NS = 1_000 * MILLISECOND
KEEPALIVE_NS = 1_000 * MILLISECOND
ECHO_NS = 250 * MILLISECOND
FIRST_ECHO_NS = 20 * MILLISECOND
FIRST_ECHOES = 8
MODELS_RETRY_NS = 1_000 * MILLISECOND
COMMAND_PATIENCE_NS = 500 * MILLISECOND
RECONNECT_NS = 1_000 * MILLISECOND
"""Silence after which the client connects again."""
AMBIGUOUS_NS = 2_000 * MILLISECOND
"""A model list in which bodies are not told apart is asked for again this often, until that is put right."""
LAYOUT_DOUBT = 5
"""Frames in a row that do not decode, before other layouts are tried."""

ClientState = Literal["searching", "models", "streaming", "refused"]


class Client:
    """One NatNet session.

    :param wanted: bit stream to ask a unicast server for; its own wins where that is older.
    :param multicast: whether frames come by multicast, which needs no keep-alive.
    """

    def __init__(self, name: str, wanted: Version, multicast: bool) -> None:
        version.layout(wanted)
        self.name = name
        self.wanted = wanted
        self.multicast = multicast
        self.state: ClientState = "searching"
        self.problem = ""
        """Why it is refused, in words; empty otherwise."""
        self.info: handshake.ServerInfo | None = None
        self.layout: Layout = version.layout(wanted)
        self.models = ModelNames()
        self.restarts = 0
        """Raised by one when another server, or a restarted one, has answered."""
        self.nominal_rate_hz = 0.0
        self.units_to_millimetres = 1000.0
        self.counters: Counter[str] = Counter()
        self.last_fault = ""
        self.unanswered = 0
        """Times it has asked to connect since the server last answered."""
        self.stamper = Stamper(0, self.counters)
        self._commands: deque[str] = deque()
        self._command_sent_ns: int | None = None
        self._connect_due_ns = 0
        self._models_due_ns = 0
        self._models_asked_ns = 0
        self._keepalive_due_ns = 0
        self._echo_due_ns = 0
        self._echoes = 0
        self._heard_ns = 0
        self._bad_frames = 0

    # --- out -----------------------------------------------------------------------------------

    def outbox(self, now_ns: int) -> list[bytes]:
        """Datagrams due now, for the server's command port."""
        out: list[bytes] = []
        if self.state == "streaming" and now_ns - self._heard_ns > RECONNECT_NS:
            self.counters["silence"] += 1
            self._reconnect(now_ns)
        if self.state in ("searching", "refused"):
            self._connect(now_ns, out)
        if self.state in ("searching", "refused"):
            return out
        if (self.state == "models" or self._models_due_ns) and now_ns >= self._models_due_ns:
            out.append(packet(MessageId.REQUEST_MODELDEF))
            self._models_asked_ns = now_ns
            self._models_due_ns = now_ns + MODELS_RETRY_NS
        if not self.multicast and now_ns >= self._keepalive_due_ns:
            out.append(handshake.encode_keepalive(self.name, self.layout.version))
            self._keepalive_due_ns = now_ns + KEEPALIVE_NS
        if self.info and self.info.tick_hz and now_ns >= self._echo_due_ns:
            out.append(handshake.encode_echo_request(now_ns))
            self._echoes += 1
            self._echo_due_ns = now_ns + (FIRST_ECHO_NS if self._echoes < FIRST_ECHOES else ECHO_NS)
        self._command(now_ns, out)
        return out

    def _reconnect(self, now_ns: int) -> None:
        """The same server, as far as one knows: keep its clock and its names."""
        if self.state != "refused":
            self.state = "searching"
            self.unanswered = 0
            self._connect_due_ns = now_ns

    def _connect(self, now_ns: int, out: list[bytes]) -> None:
        if now_ns < self._connect_due_ns:
            return
        asked = handshake.ANY_VERSION if self.multicast else self.wanted
        out.append(handshake.encode_connect(handshake.Connect(self.name, self.wanted, False, asked)))
        self.unanswered += 1
        quick = self.unanswered < QUICK_RETRIES and self.state == "searching"
        self._connect_due_ns = now_ns + (QUICK_RETRY_NS if quick else SLOW_RETRY_NS)

    def _command(self, now_ns: int, out: list[bytes]) -> None:
        if self._command_sent_ns is not None and now_ns - self._command_sent_ns > COMMAND_PATIENCE_NS:
            self.counters["command_unanswered"] += 1
            self._commands.popleft()
            self._command_sent_ns = None
        if self._commands and self._command_sent_ns is None:
            out.append(handshake.encode_command(self._commands[0]))
            self._command_sent_ns = now_ns

    def next_due_ns(self, now_ns: int) -> int:
        """When :meth:`outbox` has something again, at the latest."""
        if self.state in ("searching", "refused"):
            return self._connect_due_ns
        due = [self._heard_ns + RECONNECT_NS + 1 if self.state == "streaming" else self._models_due_ns]
        if self._models_due_ns:
            due.append(self._models_due_ns)
        if not self.multicast:
            due.append(self._keepalive_due_ns)
        if self.info and self.info.tick_hz:
            due.append(self._echo_due_ns)
        if self._command_sent_ns is not None:
            due.append(self._command_sent_ns + COMMAND_PATIENCE_NS + 1)
        return min(due)

    # --- in ------------------------------------------------------------------------------------

    def receive(self, datagram: bytes, now_ns: int) -> Stamped | None:
        """A datagram from the server; a frame comes back stamped, everything else is absorbed.

        Malformed ones are counted under ``malformed`` and named in :attr:`last_fault`.
        """
        try:
            if datagram[:2] == b"\x07\x00":
                return self._frame(datagram, now_ns)
            self._message(open_packet(datagram), now_ns)
        except Malformed as fault:
            self.counters["malformed"] += 1
            self.last_fault = str(fault)
        return None

    def _frame(self, datagram: bytes, now_ns: int) -> Stamped | None:
        if self.info is None or self.state == "refused":
            self.counters["early_frame"] += 1
            return None
        try:
            frame = decode_frame(datagram, self.layout)
        except Malformed:
            self._bad_frames += 1
            if self._bad_frames >= LAYOUT_DOUBT:
                self._guess_layout(datagram)
            raise
        self._bad_frames = 0
        self._heard_ns = now_ns
        if frame.params & MODELS_CHANGED:
            self.request_models(now_ns)
        return self.stamper.stamp(frame, now_ns)

    def _message(self, opened: Packet, now_ns: int) -> None:
        match opened.id:
            case MessageId.SERVERINFO:
                self._server_info(handshake.decode_server_info(opened), now_ns)
            case MessageId.MODELDEF:
                self._model_list(opened, now_ns)
            case MessageId.ECHO_RESPONSE:
                sent_ns, ticks = handshake.decode_echo_response(opened)
                if 0 <= now_ns - sent_ns <= 1_000_000_000 and self.info is not None:
                    self.stamper.clock.echo(sent_ns, ticks, now_ns)
                else:
                    self.counters["stray_echo"] += 1
            case MessageId.RESPONSE:
                self._answer(opened)
            case MessageId.UNRECOGNIZED:
                self.counters["command_unrecognized"] += 1
                self._next_command()
            case MessageId.MESSAGESTRING:
                self.counters["message_string"] += 1
            case MessageId.DISCONNECT | MessageId.DISCONNECT_BY_TIMEOUT:
                self.counters["disconnected"] += 1
                self._reconnect(now_ns)
            case _:
                self.counters["unknown_packet"] += 1

    def _server_info(self, info: handshake.ServerInfo, now_ns: int) -> None:
        if info.natnet > version.NEWEST or info.natnet < version.OLDEST:
            self.info = info
            self.state = "refused"
            self.problem = f"{info.name or 'server'}: {version.UnsupportedVersion(info.natnet)}"
            self.unanswered = QUICK_RETRIES
            return
        known = self.info
        changed = known is not None and known != info
        if self.state in ("models", "streaming") and not changed:
            return
        if changed:
            self.restart()
        self.info = info
        self.problem = ""
        effective = info.natnet if self.multicast else min(self.wanted, info.natnet)
        self.layout = version.layout(effective)
        self._bad_frames = 0
        if known is None or changed:
            self.stamper = Stamper(info.tick_hz, self.counters)
            self._echoes = 0
        self.unanswered = 0
        self.stamper.connected_ns = self._heard_ns = now_ns
        self.state = "models"
        self._models_due_ns = self._keepalive_due_ns = self._echo_due_ns = now_ns
        self._commands = deque(["FrameRate", "UnitsToMillimeters"])
        self._command_sent_ns = None

    def _model_list(self, opened: Packet, now_ns: int) -> None:
        bodies, layout = read_models(opened, self.layout)
        if layout is not self.layout:
            self.counters["other_model_layout"] += 1
        self.models = names_of(bodies)
        self._models_due_ns = 0
        if self.models.duplicate_names or self.models.duplicate_ids:
            self._models_due_ns = now_ns + AMBIGUOUS_NS
        if self.state == "models":
            self.state = "streaming"

    def _answer(self, opened: Packet) -> None:
        if not self._commands or self._command_sent_ns is None:
            self.counters["stray_answer"] += 1
            return
        value = handshake.decode_float_answer(opened)
        if self._commands[0] == "FrameRate" and 1.0 <= value <= 2000.0:
            self.nominal_rate_hz = value
        elif self._commands[0] == "UnitsToMillimeters" and 0.0 < value <= 1e6:
            self.units_to_millimetres = value
        self._next_command()

    def _next_command(self) -> None:
        if self._commands and self._command_sent_ns is not None:
            self._commands.popleft()
            self._command_sent_ns = None

    def _guess_layout(self, datagram: bytes) -> None:
        """The server may send another bit stream than it says: take the first layout that decodes."""
        for candidate in ((4, 1), (3, 1), (2, 11), (2, 9), (2, 7), (2, 6)):
            layout = version.layout(Version(*candidate))
            try:
                decode_frame(datagram, layout)
            except Malformed:
                continue
            self.counters["other_bitstream"] += 1
            self.layout = layout
            self._bad_frames = 0
            return

    # --- from the bridge -----------------------------------------------------------------------

    def request_models(self, now_ns: int) -> None:
        """Ask for the model list again, at most once a second."""
        due_ns = max(now_ns, self._models_asked_ns + MODELS_RETRY_NS)
        if self.state == "streaming" and not 0 < self._models_due_ns <= due_ns:
            self._models_due_ns = due_ns
            self.counters["models_refetched"] += 1

    def restart(self) -> None:
        """The server has restarted: forget its clock and connect anew at once."""
        self.restarts += 1
        self.info = None
        self.state = "searching"
        self.unanswered = 0
        self._connect_due_ns = 0
        self.stamper = Stamper(0, self.counters)
