"""The fault vocabulary of emulated wheels, and a line that delays, drops and corrupts bytes."""

from collections import Counter, deque
from random import Random
from typing import Literal, NamedTuple, get_args

FaultKind = Literal[
    "off",
    "stuck",
    "wrong",
    "frozen",
    "brown-out",
    "delayed",
    "dropped",
    "corrupted",
    "jammed",
    "bus-off",
    "unplugged",
    "hung",
]
FAULTS: dict[FaultKind, str] = {
    "off": "motor supply cut: the wheel coasts, the controller does not notice",
    "stuck": "wheel jammed: it stands, whatever is commanded",
    "wrong": "encoders count backwards",
    "frozen": "encoders stand still: the controller's speed loop winds up to full speed",
    "brown-out": "the supply sags: the controller lets go of the motors and says so where it can",
    "delayed": "bytes arrive late",
    "dropped": "chunks of bytes are lost",
    "corrupted": "one bit in every 8 bytes is flipped, and at least one in every chunk",
    "jammed": "the computer's port takes no more bytes (ENOBUFS)",
    "bus-off": "the CAN bus carries no frames",
    "unplugged": "the port is gone from the computer",
    "hung": "controller firmware frozen: no bytes, no watchdog, motors keep their setpoint",
}
assert set(FAULTS) == set(get_args(FaultKind))

Direction = Literal["commands", "telemetry"]


class FaultSettings(NamedTuple):
    """How a line fault acts."""

    directions: tuple[Direction, ...] = ("commands", "telemetry")
    probability: float = 1.0
    """Per chunk."""
    delay_s: float = 0.1
    bit: int = 7
    """Bit flipped by ``corrupted``. Bit 7 never yields another valid slcan character; slcan text has
    no checksum, so a flip that turns one hexadecimal digit into another is not detectable there."""
    wheels: tuple[Literal["left", "right"], ...] = ("left", "right")


class Channel:
    """One direction of a line."""

    def __init__(self, random: Random, counters: Counter[str]) -> None:
        self._random = random
        self._counters = counters
        self.queue: deque[tuple[int, bytes]] = deque()

    def push(self, data: bytes, now_ns: int, faults: dict[FaultKind, FaultSettings]) -> None:
        if not data:
            return
        for kind in ("dropped", "corrupted", "delayed"):
            settings = faults.get(kind)
            if settings is None or self._random.random() >= settings.probability:
                continue
            self._counters[f"fault_{kind}"] += 1
            if kind == "dropped":
                return
            if kind == "corrupted":
                damaged = bytearray(data)
                for start in range(0, len(damaged), 8):
                    damaged[start + self._random.randrange(min(8, len(damaged) - start))] ^= 1 << settings.bit
                data = bytes(damaged)
            else:
                now_ns += int(settings.delay_s * 1e9)
        self.queue.append((now_ns, data))

    def pop(self, now_ns: int) -> bytes:
        """What has arrived by now, in order."""
        arrived = []
        while self.queue and self.queue[0][0] <= now_ns:
            arrived.append(self.queue.popleft()[1])
        return b"".join(arrived)

    def next_due_ns(self) -> int | None:
        return self.queue[0][0] if self.queue else None


class FaultyLine:
    """Both directions between computer and controller; faultless until told otherwise."""

    def __init__(self, seed: int = 0) -> None:
        self.counters: Counter[str] = Counter()
        self.faults: dict[FaultKind, FaultSettings] = {}
        random = Random(seed)
        self._channels: dict[Direction, Channel] = {
            "commands": Channel(random, self.counters),
            "telemetry": Channel(random, self.counters),
        }

    def carry(self, direction: Direction, data: bytes, now_ns: int) -> bytes:
        """Put bytes in at one end; what comes out at the other by now."""
        channel = self._channels[direction]
        if not (self.faults or channel.queue):
            return data
        faults = {kind: settings for kind, settings in self.faults.items() if direction in settings.directions}
        channel.push(data, now_ns, faults)
        return channel.pop(now_ns)

    def next_due_ns(self) -> int | None:
        times = [time for channel in self._channels.values() if (time := channel.next_due_ns()) is not None]
        return min(times, default=None)
