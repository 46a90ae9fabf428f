"""One motor output of an emulated RoboClaw: quadrature counts, closed-loop speed, duty."""

import math

from drivers.mock.motor import Shaft

FULL_DUTY = 32767


class Channel:
    """M1 or M2."""

    def __init__(self, shaft: Shaft, counts_per_turn: int, start_counts: int) -> None:
        self.shaft = shaft
        self.gains = (0x10000, 0x8000, 0x4000, 44000)
        """Velocity P, I, D and QPPS."""
        self._counts = counts_per_turn
        self._offset = start_counts

    @property
    def encoder(self) -> int:
        return (math.floor(self.shaft.turns * self._counts) + self._offset) % (1 << 32)

    @property
    def qpps(self) -> int:
        return round(self.shaft.turns_per_s * self._counts)

    @property
    def pwm(self) -> int:
        """Share of full speed as a duty, +-32767."""
        top = self.shaft.wheel.limits.max_radps * abs(self.shaft.turns_per_rad)
        return round(max(-1.0, min(1.0, self.shaft.turns_per_s / top)) * FULL_DUTY)

    def set_encoder(self, value: int) -> None:
        self._offset = value - math.floor(self.shaft.turns * self._counts)

    def set_gains(self, derivative: int, proportional: int, integral: int, qpps: int) -> None:
        self.gains = (proportional, integral, derivative, qpps)

    def speed(self, qpps: int, qpps_per_s: int | None = None) -> None:
        """:param qpps_per_s: growth of the speed; None: as fast as the motor can."""
        wheel = self.shaft.wheel
        wheel.acceleration_radps2 = wheel.limits.acceleration_radps2
        if qpps_per_s is not None:
            wheel.acceleration_radps2 = max(qpps_per_s / abs(self._counts * self.shaft.turns_per_rad), 1e-3)
        self.shaft.drive(qpps / self._counts)

    def duty(self, duty: int) -> None:
        """Of +-32767; 0 lets the motor coast."""
        wheel = self.shaft.wheel
        if duty == 0:
            wheel.release()
        else:
            self.shaft.drive(duty / FULL_DUTY * wheel.limits.max_radps * abs(self.shaft.turns_per_rad))
