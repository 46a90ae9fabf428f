"""A robot cut off: its last command stands until the device watchdog lets go, then it coasts. Pure.

Nothing commands such a robot, so the way it still rolls must have been clear before. From 0.8 m/s with 0.2 s and
0.6 m/s^2 that is 0.71 m, where a brake takes 0.22 m.

One robot fails at a time; the others brake. So for two robots the way of either one cut off and the way on which the
other brakes (:mod:`onboard.courses`, both as the arcs they are) must stay ``contact_m`` apart, whoever fails. Robots
tell their neighbours what their wheels do and are told to do. Half way between two ways as they stand there is a line,
the same for both robots, and a new command must leave each robot's own way on its side, half of ``contact_m`` off it.
So whatever both choose at one time, the new ways stay apart, too; and to brake is always left.

Ways farther apart than that by ``WIDE_M`` are no concern: no braking way grows by so much before it is looked at again.
"""

import math
from typing import Final

from onboard.courses import Course, CutBounds, brake_way, cut_bounds, cut_way
from onboard.foresight import foresee
from onboard.hulls import Way, least, nearest
from onboard.limits import REST_MPS, Limited, Neighbour
from onboard.record import record

__all__ = ["CutBounds", "cut_bounds", "limit_cut"]

TRIES: Final = 4
"""Shares of a command that are looked at, between none and all."""
WIDE_M: Final = 0.1
PIVOT_M: Final = 0.06
"""At the end of its way a robot may turn about one wheel by as much."""
ROUNDING_M: Final = 1e-9

Line = tuple[float, float, float, str]
"""Direction x and y away from what is there, how far along it a way must begin, m, and what is there."""


def limit_cut(
    v_mps: float,
    omega_radps: float,
    pose: tuple[float, float, float],
    wheels_mps: tuple[float, float],
    asked_mps: tuple[float, float],
    others: list[Neighbour],
    bounds: CutBounds,
) -> Limited:
    """The largest share of a velocity, curve kept, with which a robot reaches nobody and no edge, whoever is cut off.

    :param pose: own x m, y m, heading rad, dead-reckoned to now.
    :param wheels_mps: measured rim speeds, left and right.
    :param asked_mps: rim speeds commanded so far.
    """
    if v_mps == 0.0:
        return record(Limited, (v_mps, omega_radps, ""))
    half_m = bounds.brake.separation_m / 2 * omega_radps
    ways = _Ways((*pose, *wheels_mps), (v_mps - half_m, v_mps + half_m), bounds)
    if not ways.find_lines(asked_mps, others):
        return record(Limited, (v_mps, omega_radps, ""))
    whole_m, by = ways.room(1.0)
    if whole_m >= 0.0:
        return record(Limited, (v_mps, omega_radps, ""))
    share = _share(ways, whole_m)
    moving = max(abs(wheels_mps[0]), abs(wheels_mps[1])) > REST_MPS
    return record(Limited, (share * v_mps, omega_radps * share if share > 0.0 or moving else omega_radps, by))


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

    def find_lines(self, asked_mps: tuple[float, float], others: list[Neighbour]) -> bool:
        """Whether there are any."""
        bounds = self._bounds
        cut, stop = self._cut, self._stop
        cut_lines, stop_lines = self._cut_lines, self._stop_lines = _walls(cut, bounds), []
        asked_cut, asked_stop = (cut, stop) if asked_mps == self._command else ([], [])
        x, y = self._course[:2]
        for other in others:
            theirs = foresee(other, bounds)
            their_x, their_y, apart_m = theirs.x_m, theirs.y_m, theirs.apart_m
            away_x, away_y = x - their_x, y - their_y
            distance_m = math.hypot(away_x, away_y)
            away_x, away_y = (away_x / distance_m, away_y / distance_m) if distance_m > 0.0 else (1.0, 0.0)
            at_m = their_x * away_x + their_y * away_y
            cut_at_m, stop_at_m = least(cut, away_x, away_y), least(stop, away_x, away_y)
            cut_gap_m = cut_at_m - at_m - apart_m - WIDE_M - PIVOT_M
            stop_gap_m = stop_at_m - at_m - apart_m - WIDE_M - PIVOT_M
            if not (cut_gap_m < theirs.stop_m or stop_gap_m < theirs.cut_m):
                continue
            ahead = theirs.ahead(away_x, away_y)
            if cut_gap_m < theirs.stop_m and cut_gap_m < ahead * theirs.stop_m:
                brakes = theirs.brakes()
                if cut_at_m + least(brakes, -away_x, -away_y) < apart_m + WIDE_M:
                    asked_cut = asked_cut or self._cut_after(*asked_mps)
                    cut_lines.append(_line(asked_cut, brakes, apart_m))
            if stop_gap_m < theirs.cut_m and stop_gap_m < ahead * theirs.cut_m:
                coming = theirs.cut_off()
                if stop_at_m + least(coming, -away_x, -away_y) < apart_m + WIDE_M:
                    asked_stop = asked_stop or self._stop_after(*asked_mps)
                    stop_lines.append(_line(asked_stop, coming, apart_m))
        return bool(cut_lines or stop_lines)

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


def _walls(way: Way, bounds: CutBounds) -> list[Line]:
    """The sides of the floor that a way comes to; a robot beyond one may not go farther."""
    low_x, low_y, high_x, high_y = bounds.brake.fence
    beyond_m = bounds.beyond_fence_m
    least_x, least_y, most_x, most_y = low_x - beyond_m, low_y - beyond_m, high_x + beyond_m, high_y + beyond_m
    for x, y in way:
        if not (least_x <= x <= most_x and least_y <= y <= most_y):
            break
    else:
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
