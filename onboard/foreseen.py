"""What another robot may do next: brake, or be cut off. Pure.

All of it follows from the newest message, its age and the bounds (``foresight.py`` keeps what is worked out).

A neighbour silent for longer than T is taken to coast from where it is seen, with the turn that it had or the one it
was told to take; one that has never spoken, to go straight on.
"""

import math
from typing import Final

from onboard.courses import CutBounds, brake_way, cut_way
from onboard.hulls import Way
from onboard.limits import Neighbour, Place, Told, stop_m

MAX_AGE_S: Final = 0.5
AGED_MPS: Final = 0.1
"""Ways stay farther apart by this for each second since the other robot was heard: it has chosen anew."""
AGE_STEP_S: Final = 0.03
"""Ages of messages are rounded up to this, so that what is worked out of one serves for some steps."""
ALIKE_MPS: Final = 0.03
"""Turns of which the rims' difference differs by less are one."""
STILL_MPS: Final = 0.005
"""A robot no faster than this is where it is."""

Rims = tuple[float, float, float, float]
"""Rim speeds that a robot may have, m/s: measured left and right, asked left and right."""


class Foreseen:
    """One robot's place and the ways that it may roll from there."""

    __slots__ = (
        "_bounds", "_braking", "_coming", "_facing_rad", "_fastest_mps", "_heading_rad", "_reaction_s", "_standing_s",
        "_turn_rad", "_turns", "apart_m", "brakes_asked", "cut_m", "cut_off_asked", "stop_m", "x_m", "y_m",
    )  # fmt: skip

    def __init__(
        self, place: Place, turns: tuple[Rims, ...], standing_s: float, age_s: float, bounds: CutBounds
    ) -> None:
        """
        :param turns: what its rims may do.
        :param standing_s: its command may stand so long.
        :param age_s: of what is known.
        """
        self.x_m, self.y_m, self._heading_rad = place
        self._turns = turns
        self._standing_s = standing_s
        self._bounds = bounds
        brake = bounds.brake
        self._reaction_s = reaction_s = brake.reaction_s + age_s
        self.apart_m = bounds.contact_m + AGED_MPS * age_s
        """Its ways and those of others stay so far apart."""
        fastest = most_mps = rolls_mps = 0.0
        forward = backward = True
        for left, right, left_to, right_to in turns:
            measured, asked = max(abs(left), abs(right)), max(abs(left_to), abs(right_to))
            fastest = max(fastest, max(measured, asked))
            most_mps = max(most_mps, max(abs(right - left), abs(right_to - left_to)))
            roll, roll_to = left + right, left_to + right_to
            rolls_mps = rolls_mps + roll + roll_to
            forward = forward and roll >= 0.0 and roll_to >= 0.0
            backward = backward and roll <= 0.0 and roll_to <= 0.0
        self._fastest_mps = fastest
        self.stop_m = fastest * reaction_s + stop_m(fastest, brake.deceleration_mps2[0], brake.lag_s[1])
        """It gets no farther braking."""
        self.cut_m = fastest * standing_s + bounds.coast_m(fastest)
        """It gets no farther cut off."""
        self._facing_rad = 0.0 if rolls_mps >= 0.0 else math.pi
        """From its heading to where it rolls."""
        lasting_s = standing_s + fastest / bounds.coast_mps2
        turn_rad = most_mps * lasting_s / brake.separation_m
        self._turn_rad = turn_rad if forward or backward else math.inf
        """It turns no farther, to either side."""
        self._braking: Way = []
        self._coming: Way = []
        self.brakes_asked = self.cut_off_asked = False

    def ahead(self, away_x: float, away_y: float) -> float:
        """The greatest share of its way that can lead into that direction."""
        off = math.atan2(away_y, away_x) - self._heading_rad + self._facing_rad
        off = abs(math.remainder(off, math.tau)) - self._turn_rad
        return 1.0 if off <= 0.0 else math.cos(off) if off < math.pi / 2 else 0.0

    def brakes(self) -> Way:
        """All ways on which it may brake, as one."""
        self.brakes_asked = True
        return self._braking or self._brake()

    def cut_off(self) -> Way:
        """All ways on which it may be cut off, as one."""
        self.cut_off_asked = True
        return self._coming or self._come()

    def prepare(self, like: "Foreseen") -> None:
        """Have those ways ready for which that one was asked."""
        if like.brakes_asked and not self._braking:
            self._brake()
        if like.cut_off_asked and not self._coming:
            self._come()

    def _brake(self) -> Way:
        x, y, heading, bounds = self.x_m, self.y_m, self._heading_rad, self._bounds.brake
        if self._fastest_mps < STILL_MPS:
            way = [(x, y)]
        else:
            way = []
            for left, right, left_to, right_to in self._turns:
                way += brake_way((x, y, heading, left, right), left_to, right_to, self._reaction_s, bounds)
        self._braking = way
        return way

    def _come(self) -> Way:
        x, y, heading, bounds = self.x_m, self.y_m, self._heading_rad, self._bounds
        if self._fastest_mps < STILL_MPS:
            way = [(x, y)]
        else:
            way = []
            for left, right, left_to, right_to in self._turns:
                way += cut_way((x, y, heading, left, right), left_to, right_to, self._standing_s, bounds)
        self._coming = way
        return way


def heard(told: Told, age_steps: int, bounds: CutBounds) -> Foreseen:
    """A robot that has told what it does, so many age steps ago.

    It may do what it was asked; have been asked anew since; or not have heard what it was asked, and keep the turn that
    its wheels have.
    """
    left, right = told.rims
    left_to, right_to = told.asked
    age_s = AGE_STEP_S * age_steps
    turns: list[Rims] = [(left, right, left_to, right_to)]
    if age_s > 0.0:
        onward = (left, right, _onward(left, left_to), _onward(right, right_to))
        turns = [turns[0], onward] if _apart(onward, turns[0]) else [onward]
    kept = (left, right, left, right)
    if all(_apart(kept, turn) for turn in turns):
        turns.append(kept)
    return Foreseen(told.place, tuple(turns), bounds.standing_s + age_s, age_s, bounds)


def seen(other: Neighbour, bounds: CutBounds) -> Foreseen:
    """A robot that has told nothing, or not lately: what is seen of it counts, and what it told of its turn."""
    x, y, vx, vy, age_s, silence_s, told = other
    standing_s = bounds.standing_s
    speed, heading = math.hypot(vx, vy), math.atan2(vy, vx)
    age_s = age_s if 0.0 < age_s < MAX_AGE_S else MAX_AGE_S if age_s > 0.0 else 0.0
    standing_s = age_s if silence_s > standing_s else standing_s + age_s
    return Foreseen((x, y, heading), _turns(speed, told), standing_s, age_s, bounds)


def _apart(one: Rims, other: Rims) -> bool:
    """Whether these lead to different turns."""
    return abs((one[3] - one[2]) - (other[3] - other[2])) > ALIKE_MPS


def _onward(speed_mps: float, command_mps: float) -> float:
    """What a rim may be asked since: that it was to slow down some time ago does not say that it still is."""
    return speed_mps if abs(command_mps) < abs(speed_mps) or speed_mps * command_mps < 0.0 else command_mps


def _turns(speed_mps: float, told: Told | None) -> tuple[Rims, ...]:
    """Rim speeds, measured and asked, that a robot seen at that speed may have: coasting keeps their difference."""
    if told is None:
        return ((speed_mps, speed_mps, speed_mps, speed_mps),)
    found = []
    for left, right in (told.rims, told.asked):
        difference = right - left
        half = min(speed_mps, max(-speed_mps, difference / 2))
        found.append((speed_mps - half, speed_mps + half, speed_mps - half, speed_mps + half))
    return tuple(found)
