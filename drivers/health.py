"""Do the wheels do what they are told? Pure: commands and feedback in, a complaint out."""

from typing import NamedTuple

from contract.arena import Safety
from contract.messages import WheelFeedback

STALE_FACTOR = 2.0
"""Telemetry is given up after this many ``safety.driver_silence_s``; the supervisor holds after one."""
SURE_RADPS = 2.0
"""A commanded speed that moves any wheel."""
FROZEN_NS = 400_000_000
"""So long a wheel may stand at a commanded ``SURE_RADPS``: several motor lags."""
REVERSED_NS = 1_000_000_000
"""So long it may turn the other way: twice a reversal from full speed."""
STEP_RAD = 0.05
"""A wheel that has turned by this is not standing."""


class Complaint(NamedTuple):
    """What is wrong; ``silent`` if nothing is heard at all."""

    fault: str
    remedy: str
    silent: bool = False


class _Wheel:
    """One wheel: since when, and at which angle, its last progress."""

    __slots__ = ("_agreed_ns", "_angle_rad", "_moved_ns", "command_radps", "name")

    def __init__(self, name: str) -> None:
        self.name = name
        self.command_radps = 0.0
        self._angle_rad = 0.0
        self._moved_ns = 0
        self._agreed_ns = 0

    def measured(self, command_radps: float, sure_radps: float, radps: float, angle_rad: float, now_ns: int) -> None:
        if abs(command_radps) < sure_radps:
            command_radps = 0.0
        if command_radps * self.command_radps <= 0.0:
            self._moved_ns = self._agreed_ns = now_ns
        self.command_radps = command_radps
        if abs(angle_rad - self._angle_rad) > STEP_RAD:
            self._angle_rad, self._moved_ns = angle_rad, now_ns
        if radps * command_radps >= 0.0 or abs(radps) < SURE_RADPS:
            self._agreed_ns = now_ns

    def complaint(self, heard_ns: int) -> Complaint | None:
        if not self.command_radps:
            return None
        frozen = heard_ns - self._moved_ns > FROZEN_NS
        if not frozen and heard_ns - self._agreed_ns <= REVERSED_NS:
            return None
        told = f"at a commanded {self.command_radps:.1f} rad/s"
        if frozen:
            return Complaint(
                f"the {self.name} encoder stands still {told}: encoder frozen, wheel jammed, or no motor power",
                "Turn the wheel by hand and compare its position; check encoder cable, motor cable and supply",
            )
        return Complaint(
            f"the {self.name} wheel turns the other way {told}",
            f"Swap the motor's or the encoder's wires; if both agree, change {self.name}_inverted",
        )


class Health:
    """One robot's wheels between ``start`` and ``rest``."""

    def __init__(self, safety: Safety, dead_zone_radps: float = 0.0) -> None:
        """:param dead_zone_radps: commands slower than this do not turn the wheels."""
        self._safety = safety
        self._sure_radps = max(SURE_RADPS, 1.2 * dead_zone_radps)
        self._stale_ns = int(STALE_FACTOR * safety.driver_silence_s * 1e9)
        self._active = False
        self._heard_ns = 0
        self._volts: float | None = None
        self.command = (0.0, 0.0)
        """What leaves for the wheels, left and right in rad/s; judged by the samples that follow."""
        self._wheels = (_Wheel("left"), _Wheel("right"))

    def start(self, now_ns: int) -> None:
        """The motors were enabled."""
        self._active, self._heard_ns, self._volts, self.command = True, now_ns, None, (0.0, 0.0)
        self._wheels = (_Wheel("left"), _Wheel("right"))

    def rest(self) -> None:
        """They were disabled."""
        self._active = False

    def measured(self, sample: WheelFeedback, now_ns: int) -> None:
        """What came back."""
        self._heard_ns = now_ns
        self._volts = sample.bus_v
        left, right = self._wheels
        left_radps, right_radps = self.command
        left.measured(left_radps, self._sure_radps, sample.left_radps, sample.left_rad, now_ns)
        right.measured(right_radps, self._sure_radps, sample.right_radps, sample.right_rad, now_ns)

    def quiet(self, now_ns: int) -> bool:
        """Nothing was heard for half of the time after which the link counts as lost."""
        return self._active and now_ns - self._heard_ns > self._stale_ns // 2

    def complaint(self, now_ns: int) -> Complaint | None:
        """What is wrong now, the gravest first."""
        if not self._active:
            return None
        age_ns = now_ns - self._heard_ns
        if age_ns > self._stale_ns:
            return Complaint(
                f"no telemetry for {age_ns * 1e-9:.2f} s although the motors are enabled",
                "Check power, cable, ids and bit rate, then release and arm again",
                silent=True,
            )
        for wheel in self._wheels:
            if (complaint := wheel.complaint(self._heard_ns)) is not None:
                return complaint
        critical_v = self._safety.battery_critical_v
        if self._volts is not None and self._volts < critical_v:
            return Complaint(
                f"under-voltage: {self._volts:.1f} V, below safety.battery_critical_v = {critical_v:g} V",
                "Charge the battery, check its cable",
            )
        return None
