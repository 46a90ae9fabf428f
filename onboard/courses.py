"""Ways of robots that brake or are cut off. Pure.

A way is a list of points, arena frame, m, on the arcs that the two rims draw, so near to each other that the hull of
the points holds what is between them to within millimetres. The plant is that of :mod:`onboard.limits`; a rim that
speeds up is given the strongest drive, one that slows down the weakest brake.
"""

import math
from typing import Final, NamedTuple

from contract.arena import Arena
from contract.margins import SLACK_S, contact_m
from onboard.hulls import Way
from onboard.limits import Bounds, bounds_of, respond, stop_m

CHORD_RAD: Final = 0.6
"""A chord spans no more of an arc, but where that would take more than ``MOST_CHORDS``."""
MOST_CHORDS: Final = 4
SAME_MPS: Final = 0.04
"""Rim speeds nearer to what is asked of them than that get there alike with any drive."""
STILL_MPS: Final = 0.05
GENTLE_MPS: Final = 0.15
"""A command with less difference of the rims, before and after, is one arc while it stands."""

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
    _, _, _, (weak, strong), (quick, slow), _ = brake
    if abs(command_mps) > abs(speed_mps):
        return respond(speed_mps, command_mps, time_s, strong, quick)
    return respond(speed_mps, command_mps, time_s, weak, slow)


def cut_way(course: Course, left_mps: float, right_mps: float, standing_s: float, bounds: CutBounds) -> Way:
    """That command stands for a time, then both wheels coast to rest: by the weakest drive, then by the strongest."""
    x, y, _, left, right = course
    (_, _, separation_m, (weak, strong), (quick, slow), _), _, coast_mps2, _, _ = bounds
    fresh = abs(left_mps - left) + abs(right_mps - right) > SAME_MPS and standing_s > 0.0
    way = [(x, y)]
    if abs(right - left) + abs(right_mps - left_mps) < GENTLE_MPS:
        _cut_gently(way, course, left_mps, right_mps, standing_s, weak, slow, coast_mps2, separation_m)
        if fresh:
            _cut_gently(way, course, left_mps, right_mps, standing_s, strong, quick, coast_mps2, separation_m)
    else:
        _cut(way, course, left_mps, right_mps, standing_s, weak, slow, coast_mps2, separation_m)
        if fresh:
            _cut(way, course, left_mps, right_mps, standing_s, strong, quick, coast_mps2, separation_m)
    return way


def _cut_gently(
    way: Way,
    course: Course,
    left_mps: float,
    right_mps: float,
    standing_s: float,
    deceleration_mps2: float,
    lag_s: float,
    coast_mps2: float,
    separation_m: float,
) -> None:
    """Add the way of one drive: one arc while the command stands, and one after it if it turns no more than that."""
    x, y, heading, left, right = course
    left_m, left = respond(left, left_mps, standing_s, deceleration_mps2, lag_s)
    right_m, right = respond(right, right_mps, standing_s, deceleration_mps2, lag_s)
    turn, chord_m, speed = (right_m - left_m) / separation_m, (left_m + right_m) / 2, (left + right) / 2
    middle = heading + turn / 2
    x, y = x + chord_m * math.cos(middle), y + chord_m * math.sin(middle)
    way.append((x, y))
    later = (right - left) * abs(speed) / (coast_mps2 * separation_m)
    heading += turn
    if -CHORD_RAD < later < CHORD_RAD:
        chord_m = speed * abs(speed) / (2.0 * coast_mps2)
        heading += later / 3.0
        way.append((x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)))
    else:
        _slow(way, x, y, heading, left, right, coast_mps2, separation_m)


def _cut(
    way: Way,
    course: Course,
    left_mps: float,
    right_mps: float,
    standing_s: float,
    deceleration_mps2: float,
    lag_s: float,
    coast_mps2: float,
    separation_m: float,
) -> None:
    """Add the way of one drive: two arcs while the command stands, and those after it."""
    x, y, heading, left, right = course
    if standing_s > 0.0:
        half_s, knee = standing_s / 2, deceleration_mps2 * lag_s
        left_error, right_error = left - left_mps, right - right_mps
        if -knee <= left_error <= knee and -knee <= right_error <= knee and lag_s > 0.0:
            decay = math.exp(-half_s / lag_s)
            caught_s, left_asked_m, right_asked_m = lag_s * (1 - decay), left_mps * half_s, right_mps * half_s
            left_m, right_m = left_asked_m + left_error * caught_s, right_asked_m + right_error * caught_s
            left_error, right_error = left_error * decay, right_error * decay
            left_later_m, right_later_m = left_asked_m + left_error * caught_s, right_asked_m + right_error * caught_s
            left, right = left_mps + left_error * decay, right_mps + right_error * decay
        else:
            left_m, left_later_m, left = _halves(left, left_mps, half_s, deceleration_mps2, lag_s)
            right_m, right_later_m, right = _halves(right, right_mps, half_s, deceleration_mps2, lag_s)
        x, y, heading = _roll(way, x, y, heading, left_m, right_m, separation_m)
        x, y, heading = _roll(way, x, y, heading, left_later_m, right_later_m, separation_m)
    _slow(way, x, y, heading, left, right, coast_mps2, separation_m)


def _halves(
    speed_mps: float, command_mps: float, half_s: float, deceleration_mps2: float, lag_s: float
) -> tuple[float, float, float]:
    """Ways, m, of one rim in two equal times, and its speed after them."""
    error, knee = speed_mps - command_mps, deceleration_mps2 * lag_s
    if -knee <= error <= knee and lag_s > 0.0:
        decay, asked_m = math.exp(-half_s / lag_s), command_mps * half_s
        caught_s, error_later = lag_s * (1 - decay), error * decay
        return asked_m + error * caught_s, asked_m + error_later * caught_s, command_mps + error_later * decay
    first_m, speed_mps = respond(speed_mps, command_mps, half_s, deceleration_mps2, lag_s)
    later_m, speed_mps = respond(speed_mps, command_mps, half_s, deceleration_mps2, lag_s)
    return first_m, later_m, speed_mps


def brake_way(course: Course, left_mps: float, right_mps: float, time_s: float, brake: Bounds) -> Way:
    """That command stands for a time, then both wheels brake as weakly as they may."""
    x, y, heading, left, right = course
    _, _, separation_m, (weak, _), (_, slow), _ = brake
    way = [(x, y)]
    left_m, left = rim_after(left, left_mps, time_s, brake)
    right_m, right = rim_after(right, right_mps, time_s, brake)
    if abs(right - left) + abs(right_mps - left_mps) < GENTLE_MPS and left * right >= 0.0:
        speed = (left + right) / 2
        chord_m = (left_m + right_m) / 2 + math.copysign(stop_m(abs(speed), weak, slow), speed)
        heading += (right - left) / separation_m * abs(chord_m / speed) * 0.4 if speed else 0.0
        way.append((x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)))
        return way
    x, y, heading = _roll(way, x, y, heading, left_m, right_m, separation_m)
    fastest = max(abs(left), abs(right))
    if fastest > STILL_MPS:
        rate_mps2 = fastest * fastest / (2.0 * stop_m(fastest, weak, slow))
        _slow(way, x, y, heading, left, right, rate_mps2, separation_m)
    return way


def _slow(
    way: Way, x: float, y: float, heading: float, left: float, right: float, rate_mps2: float, separation_m: float
) -> None:
    """Add the way on which both rims lose that much speed a second; the turn lasts until the slower one stands."""
    slower, faster = abs(left), abs(right)
    if faster < slower:
        slower, faster = faster, slower
    both_s = slower / rate_mps2
    if both_s > 0.01:
        less = rate_mps2 * both_s
        less_left, less_right = less if left > 0.0 else -less, less if right > 0.0 else -less
        turn = (right - left - (less_right - less_left) / 2) * both_s / separation_m
        begins = (left + right) / 2
        if -CHORD_RAD < turn < CHORD_RAD:
            ends = begins - (less_left + less_right) / 2
            both = begins + ends
            straight = both_s / 2 * (1.0 - turn * turn / 24.0)
            early = heading + turn * (begins + ends + ends) / (3.0 * both) if both else heading
            x, y = x + both * straight * math.cos(early), y + both * straight * math.sin(early)
            way.append((x, y))
            heading += turn
        else:
            chords = 1 + int(abs(turn) / CHORD_RAD)
            if chords > MOST_CHORDS:
                chords = MOST_CHORDS
            less = (less_left + less_right) / (2 * chords)
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
        _roll(way, x, y, heading, left_m, right_m, separation_m)


def _roll(
    way: Way, x: float, y: float, heading: float, left_m: float, right_m: float, separation_m: float
) -> tuple[float, float, float]:
    """Add an arc's points to a way; where it ends."""
    turn, chord_m = (right_m - left_m) / separation_m, (left_m + right_m) / 2
    if -0.01 < turn < 0.01:
        x, y = x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)
        way.append((x, y))
        return x, y, heading + turn
    if -CHORD_RAD < turn < CHORD_RAD:
        half = turn / 2
        chord_m *= math.sin(half) / half
        heading += half
        x, y = x + chord_m * math.cos(heading), y + chord_m * math.sin(heading)
        way.append((x, y))
        return x, y, heading + half
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
