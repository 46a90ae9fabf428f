"""The way home of a whole swarm: who goes at once, and who waits aside until there is a way to its start. Pure.

Where starts lie far enough apart to pass between, everybody goes at once. Elsewhere robots go by waves
(:mod:`groundstation.parking`): those that are not of the first wave with somebody away from home drive out of the way,
then wave after wave goes home.
"""

import math
from collections.abc import Mapping

from contract.arena import Arena
from contract.messages import RobotReport
from contract.units import Point
from groundstation.parking import NoWay, Waves, aside, waves_of

TIMEOUT_S = 180.0
WAVE_TIMEOUT_S = 30.0
"""More for every wave but one."""
AWAY_M = 0.06
"""A robot this near to a place it was told is there."""
CLEARING_S = 30.0
"""Those that go first wait no longer for the others to be out of the way; what is still there they go round."""


def timeout_s(arena: Arena) -> float:
    """By when everybody is home, s from the order to run."""
    try:
        count = len(waves_of(arena))
    except NoWay:
        count = 1
    return TIMEOUT_S + WAVE_TIMEOUT_S * (count - 1)


class Homeward:
    """One arena's way home; :meth:`begin` before each."""

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._waves: Waves = ()
        self._refusal = ""
        try:
            self._waves = waves_of(arena)
        except NoWay as error:
            self._refusal = str(error)
        self.timeout_s = timeout_s(arena)
        self.aside: dict[str, Point] = {}
        """Who waits now, and where, m."""
        self._steps: list[tuple[str, ...]] = []
        """Waves that have not been sent yet."""
        self._clearing_s = math.inf

    def begin(self, crew: tuple[str, ...], places: Mapping[str, Point]) -> str:
        """Plan the way of these robots, all of them seen; why there is none, in words, or ''."""
        if self._refusal:
            return self._refusal
        self.aside, self._clearing_s = {}, math.inf
        steps = [tuple(name for name in wave if name in crew) for wave in self._waves]
        steps = [wave for wave in steps if wave]
        while len(steps) > 1 and not any(self._away(name, places) for name in steps[0]):
            steps.pop(0)
        self._steps = steps
        if len(steps) > 1:
            waiting = [name for name in steps[0] if self._away(name, places)] + [n for wave in steps[1:] for n in wave]
            try:
                self.aside = aside(self._arena, {n: places[n] for n in crew}, waiting)
            except NoWay as error:
                return str(error)
        return ""

    def _away(self, name: str, places: Mapping[str, Point]) -> bool:
        return math.dist(places[name], self._arena.robots[name].start) > AWAY_M

    def advance(
        self, crew: tuple[str, ...], reports: Mapping[str, RobotReport], places: Mapping[str, Point], s: float
    ) -> list[str]:
        """Send the next wave where it is its turn; robots not home yet. ``s``: any clock."""
        if self.aside:
            self._clearing_s = min(self._clearing_s, s + CLEARING_S)
            first = self._steps[0]
            if any(name in self.aside for name in first):
                clear = all(math.dist(places[name], place) <= AWAY_M for name, place in self.aside.items())
                if clear or s >= self._clearing_s:
                    self._send()
            elif all(reports[name].task == "home" for name in first):
                self._steps.pop(0)
                self._send()
        return [name for name in crew if name in self.aside or reports[name].task != "home"]

    def _send(self) -> None:
        self.aside = {name: place for name, place in self.aside.items() if name not in self._steps[0]}
