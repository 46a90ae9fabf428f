"""Ways of robots that brake or are cut off, and the line that keeps two of them apart. Pure.

A way is a list of points, arena frame, m, on the arcs that the two rims draw, so near to each other that the hull of
the points holds what is between them to within millimetres. The plant is that of :mod:`onboard.limits`; a rim that
speeds up is given the strongest drive, one that slows down the weakest brake.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from contract.arena import Arena
from contract.margins import SLACK_S, contact_m
from onboard.limits import Bounds, bounds_of, respond, stop_m

CHORD_RAD = 0.6
"""A chord spans no more of an arc, but where that would take more than ``MOST_CHORDS``."""
MOST_CHORDS = 4
SAME_MPS = 0.04
"""Rim speeds nearer to what is asked of them than that get there alike with any drive."""
STILL_MPS = 0.05
GENTLE_MPS = 0.15
"""A command with less difference of the rims, before and after, is one arc while it stands."""
ROUNDS = 10
"""Of the search for the nearest points of two hulls; three or four are usual."""
TOLERANCE = 2e-3
MEETING_M2 = 1e-8

Point = tuple[float, float]
Way = list[Point]
Course = tuple[float, float, float, float, float]
"""x m, y m, heading rad, left and right rim speed, m/s."""


class CutBounds(NamedTuple):
    """What ways and the rule for robots cut off need to know of the arena, once."""

    brake: Bounds
    standing_s: float
    """T: the last command stands this long."""
    coast_mps2: float
    contact_m: float
    """Centre distance at which two robots touch, and what the poses may be wrong by."""
    beyond_fence_m: float
    """Between the fence and the place where a robot's rim meets the edge of the floor."""

    def coast_m(self, speed_mps: float) -> float:
        return speed_mps * speed_mps / (2.0 * self.coast_mps2)


def cut_bounds(arena: Arena) -> CutBounds:
    """The constants of an arena file."""
    return CutBounds(
        brake=bounds_of(arena),
        standing_s=arena.safety.watchdog_s + SLACK_S,
        coast_mps2=arena.platform.coast_deceleration_mps2,
        contact_m=contact_m(arena),
        beyond_fence_m=max(0.0, arena.arena.fence_m - arena.platform.diameter_m / 2),
    )


def rim_after(speed_mps: float, command_mps: float, time_s: float, brake: Bounds) -> tuple[float, float]:
    """(way m, speed m/s) of one rim after that command has stood for a time."""
    if speed_mps == command_mps:
        return speed_mps * time_s, speed_mps
    (weak, strong), (quick, slow) = brake.deceleration_mps2, brake.lag_s
    if abs(command_mps) > abs(speed_mps):
        return respond(speed_mps, command_mps, time_s, strong, quick)
    return respond(speed_mps, command_mps, time_s, weak, slow)


def cut_way(course: Course, left_mps: float, right_mps: float, standing_s: float, bounds: CutBounds) -> Way:
    """That command stands for a time, then both wheels coast to rest: by the weakest drive, then by the strongest."""
    x, y, _, left, right = course
    (weak, strong), (quick, slow) = bounds.brake.deceleration_mps2, bounds.brake.lag_s
    way = [(x, y)]
    _cut(way, course, left_mps, right_mps, standing_s, (weak, slow), bounds)
    if abs(left_mps - left) + abs(right_mps - right) > SAME_MPS and standing_s > 0.0:
        _cut(way, course, left_mps, right_mps, standing_s, (strong, quick), bounds)
    return way


def _cut(
    way: Way,
    course: Course,
    left_mps: float,
    right_mps: float,
    standing_s: float,
    plant: tuple[float, float],
    bounds: CutBounds,
) -> None:
    """Add the way of one plant (deceleration, lag)."""
    x, y, heading, left, right = course
    coast, separation_m = bounds.coast_mps2, bounds.brake.separation_m
    at = (x, y, heading)
    if abs(right - left) + abs(right_mps - left_mps) < GENTLE_MPS:
        left_m, left = respond(left, left_mps, standing_s, *plant)
        right_m, right = respond(right, right_mps, standing_s, *plant)
        turn, chord_m, speed = (right_m - left_m) / separation_m, (left_m + right_m) / 2, (left + right) / 2
        x, y = x + chord_m * math.cos(heading + turn / 2), y + chord_m * math.sin(heading + turn / 2)
        way.append((x, y))
        later = (right - left) * abs(speed) / (coast * separation_m)
        heading += turn
        if -CHORD_RAD < later < CHORD_RAD:
            chord_m = speed * abs(speed) / (2.0 * coast)
            heading += later / 3.0
            way.append((x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)))
            return
        at = (x, y, heading)
    elif standing_s > 0.0:
        half_s = standing_s / 2
        left_m, left_later_m, left = _halves(left, left_mps, half_s, plant)
        right_m, right_later_m, right = _halves(right, right_mps, half_s, plant)
        at = _roll(way, at, left_m, right_m, separation_m)
        at = _roll(way, at, left_later_m, right_later_m, separation_m)
    _slow(way, at, left, right, coast, separation_m)


def _halves(speed_mps: float, command_mps: float, half_s: float, plant: tuple[float, float]) -> tuple[float, ...]:
    """Ways, m, of one rim in two equal times, and its speed after them."""
    deceleration, lag_s = plant
    error, knee = speed_mps - command_mps, deceleration * lag_s
    if -knee <= error <= knee and lag_s > 0.0:
        decay, asked_m = math.exp(-half_s / lag_s), command_mps * half_s
        caught_m, error_later = lag_s * (1 - decay), error * decay
        return asked_m + error * caught_m, asked_m + error_later * caught_m, command_mps + error_later * decay
    first_m, speed_mps = respond(speed_mps, command_mps, half_s, deceleration, lag_s)
    later_m, speed_mps = respond(speed_mps, command_mps, half_s, deceleration, lag_s)
    return first_m, later_m, speed_mps


def brake_way(course: Course, left_mps: float, right_mps: float, time_s: float, brake: Bounds) -> Way:
    """That command stands for a time, then both wheels brake as weakly as they may."""
    x, y, heading, left, right = course
    weak, slow = brake.deceleration_mps2[0], brake.lag_s[1]
    way = [(x, y)]
    left_m, left = rim_after(left, left_mps, time_s, brake)
    right_m, right = rim_after(right, right_mps, time_s, brake)
    if abs(right - left) + abs(right_mps - left_mps) < GENTLE_MPS and left * right >= 0.0:
        speed = (left + right) / 2
        chord_m = (left_m + right_m) / 2 + math.copysign(stop_m(abs(speed), weak, slow), speed)
        heading += (right - left) / brake.separation_m * abs(chord_m / speed) * 0.4 if speed else 0.0
        way.append((x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)))
        return way
    at = _roll(way, (x, y, heading), left_m, right_m, brake.separation_m)
    fastest = max(abs(left), abs(right))
    if fastest > STILL_MPS:
        rate = fastest * fastest / (2.0 * stop_m(fastest, weak, slow))
        _slow(way, at, left, right, rate, brake.separation_m)
    return way


def _slow(
    way: Way, at: tuple[float, float, float], left: float, right: float, rate_mps2: float, separation_m: float
) -> None:
    """Add the way on which both rims lose that much speed a second; the turn lasts until the slower one stands."""
    x, y, heading = at
    both_s = min(abs(left), abs(right)) / rate_mps2
    if both_s > 0.01:
        less_left, less_right = math.copysign(rate_mps2 * both_s, left), math.copysign(rate_mps2 * both_s, right)
        turn = (right - left - (less_right - less_left) / 2) * both_s / separation_m
        chords = 1 + int(abs(turn) / CHORD_RAD)
        if chords > MOST_CHORDS:
            chords = MOST_CHORDS
        begins, less = (left + right) / 2, (less_left + less_right) / (2 * chords)
        turn /= chords
        straight = both_s / (2 * chords) * (1.0 - turn * turn / 24.0)
        for _ in range(chords):
            ends = begins - less
            both = begins + ends
            early = heading + turn * (begins + ends + ends) / (3.0 * both) if both else heading
            x, y = x + both * straight * math.cos(early), y + both * straight * math.sin(early)
            way.append((x, y))
            heading += turn
            begins = ends
        left, right = left - less_left, right - less_right
    if abs(left) + abs(right) > STILL_MPS:
        left_m, right_m = left * abs(left) / (2.0 * rate_mps2), right * abs(right) / (2.0 * rate_mps2)
        _roll(way, (x, y, heading), left_m, right_m, separation_m)


def _roll(
    way: Way, at: tuple[float, float, float], left_m: float, right_m: float, separation_m: float
) -> tuple[float, float, float]:
    """Add an arc's points to a way; where it ends."""
    x, y, heading = at
    turn, chord_m = (right_m - left_m) / separation_m, (left_m + right_m) / 2
    if -0.01 < turn < 0.01:
        x, y = x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)
        way.append((x, y))
        return x, y, heading + turn
    chords = 1 + int(abs(turn) / CHORD_RAD)
    if chords > MOST_CHORDS:
        chords = MOST_CHORDS
    half = turn / (2 * chords)
    chord_m *= math.sin(half) / (half * chords)
    for _ in range(chords):
        heading += half
        x, y = x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)
        way.append((x, y))
        heading += half
    return x, y, heading


def least(way: Sequence[Point], away_x: float, away_y: float) -> float:
    """How far along that direction the rearmost point of a way is, m."""
    found = math.inf
    for x, y in way:
        along = x * away_x + y * away_y
        if along < found:
            found = along
    return found


def nearest(mine: Way, theirs: Way) -> tuple[float, float, float, float] | None:
    """The direction from the hull of ``theirs`` to that of ``mine`` in which they are farthest apart.

    :return: its x and y, how far along it mine begins and theirs ends, m; None where the hulls meet.
    """
    x, y = last_x, last_y = mine[0][0] - theirs[0][0], mine[0][1] - theirs[0][1]
    kept: Point | None = None
    for _ in range(ROUNDS):
        square = x * x + y * y
        if square < MEETING_M2:
            return None
        begins, ends = math.inf, -math.inf
        for point in mine:
            along = point[0] * x + point[1] * y
            if along < begins:
                begins, first = along, point
        for point in theirs:
            along = point[0] * x + point[1] * y
            if along > ends:
                ends, last = along, point
        if square - (begins - ends) <= TOLERANCE * square:
            return _scaled(x, y, begins, ends)
        corner_x, corner_y = first[0] - last[0], first[1] - last[1]
        x, y = _towards(corner_x, corner_y, last_x, last_y)
        if kept is not None:
            if _holds_origin(kept, (last_x, last_y), (corner_x, corner_y)):
                return None
            other_x, other_y = _towards(corner_x, corner_y, *kept)
            if other_x * other_x + other_y * other_y <= x * x + y * y:
                x, y = other_x, other_y
                last_x, last_y = kept
        kept = (last_x, last_y)
        last_x, last_y = corner_x, corner_y
    return _scaled(x, y, least(mine, x, y), -least(theirs, -x, -y))


def _scaled(x: float, y: float, begins: float, ends: float) -> tuple[float, float, float, float]:
    length = math.sqrt(x * x + y * y)
    return x / length, y / length, begins / length, ends / length


def _towards(corner_x: float, corner_y: float, other_x: float, other_y: float) -> Point:
    """The point between two that is nearest to the origin."""
    edge_x, edge_y = corner_x - other_x, corner_y - other_y
    square = edge_x * edge_x + edge_y * edge_y
    share = -(other_x * edge_x + other_y * edge_y) / square if square > 0.0 else 0.0
    if share <= 0.0:
        return other_x, other_y
    if share >= 1.0:
        return other_x + edge_x, other_y + edge_y
    return other_x + share * edge_x, other_y + share * edge_y


def _holds_origin(a: Point, b: Point, c: Point) -> bool:
    """Whether the triangle does."""
    ab = a[0] * b[1] - a[1] * b[0]
    bc = b[0] * c[1] - b[1] * c[0]
    ca = c[0] * a[1] - c[1] * a[0]
    return (ab > 0.0 and bc > 0.0 and ca > 0.0) or (ab < 0.0 and bc < 0.0 and ca < 0.0)
