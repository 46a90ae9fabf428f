"""ros_arduino_bridge: the worked example of a small family.

The device reports neither speed, faults nor battery: wheel speeds are encoder differences over
``WINDOW_NS``. Its auto-stop is compiled in (2 s as published) and cannot be read; ``watchdog_s``
states it. Without a checksum only implausible encoder jumps can be told from good ones.
"""

from collections import Counter, deque
from collections.abc import Mapping
from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault
from drivers.base import STANDSTILL, Site, WheelSpeeds
from drivers.conversion import Odometer, WheelScale, saturate
from drivers.options import DevicePath, WheelOptions
from drivers.ports import BytePort
from drivers.serial import arduino_codec as codec
from drivers.serial.bandwidth import Bandwidth
from drivers.serial.line import Line

Seconds = Annotated[
    float,
    Meta(
        ge=0.0,
        le=10.0,
        description="AUTO_STOP_INTERVAL compiled into the firmware (2 s as published: lower it); "
        "0 accepts that a hung computer leaves the wheels turning",
    ),
]

CYCLE_BYTES = 13 + 4 + 2 + 24
"""``m`` with its OK, ``e`` with two long counts."""


class Options(WheelOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "ros_arduino", ... }``"""

    kind: Literal["ros_arduino"]
    port: DevicePath
    baud: Annotated[int, Meta(ge=9600, le=1_000_000, description="as compiled into the firmware")] = 57600
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
    if options.watchdog_s is None:
        return [Fault(f"{path}.watchdog_s", "", f"missing; {WATCHDOG_TEXT}")]
    return []


def open_port(options: Options) -> BytePort:
    """The serial line."""
    from drivers.serial.port import SerialPort

    return SerialPort(options.port, options.baud)


class Drive:
    """:class:`drivers.base.DiffDrive` for ros_arduino_bridge firmware."""

    BOOT_S = 3.0
    """Opening the port resets most boards."""
    WINDOW_NS = 50_000_000

    def __init__(self, robot: str, options: Options, site: Site, port: BytePort) -> None:
        self.robot = robot
        self.options = options
        self._site = site
        self._line = Line(f"ros_arduino_bridge of {robot}", port)
        self._reader = codec.LineReader()
        counts, gear = float(options.counts_per_revolution), options.gear_ratio
        self._left = WheelScale.of(counts, gear, options.left_inverted)
        self._right = WheelScale.of(counts, gear, options.right_inverted)
        self._odometers = (Odometer(self._left, 32), Odometer(self._right, 32))
        self._history: deque[tuple[int, float, float]] = deque()
        self._last: tuple[int, int] | None = None
        self._active = False

    @property
    def counters(self) -> Mapping[str, int]:
        total: Counter[str] = self._line.counters + self._reader.counters
        return total

    def configure(self) -> None:
        declared, limit = self.options.watchdog_s, self._site.safety.watchdog_s
        if declared is None or declared > limit:
            raise self._line.refused(
                f"the auto-stop of {declared} s exceeds safety.watchdog_s = {limit:g} s", WATCHDOG_TEXT
            )
        self._line.open(Bandwidth(CYCLE_BYTES, self.options.baud, self._site.control_period_s))
        self._reader = codec.LineReader()
        if not self._line.answer(b"\r" + codec.READ_ENCODERS, lambda data: bool(self._reader.feed(data)), self.BOOT_S):
            self.close()
            raise self._line.lost(f"no answer to e at {self.options.baud} baud")
        self._reader.counters.clear()

    def activate(self, now_ns: int) -> None:
        self._odometers = (Odometer(self._left, 32), Odometer(self._right, 32))
        self._history.clear()
        self._last = None
        self._line.send(codec.motor_speeds(0, 0))
        self._active = True

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        if not self._active:
            speeds = STANDSTILL
        rate = float(self.options.pid_rate_hz)
        left, right = self._left.to_device(speeds.left_radps), self._right.to_device(speeds.right_radps)
        left, right = saturate(left / rate, right / rate, float(codec.MAX_TICKS))
        self._line.send(codec.motor_speeds(round(left), round(right)))

    def poll(self, now_ns: int) -> None:
        self._line.send(codec.READ_ENCODERS)

    def read(self, now_ns: int) -> WheelFeedback | None:
        fresh = False
        for left, right in self._reader.feed(self._line.receive()):
            fresh = self._take(left, right, now_ns) or fresh
        if not fresh or len(self._history) < 2:
            return None
        first_ns, first_left, first_right = self._history[0]
        last_ns, last_left, last_right = self._history[-1]
        elapsed_s = (last_ns - first_ns) * 1e-9
        return WheelFeedback(
            robot=self.robot,
            stamp_ns=now_ns,
            left_radps=(last_left - first_left) / elapsed_s,
            right_radps=(last_right - first_right) / elapsed_s,
            left_rad=last_left,
            right_rad=last_right,
            enabled=self._active,
        )

    def stop(self, now_ns: int) -> None:
        self.write(STANDSTILL, now_ns)

    def deactivate(self, now_ns: int) -> None:
        self._active = False
        self._line.send(codec.motor_speeds(0, 0))

    def clear_errors(self, now_ns: int) -> None:
        """The device has none."""

    def close(self) -> None:
        self._active = False
        self._line.port.close()

    def fileno(self) -> int | None:
        return self._line.port.fileno()

    def _take(self, left: int, right: int, now_ns: int) -> bool:
        """Believe a pair of counts unless it jumps further than the wheels could turn."""
        if self._history and now_ns <= self._history[-1][0]:
            return False
        if self._last is not None and self._history:
            elapsed_s = (now_ns - self._history[-1][0]) * 1e-9
            bound = 2.0 * self._site.max_wheel_radps * (elapsed_s + 0.1) * abs(self._left.units_per_rad)
            jump = max(abs(_wrapped(left - self._last[0])), abs(_wrapped(right - self._last[1])))
            if jump > bound:
                self._line.counters["implausible_jump"] += 1
                return False
        self._last = (left, right)
        angles = self._odometers[0].update(left), self._odometers[1].update(right)
        self._history.append((now_ns, *angles))
        while len(self._history) > 2 and now_ns - self._history[1][0] >= self.WINDOW_NS:
            self._history.popleft()
        return True


def _wrapped(delta: int) -> int:
    return (delta + (1 << 31)) % (1 << 32) - (1 << 31)
