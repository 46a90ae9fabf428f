"""An emulated NatNet server. Pure: datagrams, poses and time in, datagrams out.

Real servers' habits that clients rely on: answers leave from the command port, frames from the data
port; unicast frames go to the port a client sent CONNECT from; a bit stream older than the server's
own, and only in unicast, is honoured; an unknown command is answered with UNRECOGNIZED.
"""

import heapq
import random
from collections import Counter
from collections.abc import Callable, Iterable
from typing import NamedTuple

from mocap_bridge.mock.bodies import MARKERS, BodyState, Camera, ServerSettings
from mocap_bridge.mock.script import Fault, Script
from mocap_bridge.natnet import handshake, modeldef, version
from mocap_bridge.natnet.frame import EDIT_MODE, MODELS_CHANGED
from mocap_bridge.natnet.frame_encode import Content, encode_frame
from mocap_bridge.natnet.version import Layout
from mocap_bridge.natnet.wire import Malformed, MessageId, Packet, open_request, packet

Address = tuple[str, int]
CLIENT_TIMEOUT_NS = 10_000_000_000
DEFAULT_GROUP = "239.255.42.99"
RESTART_TICKS = 7_000_000
"""The clock's jump with a scripted restart."""

FLAG_S = 0.1
"""So long after a change of the model list frames say so."""


class Outgoing(NamedTuple):
    """A datagram to send; frames leave from the data port, answers from the command port."""

    from_data_port: bool
    to: Address
    data: bytes


class _Client(NamedTuple):
    layout: Layout
    heard_ns: int


class EmulatedServer:
    """One server and the bodies of its model list, ids from 1 in the order given."""

    def __init__(self, settings: ServerSettings, bodies: Iterable[str]) -> None:
        self.settings = settings
        self.version = version.parse(settings.mocap.version)
        self.counters: Counter[str] = Counter()
        self.next_due_ns = 0
        """When :meth:`stream` has something to send again; 0 until its first call."""
        self._layout = version.layout(self.version)
        self._camera = Camera(settings, bodies)
        self._clients: dict[Address, _Client] = {}
        self._random = random.Random(settings.seed + 1)
        self._start_ns: int | None = None
        self._born_ns = 0
        self._number = 0
        self._frame_due_ns = 0
        self._restarts = 0
        self._down = False
        self._queue: list[tuple[int, int, Outgoing]] = []
        self._queued = 0
        self._held: list[Outgoing] = []
        self._overtaken: list[Outgoing] = []

    def inject(self, fault: Fault) -> None:
        """Add a fault to the script."""
        self.follow(Script((*self.settings.script.faults, fault)))

    def follow(self, script: Script) -> None:
        """Another script from now on."""
        self.settings = self.settings._replace(script=script)
        self._camera.follow(script)

    # --- time ----------------------------------------------------------------------------------

    def elapsed_s(self, now_ns: int) -> float:
        """Time of the script: since the first frame."""
        return 0.0 if self._start_ns is None else (now_ns - self._start_ns) * 1e-9

    def ticks(self, now_ns: int) -> int:
        """The server's clock."""
        elapsed_s, drift_ns = self.elapsed_s(now_ns), 0.0
        for fault in self.settings.script.faults:
            if fault.kind == "clock_drift" and elapsed_s > fault.start_s:
                drift_ns += fault.number(0.0) * 1e3 * min(elapsed_s - fault.start_s, fault.duration_s)
        base = self.settings.boot_ticks + RESTART_TICKS * self._restarts
        return base + (now_ns + round(drift_ns)) * self.settings.tick_hz // 1_000_000_000

    def _rate_hz(self, elapsed_s: float) -> float:
        fault = self.settings.script.active("rate_change", elapsed_s)
        return fault.number(0.0) if fault and fault.number(0.0) > 0.0 else self.settings.mocap.frame_rate_hz

    # --- commands ------------------------------------------------------------------------------

    def receive(self, datagram: bytes, sender: Address, now_ns: int) -> list[Outgoing]:
        """A datagram to the command port, and the answers to it; a malformed one is counted."""
        if self._down or self.settings.script.active("deaf", self.elapsed_s(now_ns)):
            self.counters["unheard"] += 1
            return []
        try:
            answer = self._answer(open_request(datagram), sender, now_ns)
        except Malformed:
            self.counters["malformed"] += 1
            return []
        return [] if answer is None else [Outgoing(False, sender, answer)]

    def _answer(self, opened: Packet, sender: Address, now_ns: int) -> bytes | None:
        match opened.id:
            case MessageId.CONNECT | MessageId.DISCOVERY:
                asked = handshake.decode_connect(opened).bitstream
                chosen = min(max(asked, version.OLDEST), self.version) if asked.major else self.version
                self._clients[sender] = _Client(version.layout(chosen), now_ns)
                return handshake.encode_server_info(self.info)
            case MessageId.KEEPALIVE:
                if client := self._clients.get(sender):
                    self._clients[sender] = client._replace(heard_ns=now_ns)
            case MessageId.DISCONNECT:
                self._clients.pop(sender, None)
            case MessageId.REQUEST_MODELDEF:
                return self.models(self._layout_of(sender), self.elapsed_s(now_ns))
            case MessageId.ECHO_REQUEST if not self.settings.script.active("no_echo", self.elapsed_s(now_ns)):
                return handshake.encode_echo_response(handshake.decode_echo_request(opened), self.ticks(now_ns))
            case MessageId.REQUEST:
                return self._command(handshake.decode_text(opened), sender, now_ns)
            case MessageId.ECHO_REQUEST:
                self.counters["echo_ignored"] += 1
            case _:
                self.counters["unrecognized"] += 1
                return packet(MessageId.UNRECOGNIZED)
        return None

    @property
    def info(self) -> handshake.ServerInfo:
        """What the server says of itself."""
        mocap, own = self.settings.mocap, self.version
        group = mocap.multicast_group
        app = (max(own.major - 1, 0), own.minor, 0, 0)
        return handshake.ServerInfo(
            self.settings.name, app, own, self.settings.tick_hz, mocap.data_port, bool(group), group or DEFAULT_GROUP
        )

    def _layout_of(self, sender: Address) -> Layout:
        client = self._clients.get(sender)
        return client.layout if client and not self.settings.mocap.multicast_group else self._layout

    def _command(self, text: str, sender: Address, now_ns: int) -> bytes:
        name, _, rest = text.partition(",")
        elapsed_s = self.elapsed_s(now_ns)
        if name == "FrameRate":
            return handshake.encode_float_answer(self._rate_hz(elapsed_s))
        if name == "UnitsToMillimeters":
            return handshake.encode_float_answer(
                1.0 if self.settings.script.active("millimetres", elapsed_s) else 1000.0
            )
        if name == "SubscribeToData":
            return handshake.encode_integer_answer(0)
        if text == "Bitstream":
            return handshake.encode_text_answer(f"Bitstream,{self._layout_of(sender).version}")
        if name == "Bitstream" and not self.settings.mocap.multicast_group:
            try:
                layout = version.layout(min(version.parse(rest.strip()), self.version))
            except version.UnsupportedVersion:
                return handshake.encode_integer_answer(1)
            if client := self._clients.get(sender):
                self._clients[sender] = client._replace(layout=layout, heard_ns=now_ns)
            return handshake.encode_integer_answer(0)
        self.counters["unrecognized"] += 1
        return packet(MessageId.UNRECOGNIZED)

    def models(self, layout: Layout, elapsed_s: float = 0.0) -> bytes:
        """The MODELDEF datagram."""
        script, models = self.settings.script, []
        for name, own in self._camera.ids.items():
            if script.active("wrong_models", elapsed_s, name):
                continue
            models.append(modeldef.BodyModel(name, self._camera.id(name, elapsed_s), markers=MARKERS))
            if script.active("duplicate_name", elapsed_s, name):
                models.append(modeldef.BodyModel(name, own + 10_000, markers=MARKERS))
        return modeldef.encode_models(models, layout)

    # --- frames --------------------------------------------------------------------------------

    def stream(self, now_ns: int, poses: Iterable[BodyState], clock: Callable[[], int] | None = None) -> list[Outgoing]:
        """What is due at ``now_ns``: at most one new frame, of ``poses`` as they are at ``now_ns``.

        ``clock`` tells the time, ns, once the frame is all but encoded: its transmit stamp, if later than
        the configured latency makes it.

        Due times are multiples of the period from the first call, so the rate does not drift; a call
        that comes more than a period late leaves out the frames it missed, and their numbers.
        """
        if self._start_ns is None:
            self._start_ns = self._born_ns = self._frame_due_ns = now_ns
        elapsed_s = self.elapsed_s(now_ns)
        self._restart(now_ns, elapsed_s)
        if now_ns >= self._frame_due_ns:
            period_ns = round(1e9 / self._rate_hz(elapsed_s))
            missed = (now_ns - self._frame_due_ns) // period_ns
            self.counters["frames_missed"] += missed
            self._number += missed
            if not self._down:
                self._send(self._frames(now_ns, elapsed_s, poses, clock), now_ns, elapsed_s)
            self._number += 1
            self._frame_due_ns += (missed + 1) * period_ns
        out: list[Outgoing] = []
        while self._queue and self._queue[0][0] <= now_ns:
            out.append(heapq.heappop(self._queue)[2])
        self.next_due_ns = min(self._frame_due_ns, self._queue[0][0]) if self._queue else self._frame_due_ns
        return out

    def _restart(self, now_ns: int, elapsed_s: float) -> None:
        down = self.settings.script.active("restart", elapsed_s) is not None
        if down and not self._down:
            self._clients.clear()
            self._queue.clear()
        elif self._down and not down:
            self._restarts += 1
            self._number = 0
            self._born_ns = now_ns
        self._down = down

    def _receivers(self, now_ns: int) -> list[tuple[Address, Layout]]:
        mocap = self.settings.mocap
        if mocap.multicast_group:
            return [((mocap.multicast_group, mocap.data_port), self._layout)]
        for address, client in list(self._clients.items()):
            if now_ns - client.heard_ns > CLIENT_TIMEOUT_NS:
                del self._clients[address]
                self.counters["client_timeout"] += 1
        return [(address, client.layout) for address, client in self._clients.items()]

    def _frames(
        self, now_ns: int, elapsed_s: float, poses: Iterable[BodyState], clock: Callable[[], int] | None
    ) -> list[Outgoing]:
        receivers = self._receivers(now_ns)
        if not receivers:
            return []
        script = self.settings.script
        sight = self._camera.see(poses, elapsed_s)
        changed = any(
            0.0 <= elapsed_s - edge_s < FLAG_S
            for f in script.faults
            if f.kind in ("id_change", "wrong_models", "duplicate_name")
            for edge_s in (f.start_s, f.start_s + f.duration_s)
        )
        latency_ns = self.settings.latency_ns
        content = Content(
            self._number,
            bodies=sight.bodies,
            body_markers={body[0]: points for body, (_, points) in zip(sight.bodies, sight.marker_sets, strict=False)},
            marker_sets=sight.marker_sets,
            labeled=sight.markers,
            timestamp_s=(now_ns - self._born_ns) * 1e-9,
            exposure_ticks=self.ticks(now_ns),
            received_ticks=self.ticks(now_ns + latency_ns // 2),
            precision=(now_ns // 1_000_000_000 & 0xFFFFFFFF, now_ns % 1_000_000_000),
            params=(MODELS_CHANGED if changed else 0) | (EDIT_MODE if script.active("edit_mode", elapsed_s) else 0),
            latency_s=latency_ns * 1e-9,
        )

        def transmit_ticks() -> int:
            return self.ticks(max(now_ns + latency_ns, clock() if clock is not None else 0))

        encoded = {
            layout: encode_frame(content, layout, transmit_ticks) for layout in {layout for _, layout in receivers}
        }
        return [Outgoing(True, address, encoded[layout]) for address, layout in receivers]

    def _send(self, frames: list[Outgoing], now_ns: int, elapsed_s: float) -> None:
        """Put one frame, once a receiver, on its way through the scripted network."""
        script = self.settings.script
        if script.active("silence", elapsed_s):
            return
        drop, cut = script.active("drop", elapsed_s), script.active("truncated", elapsed_s)
        if drop and self._random.random() < drop.number(1.0):
            return
        if cut:
            frames = [f._replace(data=f.data[: int(len(f.data) * cut.number(0.5))]) for f in frames]
        if script.active("duplicate", elapsed_s):
            frames = frames * 2
        if script.active("burst", elapsed_s):
            self._held += frames
            return
        if script.active("reorder", elapsed_s) and not self._overtaken:
            self._overtaken = frames
            return
        frames = self._held + frames + self._overtaken
        self._held, self._overtaken = [], []
        late = script.active("late", elapsed_s)
        due_ns = now_ns + self.settings.latency_ns + (round(late.number(0.0) * 1e9) if late else 0)
        for frame in frames:
            self._queued += 1
            heapq.heappush(self._queue, (due_ns, self._queued, frame))
