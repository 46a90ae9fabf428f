"""What a VESC is over any wire: its options, speed in electrical rpm, position in tachometer steps, a dead zone."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Annotated, Generic, Protocol, TypeVar

from msgspec import Meta

from contract.tables import Fault
from drivers.can.vesc_codec import MAX_ID, TACHO_STEPS_PER_ERPM_TURN
from drivers.conversion import WheelScale
from drivers.family import WheelMotor, pair_faults, undeclared

Controller = Annotated[int, Meta(ge=0, le=MAX_ID, description="VESC id, App Settings > General")]
PolePairs = Annotated[int, Meta(ge=1, le=100, description="of the motor: electrical turns per shaft turn")]
MinErpm = Annotated[float, Meta(ge=0.0, le=100_000.0, description="s_pid_min_erpm; slower commands get no current")]
Amperes = Annotated[float, Meta(gt=0.0, le=200.0, description="current that brakes and holds a zero")]
Seconds = Annotated[
    float,
    Meta(
        ge=0.0,
        le=2.0,
        description="App Settings > General > Timeout, as set in VESC Tool (1 s by default: lower it); "
        "0 accepts that a hung computer leaves the wheels turning",
    ),
]
MAX_ERPM = 2e9
"""Within the 32 bits of the wire."""
WireT = TypeVar("WireT")
WATCHDOG_TEXT = (
    "set App Settings > General > Timeout in VESC Tool and write the same seconds here "
    "(0 accepts the risk of a robot without one)"
)


class VescOptions(Protocol):
    """What both families' options have in common."""

    @property
    def left(self) -> int: ...
    @property
    def right(self) -> int: ...
    @property
    def min_erpm(self) -> float: ...
    @property
    def watchdog_s(self) -> float | None: ...


def check(options: VescOptions, path: str) -> list[Fault]:
    """What no single key shows."""
    return pair_faults(options.left, options.right, path) + undeclared(options.watchdog_s, path, WATCHDOG_TEXT)


def motor_of(name: str, device: int, pole_pairs: int, gear_ratio: float, inverted: bool) -> WheelMotor:
    """A wheel counted in electrical rpm and tachometer steps."""
    speed = WheelScale.of(60.0 * pole_pairs, gear_ratio, inverted)
    steps = WheelScale.of(float(TACHO_STEPS_PER_ERPM_TURN * pole_pairs), gear_ratio, inverted)
    return WheelMotor(name, device, speed, steps, 32)


class Setpoint(Generic[WireT]):
    """What one wheel's VESC is told; where it would apply no current a brake current holds the wheel."""

    def __init__(
        self,
        motor: WheelMotor,
        min_erpm: float,
        speed: Callable[[int], WireT],
        brake: WireT,
        counters: Counter[str],
    ) -> None:
        """
        :param speed: packs electrical rpm.
        :param counters: ``below_min_erpm`` counts speeds that could not be followed.
        """
        self._erpm_per_radps = motor.speed.units_per_rad
        self._least_erpm = max(min_erpm, 0.5)
        self._speed = speed
        self._brake = brake
        self._counters = counters

    def of(self, radps: float) -> WireT:
        """For a wheel speed in rad/s."""
        erpm = radps * self._erpm_per_radps
        size = abs(erpm)
        if size >= self._least_erpm:
            return self._speed(round(erpm if size <= MAX_ERPM else math.copysign(MAX_ERPM, erpm)))
        if size:
            self._counters["below_min_erpm"] += 1
        return self._brake


def dead_zone_radps(motor: WheelMotor, min_erpm: float) -> float:
    """Wheel speed below which the controller applies no current."""
    return min_erpm / abs(motor.speed.units_per_rad)
