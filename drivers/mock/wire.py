"""Driver and emulated controller joined in memory, in virtual time, by the very bytes of the wire."""

from collections import Counter
from collections.abc import Callable, Sequence

from drivers.can.frame import CanFrame
from drivers.can.slcan_text import ASK_STATUS, SlcanReader, encode
from drivers.mock.controller import EmulatedController
from drivers.mock.faults import FaultyLine


class VirtualClock:
    """Nanoseconds that pass only when told to; ``on_pass`` hears of it."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns
        self.on_pass: Callable[[int], None] = lambda now_ns: None

    def let_pass(self, seconds: float) -> None:
        self.now_ns += int(seconds * 1e9)
        self.on_pass(self.now_ns)


class WirePort:
    """:class:`drivers.ports.BytePort` straight into an emulated controller."""

    STEP_S = 0.001
    CAPACITY = 4096
    """Bytes a reader that does not drain may leave lying, as in a tty; the rest is lost."""

    def __init__(self, controller: EmulatedController, clock: VirtualClock, line: FaultyLine | None = None) -> None:
        self.name = "memory"
        self.plugged = True
        self.jammed = False
        """Takes no more bytes, like a full transmit queue."""
        self.controller = controller
        self.line = FaultyLine() if line is None else line
        self._clock = clock
        self._received = b""

    def open(self) -> None:
        self._check()
        self._received = b""

    def close(self) -> None:
        self._received = b""

    def fileno(self) -> int | None:
        return None

    def now_ns(self) -> int:
        return self._clock.now_ns

    def wait(self, timeout_s: float) -> None:
        """Virtual time runs, the device with it, until bytes arrive."""
        end_ns = self._clock.now_ns + int(timeout_s * 1e9)
        while not self._received and self._clock.now_ns < end_ns:
            self._clock.let_pass(min(self.STEP_S, (end_ns - self._clock.now_ns) * 1e-9 + 1e-9))
            self.pump()

    def pump(self) -> None:
        """Let the device catch up with the clock."""
        now_ns = self._clock.now_ns
        answer = self.controller.receive(self.line.carry("commands", b"", now_ns), now_ns)
        self.deliver(self.line.carry("telemetry", answer, now_ns))

    def deliver(self, data: bytes) -> None:
        """Bytes arrive from the device."""
        if not data and self.plugged:
            return
        self._received = (self._received + data)[: self.CAPACITY] if self.plugged else b""

    def send(self, data: bytes) -> bool:
        self._check()
        if self.jammed:
            return False
        now_ns = self._clock.now_ns
        answer = self.controller.receive(self.line.carry("commands", data, now_ns), now_ns)
        self.deliver(self.line.carry("telemetry", answer, now_ns))
        return True

    def receive(self) -> bytes:
        self._check()
        self.pump()
        taken, self._received = self._received, b""
        return taken

    def take_counters(self) -> dict[str, int]:
        return {}

    def _check(self) -> None:
        if not self.plugged:
            raise OSError("the device hung up")


class WireFramePort:
    """:class:`drivers.ports.FramePort` over a :class:`WirePort`, frames as slcan text."""

    def __init__(self, wire: WirePort) -> None:
        self.name = wire.name
        self.wire = wire
        self._reader = SlcanReader()

    def open(self) -> None:
        self.wire.open()
        self._reader = SlcanReader()
        self.wire.send(b"O\r")

    def close(self) -> None:
        if self.wire.plugged:
            self.wire.send(b"C\r")
        self.wire.close()

    def fileno(self) -> int | None:
        return None

    def now_ns(self) -> int:
        return self.wire.now_ns()

    def wait(self, timeout_s: float) -> None:
        self.wire.wait(timeout_s)

    def send(self, frames: Sequence[CanFrame]) -> bool:
        return self.wire.send(b"".join([encode(frame) for frame in frames]))

    def inquire(self) -> str:
        if self.wire.plugged:
            self.wire.send(ASK_STATUS)
        return self._reader.status

    def receive(self) -> list[CanFrame]:
        return self._reader.feed(self.wire.receive())

    def take_counters(self) -> dict[str, int]:
        taken: Counter[str] = Counter(self._reader.counters)
        self._reader.counters.clear()
        return dict(taken)
