"""A wheel motor: first-order lag with an acceleration limit, coasting when released."""

import math
from typing import NamedTuple

from contract.arena import Platform


class MotorLimits(NamedTuple):
    """Of the wheel, in rad and s."""

    lag_s: float = 0.1
    acceleration_radps2: float = 66.0
    coast_radps2: float = 20.0
    max_radps: float = 100.0

    @classmethod
    def of(cls, platform: Platform) -> "MotorLimits":
        radius = platform.wheel_radius_m
        return cls(
            platform.motor_lag_s, platform.max_acceleration_mps2 / radius, platform.coast_deceleration_mps2 / radius
        )


class Motor:
    """``dv/dt = clip((command - v) / lag, +-a)`` while powered, ``-sign(v) coast`` while released.

    Integrated in closed form: the result does not depend on how often ``advance`` is called.
    """

    def __init__(self, limits: MotorLimits) -> None:
        self.limits = limits
        self.angle_rad = 0.0
        self.radps = 0.0
        self.command_radps = 0.0
        self.acceleration_radps2 = limits.acceleration_radps2
        """May be lowered by a command, never above the limit."""
        self.powered = False
        self.supplied = True
        """False: the motor wires are off; the controller does not notice."""
        self.stuck = False
        """The wheel is jammed."""
        self.frozen_rad: float | None = None
        """Where the encoder has stopped, if it has: the speed loop then winds up to full speed."""

    def drive(self, radps: float) -> None:
        """Closed-loop speed."""
        self.powered = True
        self.command_radps = max(-self.limits.max_radps, min(self.limits.max_radps, radps))

    def release(self) -> None:
        """No torque."""
        self.powered = False
        self.command_radps = 0.0

    def advance(self, dt_s: float) -> None:
        if dt_s <= 0.0:
            return
        if self.stuck:
            self.radps = 0.0
        elif self.powered and self.supplied:
            self._servo(dt_s)
        else:
            self._coast(dt_s)

    def _servo(self, dt_s: float) -> None:
        lag, limit, _, fastest = self.limits
        if self.acceleration_radps2 < limit:
            limit = self.acceleration_radps2
        command = self.command_radps
        if self.frozen_rad is not None and command:
            command = math.copysign(fastest, command)
        error = command - self.radps
        beyond = abs(error) - limit * lag
        ramp_s = 0.0
        if beyond > 0.0:
            ramp_s = min(dt_s, beyond / limit)
            gain = math.copysign(limit * ramp_s, error)
            self.angle_rad += (self.radps + 0.5 * gain) * ramp_s
            self.radps += gain
            error -= gain
        rest_s = dt_s - ramp_s
        if rest_s <= 0.0:
            return
        decay = math.exp(-rest_s / lag) if lag > 0.0 else 0.0
        self.angle_rad += command * rest_s - error * lag * (1.0 - decay)
        self.radps = command - error * decay

    def _coast(self, dt_s: float) -> None:
        if self.radps == 0.0:
            return
        rolling_s = min(dt_s, abs(self.radps) / self.limits.coast_radps2)
        loss = math.copysign(self.limits.coast_radps2 * rolling_s, self.radps)
        self.angle_rad += (self.radps - 0.5 * loss) * rolling_s
        self.radps = 0.0 if rolling_s < dt_s else self.radps - loss


class Shaft:
    """A motor as its controller sees it: turns of the motor shaft, behind gear and mounting side."""

    def __init__(self, wheel: Motor, gear_ratio: float, inverted: bool, start_turns: float = 0.0) -> None:
        self.wheel = wheel
        self.turns_per_rad = gear_ratio / (2.0 * math.pi) * (-1.0 if inverted else 1.0)
        self._start_turns = start_turns
        self.sensor_sign = 1.0
        """-1: the encoder counts backwards (fault ``wrong``)."""

    @property
    def turns(self) -> float:
        frozen_rad = self.wheel.frozen_rad
        angle_rad = self.wheel.angle_rad if frozen_rad is None else frozen_rad
        return self._start_turns + self.sensor_sign * angle_rad * self.turns_per_rad

    @property
    def turns_per_s(self) -> float:
        if self.wheel.frozen_rad is not None:
            return 0.0
        return self.sensor_sign * self.wheel.radps * self.turns_per_rad

    def drive(self, turns_per_s: float) -> None:
        self.wheel.drive(turns_per_s / self.turns_per_rad)

    @property
    def commanded_radps(self) -> float:
        """The setpoint as a wheel speed."""
        return self.wheel.command_radps
