"""What is foreseen of other robots, kept. Pure.

It is worked out once a message and age step, and ahead of the next step where the ways were looked at in the last.
"""

import math
from collections.abc import Iterable

from contract.messages import NeighbourState
from onboard.courses import CutBounds
from onboard.foreseen import AGE_STEP_S, Foreseen, heard, seen
from onboard.limits import Neighbour, Place, RimSpeeds, Told


class Foretold(Told):
    """What a robot told, with all that was worked out of it for one arena."""

    __slots__ = ("by_age", "used")

    def __init__(self, place: Place, rims: RimSpeeds, asked: RimSpeeds) -> None:
        super().__init__(place, rims, asked)
        self.by_age: dict[int, Foreseen] = {}
        """By age steps."""
        self.used: Foreseen | None = None
        """The last that was used."""


def foresee(other: Neighbour, bounds: CutBounds) -> Foreseen:
    """What a neighbour may do; out of what is known already where its message is :class:`Foretold`."""
    *_, silence_s, told = other
    if told is None or silence_s > bounds.standing_s:
        return seen(other, bounds)
    age_steps = math.ceil(silence_s / AGE_STEP_S)
    if type(told) is not Foretold:
        return heard(told, age_steps, bounds)
    found = told.used = told.by_age.get(age_steps) or _work_out(told, age_steps, bounds)
    return found


def _work_out(told: Foretold, age_steps: int, bounds: CutBounds) -> Foreseen:
    found = told.by_age[age_steps] = heard(told, age_steps, bounds)
    return found


class Foresight:
    """The newest message of every robot heard, with all that was worked out of it."""

    def __init__(self, bounds: CutBounds) -> None:
        self._bounds = bounds
        self._known: dict[str, tuple[NeighbourState, Foretold | None]] = {}

    def told(self, state: NeighbourState) -> Foretold | None:
        """What a message says of its sender's motion."""
        known = self._known.get(state.robot)
        return known[1] if known is not None and known[0] is state else self._take(state)

    def _take(self, state: NeighbourState) -> Foretold | None:
        told = None
        if state.rims_mps is not None and state.asked_mps is not None:
            told = Foretold((state.x_m, state.y_m, state.heading_rad), state.rims_mps, state.asked_mps)
        self._known[state.robot] = (state, told)
        return told

    def hear(self, state: NeighbourState, silence_s: float) -> None:
        """Take a message before a step needs it.

        :param silence_s: about its age at the next step; below 0, by a clock that is ahead, is 0.
        """
        _, before = self._known.get(state.robot, (state, None))
        told = self._take(state)
        if told is not None and before is not None:
            self._prepare(told, max(0.0, silence_s), before)

    def look_ahead(self, neighbours: Iterable[Neighbour], later_s: float) -> None:
        """Have ready what these will be asked when that much time has passed."""
        for *_, silence_s, told in neighbours:
            if type(told) is Foretold:
                self._prepare(told, silence_s + later_s, told)

    def _prepare(self, told: Foretold, silence_s: float, before: Foretold) -> None:
        """``before``: the message that was looked at in the last step."""
        if silence_s <= self._bounds.standing_s and before.used is not None:
            age_steps = math.ceil(silence_s / AGE_STEP_S)
            found = told.by_age.get(age_steps) or _work_out(told, age_steps, self._bounds)
            found.prepare(before.used)
