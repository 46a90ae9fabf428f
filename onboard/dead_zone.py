"""The slowest rim speed at which a robot's wheels turn, learnt while it creeps. Pure.

Below some speed no motor turns its wheel: a VESC applies no current under ``s_pid_min_erpm``, encoder ticks round to
nought, a gearbox sticks. Who wants to arrive somewhere must not command less, nor wish to be more exact than that.
"""

from typing import Final

STANDS_S: Final = 0.4
"""So long wheels may stand while commanded before the command counts as too slow: several motor lags."""
TURNING_SHARE: Final = 0.25
"""Wheels turn that reach this share of the command."""
GROWTH: Final = 1.4
"""The next command to try, as a multiple of the one that turned nothing."""
ROLL_S: Final = 0.2
"""A robot rolls on for about this long: a pose's age and a motor's lag."""


class DeadZone:
    """Of one robot, until :meth:`forget`."""

    def __init__(self, most_mps: float) -> None:
        """:param most_mps: wheels that stand at this command are not slow, but stuck."""
        self.least_mps = 0.0
        """Rim speed at which the wheels turn, as far as is known."""
        self._most_mps = most_mps
        self._turned_s = 0.0

    def forget(self, now_s: float) -> None:
        self.least_mps, self._turned_s = 0.0, now_s

    def saw(self, told_mps: float, measured_mps: float, now_s: float) -> None:
        """What the faster wheel was told in the last step, and does; both without sign."""
        if told_mps <= 0.0 or measured_mps > TURNING_SHARE * told_mps:
            self._turned_s = now_s
        elif now_s - self._turned_s > STANDS_S:
            self._turned_s = now_s
            self.least_mps = max(self.least_mps, min(self._most_mps, GROWTH * told_mps))

    def raised(self, left_mps: float, right_mps: float) -> tuple[float, float]:
        """Both rims faster by one factor, so that the faster turns; a zero stays."""
        peak = max(abs(left_mps), abs(right_mps))
        if peak == 0.0 or peak >= self.least_mps:
            return (left_mps, right_mps)
        factor = self.least_mps / peak
        return (left_mps * factor, right_mps * factor)

    def roll_m(self, deceleration_mps2: float) -> float:
        """Way that a robot rolls after the slowest command it can be given: it cannot arrive more exactly."""
        return self.least_mps * ROLL_S + 0.5 * self.least_mps**2 / deceleration_mps2
