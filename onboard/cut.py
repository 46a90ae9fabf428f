"""A robot cut off: its last command stands until the device watchdog lets go, then it coasts. Pure.

Nothing commands such a robot, so the way it still rolls must have been clear before. From 0.8 m/s with 0.2 s and
0.6 m/s^2 that is 0.71 m, where a brake takes 0.22 m.

One robot fails at a time; the others brake. So for two robots the way of either one cut off and the way on which the
other brakes (:mod:`onboard.courses`, both as the arcs they are) must stay ``contact_m`` apart, whoever fails. Robots
tell their neighbours what their wheels do and are told to do. Half way between two ways as they stand there is a line,
the same for both robots, and a new command must leave each robot's own way on its side, half of ``contact_m`` off it.
So whatever both choose at one time, the new ways stay apart, too; and to brake is always left.

Ways farther apart than that by ``WIDE_M`` are no concern: no braking way grows by so much before it is looked at again.
A neighbour silent for longer than T is taken to coast from where it is seen, with the turn that it had or the one it
was told to take; one that has never spoken, to go straight on.
"""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

from onboard.ahdc.parameters import record
from onboard.courses import Course, CutBounds, Point, Way, brake_way, cut_bounds, cut_way, least, nearest
from onboard.limits import REST_MPS, Bounds, Limited, Neighbour, Told, stop_m

__all__ = ["CutBounds", "cut_bounds", "limit_cut"]

TRIES = 4
"""Shares of a command that are looked at, between none and all."""
MAX_AGE_S = 0.5
WIDE_M = 0.1
AGED_MPS = 0.1
"""Ways stay farther apart by this for each second since the other robot was heard: it has chosen anew."""
AGE_STEP_S = 0.03
"""Ages of messages are rounded up to this, so that what is worked out of one serves for some steps."""
STILL_MPS = 0.005
"""A robot no faster than this is where it is."""
PIVOT_M = 0.06
"""At the end of its way a robot may turn about one wheel by as much."""
ROUNDING_M = 1e-9

Turns = tuple[tuple[float, float, float, float], ...]
"""Rim speeds that another robot may have: measured left and right, asked left and right."""

Line = tuple[float, float, float, str]
"""Direction x and y away from what is there, how far along it a way must begin, m, and what is there."""


def limit_cut(
    v_mps: float,
    omega_radps: float,
    pose: tuple[float, float, float],
    wheels_mps: tuple[float, float],
    asked_mps: tuple[float, float],
    others: Sequence[Neighbour],
    bounds: CutBounds,
) -> Limited:
    """The largest share of a velocity, curve kept, with which a robot reaches nobody and no edge, whoever is cut off.

    :param pose: own x m, y m, heading rad, dead-reckoned to now.
    :param wheels_mps: measured rim speeds, left and right.
    :param asked_mps: rim speeds commanded so far.
    """
    if v_mps == 0.0:
        return Limited(v_mps, omega_radps, "")
    half_m = bounds.brake.separation_m / 2 * omega_radps
    ways = _Ways((*pose, *wheels_mps), (v_mps - half_m, v_mps + half_m), bounds)
    if not ways.find_lines(asked_mps, others):
        return Limited(v_mps, omega_radps, "")
    whole_m, by = ways.room(1.0)
    if whole_m >= 0.0:
        return Limited(v_mps, omega_radps, "")
    share = _share(ways, whole_m)
    moving = max(abs(wheels_mps[0]), abs(wheels_mps[1])) > REST_MPS
    return Limited(share * v_mps, omega_radps * share if share > 0.0 or moving else omega_radps, by)


def _share(ways: "_Ways", whole_m: float) -> float:
    """The largest share found that leaves the ways on their side; 0, the brake, where not even that does."""
    low_m, _ = ways.room(0.0)
    low, high = 0.0, 1.0
    if low_m < 0.0:
        return 0.0
    for _ in range(TRIES):
        share = low_m / (low_m - whole_m)
        share = low + (high - low) * (0.1 if share < 0.1 else 0.9 if share > 0.9 else share)
        room_m, _ = ways.room(share)
        if room_m >= 0.0:
            low, low_m = share, room_m
        else:
            high, whole_m = share, room_m
    return low


class _Ways:
    """The ways that a command leads to, cut off or braking after it, and the lines they may not cross."""

    def __init__(self, course: Course, command_mps: tuple[float, float], bounds: CutBounds) -> None:
        self._course = course
        self._command = command_mps
        self._bounds = bounds
        self._cut = self._cut_after(*command_mps)
        self._stop = self._stop_after(*command_mps)
        self._cut_lines: list[Line] = []
        self._stop_lines: list[Line] = []

    def _cut_after(self, left_mps: float, right_mps: float) -> Way:
        return cut_way(self._course, left_mps, right_mps, self._bounds.standing_s, self._bounds)

    def _stop_after(self, left_mps: float, right_mps: float) -> Way:
        brake = self._bounds.brake
        return brake_way(self._course, left_mps, right_mps, brake.reaction_s, brake)

    def find_lines(self, asked_mps: tuple[float, float], others: Sequence[Neighbour]) -> bool:
        """Whether there are any."""
        self._cut_lines = _walls(self._cut, self._bounds)
        cut: Way = []
        stop: Way = []
        here = self._course[:2]
        for other in others:
            theirs = _Theirs(other, here, self._bounds)
            if theirs.may_meet(self._cut, theirs.stop_m) and theirs.meets(brakes := theirs.brakes()):
                cut = cut or self._cut_after(*asked_mps)
                self._cut_lines.append(_line(cut, brakes, theirs.apart_m))
            if theirs.may_meet(self._stop, theirs.cut_m) and theirs.meets(coming := theirs.cut_off()):
                stop = stop or self._stop_after(*asked_mps)
                self._stop_lines.append(_line(stop, coming, theirs.apart_m))
        return bool(self._cut_lines or self._stop_lines)

    def room(self, share: float) -> tuple[float, str]:
        """How far that share of the command stays on this side of the lines, m (negative: beyond one), and of which."""
        left_mps, right_mps = self._command
        cut, stop = self._cut, self._stop
        if share != 1.0:
            cut = self._cut_after(share * left_mps, share * right_mps) if self._cut_lines else []
            stop = self._stop_after(share * left_mps, share * right_mps) if self._stop_lines else []
        room_m, by = math.inf, ""
        for way, lines in ((cut, self._cut_lines), (stop, self._stop_lines)):
            for away_x, away_y, begin_m, name in lines:
                left_m = least(way, away_x, away_y) - begin_m + ROUNDING_M
                if left_m < room_m:
                    room_m, by = left_m, name
        return room_m, by


@lru_cache(maxsize=256)
def _braking(told: Told, reaction_s: float, brake: Bounds) -> Way:
    x, y, heading, left, right, left_to, right_to = told
    return brake_way((x, y, heading, left, right), left_to, right_to, reaction_s, brake)


@lru_cache(maxsize=256)
def _coasting(told: Told, standing_s: float, bounds: CutBounds) -> Way:
    x, y, heading, left, right, left_to, right_to = told
    return cut_way((x, y, heading, left, right), left_to, right_to, standing_s, bounds)


class _Theirs:
    """What another robot may do: brake, or be cut off."""

    def __init__(self, other: Neighbour, here: Point, bounds: CutBounds) -> None:
        x, y, vx, vy, age_s, silence_s, told = other
        if told is not None and silence_s <= bounds.standing_s:
            x, y, heading, left, right, left_to, right_to = told
            age_s = AGE_STEP_S * math.ceil(silence_s / AGE_STEP_S)
            self.standing_s = bounds.standing_s + age_s
            if age_s > 0.0:
                left_to, right_to = _onward(left, left_to), _onward(right, right_to)
            turns: Turns = ((left, right, left_to, right_to),)
        else:
            speed, heading = math.hypot(vx, vy), math.atan2(vy, vx)
            age_s = age_s if 0.0 < age_s < MAX_AGE_S else MAX_AGE_S if age_s > 0.0 else 0.0
            self.standing_s = age_s if silence_s > bounds.standing_s else bounds.standing_s + age_s
            turns = _turns(speed, told)
            left, right, left_to, right_to = turns[0]
        self._turns = turns
        self._x, self._y, self._heading = x, y, heading
        self._reaction_s = bounds.brake.reaction_s + age_s
        self._bounds = bounds
        self.apart_m = bounds.contact_m + AGED_MPS * age_s
        fastest = self._fastest = max(abs(left), abs(right), abs(left_to), abs(right_to))
        brake = bounds.brake
        self.stop_m = fastest * self._reaction_s + stop_m(fastest, brake.deceleration_mps2[0], brake.lag_s[1])
        """It gets no farther braking."""
        self.cut_m = fastest * self.standing_s + bounds.coast_m(fastest)
        """It gets no farther cut off."""
        away_x, away_y = here[0] - x, here[1] - y
        distance_m = math.hypot(away_x, away_y)
        self._away = (away_x / distance_m, away_y / distance_m) if distance_m > 0.0 else (1.0, 0.0)
        """Direction from it to this robot."""
        self._at_m = x * self._away[0] + y * self._away[1]
        self._begins_m = 0.0
        self._ahead: float | None = None

    def _most_ahead(self) -> float:
        """The greatest share of its way that can lead towards this robot."""
        if len(self._turns) > 1:
            return 1.0
        left, right, left_to, right_to = self._turns[0]
        now, then = left + right, left_to + right_to
        if now * then < 0.0:
            return 1.0
        lasting_s = self.standing_s + self._fastest / self._bounds.coast_mps2
        turn = max(abs(right - left), abs(right_to - left_to)) * lasting_s / self._bounds.brake.separation_m
        off = math.atan2(self._away[1], self._away[0]) - self._heading
        off = abs(math.remainder(off if now + then >= 0.0 else off + math.pi, math.tau)) - turn
        return 1.0 if off <= 0.0 else math.cos(off) if off < math.pi / 2 else 0.0

    def may_meet(self, way: Way, most_m: float) -> bool:
        """Whether something that rolls this far may come near to a way."""
        self._begins_m = least(way, *self._away)
        gap_m = self._begins_m - self._at_m - self.apart_m - WIDE_M - PIVOT_M
        if gap_m >= most_m:
            return False
        if self._ahead is None:
            self._ahead = self._most_ahead()
        return gap_m < self._ahead * most_m

    def meets(self, theirs: Way) -> bool:
        """Whether a way of it comes near to the one that it was asked of last whether it may."""
        x, y = self._away
        return self._begins_m + least(theirs, -x, -y) < self.apart_m + WIDE_M

    def brakes(self) -> Way:
        return self._ways(lambda told: _braking(told, self._reaction_s, self._bounds.brake))

    def cut_off(self) -> Way:
        return self._ways(lambda told: _coasting(told, self.standing_s, self._bounds))

    def _ways(self, way_of: Callable[[Told], Way]) -> Way:
        """All ways that may be, as one."""
        here = (self._x, self._y)
        if self._fastest < STILL_MPS:
            return [here]
        return [point for rims in self._turns for point in way_of(record(Told, (*here, self._heading, *rims)))]


def _onward(speed_mps: float, command_mps: float) -> float:
    """What a rim may be asked since: that it was to slow down some time ago does not say that it still is."""
    return speed_mps if abs(command_mps) < abs(speed_mps) or speed_mps * command_mps < 0.0 else command_mps


def _turns(speed_mps: float, told: Told | None) -> Turns:
    """Rim speeds, measured and asked, that a robot seen at that speed may have: coasting keeps their difference."""
    if told is None:
        return ((speed_mps, speed_mps, speed_mps, speed_mps),)
    found = []
    for difference in (told.right_mps - told.left_mps, told.asked_right_mps - told.asked_left_mps):
        half = min(speed_mps, max(-speed_mps, difference / 2))
        found.append((speed_mps - half, speed_mps + half, speed_mps - half, speed_mps + half))
    return tuple(found)


def _walls(way: Way, bounds: CutBounds) -> list[Line]:
    """The sides of the floor that a way comes to; a robot beyond one may not go farther."""
    low_x, low_y, high_x, high_y = bounds.brake.fence
    beyond_m = bounds.beyond_fence_m
    xs, ys = zip(*way, strict=True)
    if (
        min(xs) >= low_x - beyond_m
        and min(ys) >= low_y - beyond_m
        and max(xs) <= high_x + beyond_m
        and max(ys) <= high_y + beyond_m
    ):
        return []
    x, y = way[0]
    lines: list[Line] = []
    sides = ((1.0, 0.0, x, low_x), (0.0, 1.0, y, low_y), (-1.0, 0.0, -x, -high_x), (0.0, -1.0, -y, -high_y))
    for away_x, away_y, at_m, side_m in sides:
        begin_m = min(at_m, side_m - beyond_m)
        if least(way, away_x, away_y) < begin_m:
            lines.append((away_x, away_y, begin_m, "fence"))
    return lines


def _line(mine: Way, theirs: Way, apart_m: float) -> Line:
    """Half way between two ways; where they are too near, this robot's way is the one that has to give way."""
    found = nearest(mine, theirs)
    if found is None:
        return (1.0, 0.0, math.inf, "separation")
    away_x, away_y, begins_m, ends_m = found
    gap_m = begins_m - ends_m
    if gap_m >= apart_m:
        return (away_x, away_y, ends_m + (gap_m + apart_m) / 2, "separation")
    at_m = mine[0][0] * away_x + mine[0][1] * away_y
    return (away_x, away_y, min(at_m, ends_m + apart_m), "separation")
