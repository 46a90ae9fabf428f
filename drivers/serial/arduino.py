"""ros_arduino_bridge: the worked example of a small family.

The device reports neither speed, faults nor battery: wheel speeds are encoder differences over
``WINDOW_NS``. Its auto-stop is compiled in (2 s as published) and cannot be read; ``watchdog_s``
states it. Without a checksum only implausible encoder jumps can be told from good ones.
"""

from collections import deque
from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault
from drivers.base import STANDSTILL, Site, WheelSpeeds
from drivers.conversion import Odometer, WheelScale, saturate
from drivers.family import undeclared
from drivers.ports import BytePort
from drivers.serial import arduino_codec as codec
from drivers.serial.arduino_codec import MAX_TICKS, motor_speeds
from drivers.serial.family import Baud, SerialDrive, SerialOptions, open_port

__all__ = ["Drive", "Options", "check", "open_port"]

Seconds = Annotated[
    float,
    Meta(
        ge=0.0,
        le=10.0,
        description="AUTO_STOP_INTERVAL compiled into the firmware (2 s as published: lower it); "
        "0 accepts that a hung computer leaves the wheels turning",
    ),
]


class Options(SerialOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "ros_arduino", ... }``"""

    kind: Literal["ros_arduino"]
    baud: Baud = 57600
    counts_per_revolution: Annotated[
        int, Meta(ge=1, le=10_000_000, description="encoder ticks per turn of the motor shaft")
    ]
    pid_rate_hz: Annotated[int, Meta(ge=1, le=1000, description="PID_RATE of the firmware")] = 30
    watchdog_s: Seconds | None = None


WATCHDOG_TEXT = (
    "set AUTO_STOP_INTERVAL in the firmware and write the same seconds here "
    "(0 accepts the risk of wheels that turn on when the computer hangs)"
)


def check(options: Options, path: str) -> list[Fault]:
    """What no single key shows."""
    return undeclared(options.watchdog_s, path, WATCHDOG_TEXT)


class Drive(SerialDrive[Options]):
    """:class:`drivers.base.DiffDrive` for ros_arduino_bridge firmware."""

    CYCLE_BYTES = 13 + 4 + 2 + 24
    """``m`` with its OK, ``e`` with two long counts."""
    BOOT_S = 3.0
    """Opening the port resets most boards."""
    WINDOW_NS = 50_000_000

    def __init__(self, robot: str, options: Options, site: Site, port: BytePort) -> None:
        self._reader = codec.LineReader()
        super().__init__("ros_arduino_bridge", robot, options, site, port, self._reader)
        counts, gear = float(options.counts_per_revolution), options.gear_ratio
        self._left = WheelScale.of(counts, gear, options.left_inverted)
        self._right = WheelScale.of(counts, gear, options.right_inverted)
        self._left_ticks = self._left.units_per_rad / options.pid_rate_hz
        self._jump_per_s = 2.0 * site.max_wheel_radps * abs(self._left.units_per_rad)
        self._right_ticks = self._right.units_per_rad / options.pid_rate_hz
        self._odometers = (Odometer(self._left, 32), Odometer(self._right, 32))
        self._history: deque[tuple[int, float, float]] = deque()
        self._last: tuple[int, int] | None = None

    @property
    def dead_zone_radps(self) -> float:
        """Whole ticks a frame: less than half a one rounds to none."""
        return 0.5 / abs(self._left_ticks)

    def configure(self) -> None:
        self.accept_watchdog(self.options.watchdog_s, WATCHDOG_TEXT)
        self.open()
        self._reader.reset()
        if not self.line.answer(b"\r" + codec.READ_ENCODERS, lambda data: bool(self._reader.feed(data)), self.BOOT_S):
            self.close()
            raise self.line.lost(f"no answer to e at {self.options.baud} baud")
        self._reader.counters.clear()

    def activate(self, now_ns: int) -> None:
        self._odometers = (Odometer(self._left, 32), Odometer(self._right, 32))
        self._history.clear()
        self._last = None
        self.line.send(motor_speeds(0, 0))
        self.active = True

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        left, right = speeds if self.active else STANDSTILL
        left, right = left * self._left_ticks, right * self._right_ticks
        if abs(left) > MAX_TICKS or abs(right) > MAX_TICKS:
            left, right = saturate(left, right, MAX_TICKS)
        self.line.send(motor_speeds(round(left), round(right)))

    def poll(self, now_ns: int) -> None:
        self.line.send(codec.READ_ENCODERS)

    def read(self, now_ns: int) -> WheelFeedback | None:
        fresh = False
        for left, right in self._reader.feed(self.line.receive()):
            fresh = self._take(left, right, now_ns) or fresh
        if not fresh or len(self._history) < 2:
            return None
        first_ns, first_left, first_right = self._history[0]
        last_ns, last_left, last_right = self._history[-1]
        elapsed_s = (last_ns - first_ns) * 1e-9
        return self.feedback(
            now_ns,
            ((last_left - first_left) / elapsed_s, last_left),
            ((last_right - first_right) / elapsed_s, last_right),
        )

    def _take(self, left: int, right: int, now_ns: int) -> bool:
        """Believe a pair of counts unless it jumps further than the wheels could turn."""
        if self._history and now_ns <= self._history[-1][0]:
            return False
        if self._last is not None and self._history:
            bound = self._jump_per_s * ((now_ns - self._history[-1][0]) * 1e-9 + 0.1)
            if _far(left - self._last[0], bound) or _far(right - self._last[1], bound):
                self.line.counters["implausible_jump"] += 1
                return False
        self._last = (left, right)
        history = self._history
        history.append((now_ns, self._odometers[0].update(left), self._odometers[1].update(right)))
        while len(history) > 2 and now_ns - history[1][0] >= self.WINDOW_NS:
            history.popleft()
        return True


def _far(delta: int, bound: float) -> bool:
    """Further than ``bound`` either way, 32-bit counters wrapped."""
    return not -bound <= delta <= bound and not -bound <= (delta + (1 << 31)) % (1 << 32) - (1 << 31) <= bound
