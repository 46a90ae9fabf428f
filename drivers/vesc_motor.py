"""What a VESC is over any wire: its options, speed in electrical rpm, position in tachometer steps, a dead zone."""

import math
from typing import Annotated, Protocol

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


def rounded_erpm(motor: WheelMotor, radps: float, min_erpm: float) -> int | None:
    """Setpoint in electrical rpm; None where the controller would apply no current."""
    erpm = motor.speed.to_device(radps)
    if -min_erpm < erpm < min_erpm or -0.5 < erpm < 0.5:
        return None
    return round(erpm) if -2e9 <= erpm <= 2e9 else round(math.copysign(2e9, erpm))


def dead_zone_radps(motor: WheelMotor, min_erpm: float) -> float:
    """Wheel speed below which the controller applies no current."""
    return min_erpm / abs(motor.speed.units_per_rad)
