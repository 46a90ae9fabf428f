"""The last gate before any motor: pure, and the only way to one.

The gate only ever *shrinks* a command: each wheel's output has the sign of its input and at most
its magnitude, and both wheels are shrunk by one factor, which keeps the path's curvature. A zero
passes in every state, at any age, whatever else is wrong. A refused command becomes a zero and is
counted by its reason:

``disarmed``   motors are not enabled, or a stop is latched (``stopped``);
``nonfinite``  NaN or infinity in either wheel;
``stale``      the command is older than ``command_age_ns``, or none came for that long (``tick``);
``clock``      time went backwards, or the command is stamped in the future.

Shrunk commands are counted as ``overspeed`` or ``slew``.
"""

import math
from collections import Counter
from enum import Enum
from typing import NamedTuple

from drivers.base import STANDSTILL, WheelSpeeds


class GateLimits(NamedTuple):
    """Bounds of one robot's wheels."""

    max_wheel_radps: float
    max_slew_radps2: float
    """Growth of a wheel speed; shrinking is never limited."""
    command_age_ns: int


class GateState(Enum):
    DISARMED = "disarmed"
    ARMED = "armed"
    STOPPED = "stopped"
    """A stop is latched: only ``arm`` leaves it."""


_ARMED = GateState.ARMED
TOLERANCE = 1.0 + 1e-9
"""A command this little above a bound is rounding, not a fault; it is shrunk without being counted."""


class Gate:
    """Decides what a motor may be told. Times are nanoseconds of one monotonic clock."""

    def __init__(self, limits: GateLimits) -> None:
        self.limits = limits
        self._top_radps, self._age_ns = limits.max_wheel_radps, limits.command_age_ns
        self._slew_radps_per_ns = limits.max_slew_radps2 * 1e-9
        self.state = GateState.DISARMED
        self.counters: Counter[str] = Counter()
        self._last = STANDSTILL
        self._last_ns = 0

    def arm(self, now_ns: int) -> None:
        """Motors are enabled at zero speed; clears a latched stop."""
        self.state = GateState.ARMED
        self._hold(now_ns)

    def disarm(self, now_ns: int) -> None:
        """Motors are disabled; clears a latched stop, allows no motion."""
        self.state = GateState.DISARMED
        self._hold(now_ns)

    def stop(self, now_ns: int) -> None:
        """Latch a stop: zero until armed again. A disarmed gate stays disarmed."""
        if self.state is GateState.ARMED:
            self.state = GateState.STOPPED
        self._hold(now_ns)

    def permit(self, speeds: WheelSpeeds, stamp_ns: int, now_ns: int) -> WheelSpeeds:
        """What may be sent for a command computed at ``stamp_ns``: itself, shrunk, or zero."""
        left_radps, right_radps = speeds
        last_left, last_right = self._last
        growth = self._slew_radps_per_ns * (now_ns - self._last_ns)
        top = self._top_radps
        if not (
            abs(left_radps - last_left) <= growth
            and abs(right_radps - last_right) <= growth
            and abs(left_radps) <= top
            and abs(right_radps) <= top
            and (stamp_ns is now_ns or 0 <= now_ns - stamp_ns <= self._age_ns)
            and self.state is _ARMED
        ):
            if left_radps == 0.0 and right_radps == 0.0:
                return self._hold(now_ns)
            if self.state is not _ARMED or now_ns < self._last_ns or not 0 <= now_ns - stamp_ns <= self._age_ns:
                return self._refuse(stamp_ns, now_ns)
            if not (math.isfinite(left_radps) and math.isfinite(right_radps)):
                self.counters["nonfinite"] += 1
                return self._hold(now_ns)
            speeds = self._shrink(left_radps, right_radps, growth)
        self._last, self._last_ns = speeds, now_ns
        return speeds

    def tick(self, now_ns: int) -> WheelSpeeds | None:
        """A zero to send now because no command came in time, else None.

        While armed it is due again after every ``command_age_ns``, which keeps a device watchdog
        fed at standstill; it never repeats a motion.
        """
        if self.state is GateState.DISARMED or 0 <= now_ns - self._last_ns <= self._age_ns:
            return None
        if self._last != STANDSTILL:
            self.counters["clock" if now_ns < self._last_ns else "stale"] += 1
        return self._hold(now_ns)

    def _hold(self, now_ns: int) -> WheelSpeeds:
        self._last, self._last_ns = STANDSTILL, now_ns
        return STANDSTILL

    def _refuse(self, stamp_ns: int, now_ns: int) -> WheelSpeeds:
        if self.state is not _ARMED:
            self.counters[self.state.value] += 1
        else:
            self.counters["clock" if now_ns < self._last_ns or stamp_ns > now_ns else "stale"] += 1
        return self._hold(now_ns)

    def _shrink(self, left_radps: float, right_radps: float, growth_radps: float) -> WheelSpeeds:
        factor = 1.0
        peak = max(abs(left_radps), abs(right_radps))
        if peak > self.limits.max_wheel_radps:
            factor = self.limits.max_wheel_radps / peak
            if peak > self.limits.max_wheel_radps * TOLERANCE:
                self.counters["overspeed"] += 1
        slew = min(
            _reach(left_radps * factor, self._last[0], growth_radps),
            _reach(right_radps * factor, self._last[1], growth_radps),
        )
        if slew < 1.0:
            self.counters["slew"] += 1
            factor *= slew
        return WheelSpeeds(left_radps * factor, right_radps * factor)


def _reach(wanted: float, last: float, growth: float) -> float:
    """Fraction of ``wanted`` within ``growth`` of ``last``; 1 for any speed between zero and ``last``."""
    bound = growth + (abs(last) if (wanted < 0.0) == (last < 0.0) else 0.0)
    return 1.0 if abs(wanted) <= bound else bound / abs(wanted)
