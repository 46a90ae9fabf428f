"""How far a commanded wheel must have rolled, if it is one the arena file allows. Pure."""

from typing import NamedTuple

from contract.arena import Arena
from onboard.limits import respond


class Plant(NamedTuple):
    """A wheel that answers a command as :func:`onboard.limits.respond` says."""

    acceleration_mps2: float
    lag_s: float


def slowest(arena: Arena) -> Plant:
    """The slowest calibrated wheel of an arena file, behind the last gate's limit of growth."""
    field = arena.control.field
    return Plant(min(field.brake_deceleration_mps2[0], arena.safety.max_slew_mps2), field.motor_lag_s[1])


class Expected:
    """What a rim does at least: the slowest calibrated wheel, and one that does at once as it is told."""

    def __init__(self, slow: Plant) -> None:
        self._slow = slow
        self._slow_mps = 0.0
        self.speed_mps = 0.0
        """Without sign."""

    def roll(self, command_mps: float, span_s: float) -> float:
        """The way, m and without sign, while that command stands."""
        if self._slow_mps == command_mps:
            self.speed_mps = abs(command_mps)
            return abs(command_mps * span_s)
        slow_m, slow_mps = respond(self._slow_mps, command_mps, span_s, *self._slow)
        self._slow_mps = slow_mps
        self.speed_mps = _both(slow_mps, command_mps)
        return _both(slow_m, command_mps * span_s)


def _both(slow: float, quick: float) -> float:
    """The lesser of two of one sign, without it; 0 where they differ in sign."""
    if slow * quick > 0.0:
        slow, quick = abs(slow), abs(quick)
        return slow if slow < quick else quick
    return 0.0
