"""Between wheel radians and what a controller counts in: sign, gear, scale, wrap-around."""

import math
from typing import NamedTuple

TURN_RAD = 2.0 * math.pi


class WheelScale(NamedTuple):
    """Device units per wheel radian, negative for an inverted motor."""

    units_per_rad: float

    @classmethod
    def of(cls, units_per_motor_turn: float, gear_ratio: float, inverted: bool) -> "WheelScale":
        """:param units_per_motor_turn: device position units per turn of the motor shaft."""
        scale = units_per_motor_turn * gear_ratio / TURN_RAD
        return cls(-scale if inverted else scale)

    def to_device(self, radps: float) -> float:
        return radps * self.units_per_rad

    def to_wheel(self, units: float) -> float:
        return units / self.units_per_rad


def saturate(left: float, right: float, limit: float) -> tuple[float, float]:
    """Both wheels divided by max(1, |peak| / limit): curvature is kept."""
    if abs(left) <= limit and abs(right) <= limit:
        return left, right
    peak = max(abs(left), abs(right))
    return left * limit / peak, right * limit / peak


class Odometer:
    """Wheel angle since the start from device positions, modulo 2**bits where the device wraps."""

    def __init__(self, scale: WheelScale, bits: int | None = None) -> None:
        self._units_per_rad = scale.units_per_rad
        self._span = math.inf if bits is None else 1 << bits
        self._half = math.inf if bits is None else 1 << (bits - 1)
        self._last: float | None = None
        self._travelled = 0.0

    def update(self, position: float) -> float:
        """Angle in rad after this reading; the first reading is zero."""
        if self._last is not None:
            delta = position - self._last
            if abs(delta) >= self._half:
                delta = (delta + self._half) % self._span - self._half
            self._travelled += delta
        self._last = position
        return self._travelled / self._units_per_rad

    @property
    def angle_rad(self) -> float:
        return self._travelled / self._units_per_rad

    def restart(self) -> None:
        """Count from the next reading, keeping the angle travelled: the device lost its position."""
        self._last = None
