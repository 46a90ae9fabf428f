"""A robot cut off: its last command stands until the device watchdog lets go, then it coasts. Pure.

Nothing commands such a robot, so the distance it still rolls must have been there before:

    C(v, c) = way under command c for T + u^2 / (2 k)

with ``T`` = ``safety.watchdog_s`` and the slack of one command, ``u`` the speed after T and ``k``
``platform.coast_deceleration_mps2``. From 0.8 m/s with 0.2 s and 0.6 m/s^2 that is 0.71 m, where a brake takes 0.22 m.

One robot fails at a time; the others brake. For two robots with gap ``g`` that needs, whoever fails,
``C_i + S_j <= g`` and ``S_i + C_j <= g`` (``S``: braking, :mod:`onboard.limits`). As there, each robot uses at most
half of what is left of either. A neighbour that has been silent for longer than T is taken to be coasting.

The way of a cut robot is the straight lines from where it is, in the directions its command may still turn it to: what
these lines miss is not in the way.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from contract.arena import Arena
from contract.margins import SLACK_S, contact_m
from onboard.limits import REST_MPS, Bounds, Limited, bounds_of, respond, roll_m, stop_m

HALVINGS = 8
MAX_AGE_S = 0.5


class CutBounds(NamedTuple):
    """What the rule needs to know of the arena, once."""

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

    def roll_m(self, speed_mps: float, command_mps: float) -> float:
        """C(v, c) of one rim, m; neither is negative."""
        low, high = self.brake.deceleration_mps2
        quick, slow = self.brake.lag_s
        plant = (high, quick) if command_mps > speed_mps else (low, slow)
        way_m, after_mps = respond(speed_mps, command_mps, self.standing_s, *plant)
        return way_m + self.coast_m(after_mps)


class Other(NamedTuple):
    """Another robot as last seen, and since when it says nothing."""

    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float
    age_s: float
    """Of the pose."""
    silence_s: float
    """Age of its newest message; 0 where it has never spoken."""


def cut_bounds(arena: Arena) -> CutBounds:
    """The rule's constants of an arena file."""
    return CutBounds(
        brake=bounds_of(arena),
        standing_s=arena.safety.watchdog_s + SLACK_S,
        coast_mps2=arena.platform.coast_deceleration_mps2,
        contact_m=contact_m(arena),
        beyond_fence_m=max(0.0, arena.arena.fence_m - arena.platform.diameter_m / 2),
    )


def limit_cut(
    v_mps: float,
    omega_radps: float,
    pose: tuple[float, float, float],
    wheels_mps: tuple[float, float],
    others: Sequence[Other],
    bounds: CutBounds,
) -> Limited:
    """The largest share of a velocity, curve kept, from which a cut robot reaches nobody and no edge.

    :param pose: own x m, y m, heading rad, dead-reckoned to now.
    :param wheels_mps: measured rim speeds, left and right.
    """
    if v_mps == 0.0:
        return Limited(v_mps, omega_radps, "")
    course = _Course(v_mps, omega_radps, pose, wheels_mps, bounds)
    share, by = 1.0, ""
    for room_m, braking, name in _rooms(course, others):
        if course.rolled_m(1.0, braking) > room_m and (part := course.share(max(0.0, room_m), braking)) < share:
            share, by = part, name
    if not by:
        return Limited(v_mps, omega_radps, "")
    moving = max(abs(wheels_mps[0]), abs(wheels_mps[1])) > REST_MPS
    return Limited(share * v_mps, omega_radps * share if share > 0.0 or moving else omega_radps, by)


class _Course:
    """Where a robot that is cut right after this command may get to."""

    def __init__(
        self,
        v_mps: float,
        omega_radps: float,
        pose: tuple[float, float, float],
        wheels_mps: tuple[float, float],
        bounds: CutBounds,
    ) -> None:
        sign = 1.0 if v_mps > 0 else -1.0
        half_m = bounds.brake.separation_m / 2
        self.bounds, self.pose = bounds, pose
        self.heading_rad = pose[2] if sign > 0 else pose[2] + math.pi
        commands = (v_mps - half_m * omega_radps, v_mps + half_m * omega_radps)
        self._commands = tuple(max(0.0, sign * command) for command in commands)
        self._speeds = tuple(max(0.0, sign * speed) for speed in wheels_mps)
        self.committed_m = sum(bounds.roll_m(speed, speed) for speed in self._speeds) / 2
        weak = bounds.brake.deceleration_mps2[0], bounds.brake.lag_s[1]
        self.braking_m = sum(stop_m(speed, *weak) for speed in self._speeds) / 2
        self.most_m = self.rolled_m(1.0, False)
        turn = _turn_rad(sign * commands[0], sign * commands[1], half_m, bounds) / 2 * sign
        lasting = (wheels_mps[1] - wheels_mps[0]) / (2 * half_m) * bounds.brake.lag_s[1]
        self.left_rad = max(0.0, turn) + max(0.0, lasting)
        self.right_rad = max(0.0, -turn) + max(0.0, -lasting)

    def off_rad(self, away_x: float, away_y: float) -> float:
        """Angle between that direction and the nearest one the robot may take."""
        off = math.remainder(math.atan2(away_y, away_x) - self.heading_rad, math.tau)
        return max(0.0, off - self.left_rad) if off >= 0.0 else max(0.0, -off - self.right_rad)

    def share(self, room_m: float, braking: bool) -> float:
        """Largest f in [0, 1] such that f times the command, then cut or brake, rolls at most that far."""
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            if self.rolled_m(middle, braking) <= room_m:
                low = middle
            else:
                high = middle
        return low

    def rolled_m(self, share: float, braking: bool) -> float:
        """Way after that share of the command, followed by a brake or a cut."""
        pairs = zip(self._speeds, self._commands, strict=True)
        if braking:
            return sum(roll_m(speed, share * command, self.bounds.brake) for speed, command in pairs) / 2
        return sum(self.bounds.roll_m(speed, share * command) for speed, command in pairs) / 2


def _turn_rad(left_mps: float, right_mps: float, half_m: float, bounds: CutBounds) -> float:
    """Angle turned to the left by these rim speeds: kept for T, then both wheels coast to rest."""
    coasted_m = [math.copysign(bounds.coast_m(speed), speed) for speed in (left_mps, right_mps)]
    return ((right_mps - left_mps) * bounds.standing_s + coasted_m[1] - coasted_m[0]) / (2 * half_m)


def _rooms(course: _Course, others: Sequence[Other]) -> list[tuple[float, bool, str]]:
    """(how far this robot may roll, m, braking or else cut, what is there) of everything in the way."""
    bounds, (x, y, _) = course.bounds, course.pose
    low_x, low_y, high_x, high_y = bounds.brake.fence
    found: list[tuple[float, bool, str]] = []
    for away, gap_m in (
        ((-1.0, 0.0), x - low_x),
        ((0.0, -1.0), y - low_y),
        ((1.0, 0.0), high_x - x),
        ((0.0, 1.0), high_y - y),
    ):
        gap_m += bounds.beyond_fence_m
        if gap_m < course.most_m and (off := course.off_rad(*away)) < math.pi / 2:
            found.append((max(0.0, gap_m) / max(1e-9, math.cos(off)), False, "fence"))
    for other in others:
        found += _rooms_before(course, other)
    return found


def _share_m(left_m: float, committed_m: float) -> float:
    """Half of what is left beyond the way already committed to; all that is left where that is less."""
    return min(left_m, (left_m + committed_m) / 2)


def _rooms_before(course: _Course, other: Other) -> list[tuple[float, bool, str]]:
    """The same before one other robot: cut while it brakes, and braking while it is cut."""
    bounds = course.bounds
    strong = bounds.brake.deceleration_mps2[1], bounds.brake.lag_s[0]
    weak = bounds.brake.deceleration_mps2[0], bounds.brake.lag_s[1]
    away_x, away_y = other.x_m - course.pose[0], other.y_m - course.pose[1]
    distance_m = math.hypot(away_x, away_y)
    speed = math.hypot(other.vx_mps, other.vy_mps)
    age_s = min(max(other.age_s, 0.0), MAX_AGE_S)
    closing = -(other.vx_mps * away_x + other.vy_mps * away_y) / distance_m if distance_m > 0.0 else speed
    silent = other.silence_s > bounds.standing_s
    cut_m = bounds.coast_m(speed) + (0.0 if silent else speed * bounds.standing_s)
    if distance_m - bounds.contact_m - cut_m - speed * age_s >= 2.0 * course.most_m:
        return []
    off = course.off_rad(away_x, away_y)
    if off >= math.pi / 2:
        return []
    lateral_m, touching_m = distance_m * math.sin(off), bounds.contact_m
    touch_m = distance_m * math.cos(off) - math.sqrt(max(0.0, touching_m * touching_m - lateral_m * lateral_m))
    gap_m = touch_m - max(0.0, closing) * age_s
    found: list[tuple[float, bool, str]] = []
    if not silent and lateral_m < touching_m + stop_m(speed, *weak) + speed * age_s:
        stopping_m = stop_m(closing, *weak) if closing > 0.0 else -stop_m(-closing, *strong)
        found.append((_share_m(gap_m - stopping_m, course.committed_m), False, "separation"))
    miss_m = math.sqrt(max(0.0, speed * speed - closing * closing)) / speed * distance_m if speed > 0.0 else 0.0
    if closing > REST_MPS and miss_m < touching_m + course.braking_m:
        coming_m = bounds.coast_m(closing) + (0.0 if silent else closing * bounds.standing_s)
        found.append((_share_m(gap_m - coming_m, course.braking_m), True, "separation"))
    return found
