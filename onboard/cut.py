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
from onboard.limits import REST_MPS, Bounds, Limited, Neighbour, bounds_of, respond, roll_m, stop_m

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
    others: Sequence[Neighbour],
    bounds: CutBounds,
) -> Limited:
    """The largest share of a velocity, curve kept, from which a cut robot reaches nobody and no edge.

    :param pose: own x m, y m, heading rad, dead-reckoned to now.
    :param wheels_mps: measured rim speeds, left and right.
    """
    if v_mps == 0.0:
        return Limited(v_mps, omega_radps, "")
    course = _Course(v_mps, omega_radps, wheels_mps, bounds)
    x, y, heading_rad = pose
    walls = _walls(x, y, course.most_m, bounds)
    near = _near(x, y, course.most_m, others, bounds)
    if not (walls or near):
        return Limited(v_mps, omega_radps, "")
    course.aim(heading_rad)
    share, by = 1.0, ""
    for room_m, braking, name in _rooms(course, walls, near):
        if share > 0.0 and course.rolled_m(share, braking) > room_m:
            share, by = course.share(room_m, braking), name
    if not by:
        return Limited(v_mps, omega_radps, "")
    moving = max(abs(wheels_mps[0]), abs(wheels_mps[1])) > REST_MPS
    return Limited(share * v_mps, omega_radps * share if share > 0.0 or moving else omega_radps, by)


class _Course:
    """Where a robot that is cut right after this command may get to."""

    def __init__(self, v_mps: float, omega_radps: float, wheels_mps: tuple[float, float], bounds: CutBounds) -> None:
        half_m = bounds.brake.separation_m / 2
        left, right = wheels_mps
        left_to, right_to = v_mps - half_m * omega_radps, v_mps + half_m * omega_radps
        self._turning = (left_to, right_to, right - left)
        self._backwards = v_mps < 0.0
        if self._backwards:
            left, right, left_to, right_to = -left, -right, -left_to, -right_to
        self.bounds = bounds
        self._wheels = (
            (left if left > 0.0 else 0.0, left_to if left_to > 0.0 else 0.0),
            (right if right > 0.0 else 0.0, right_to if right_to > 0.0 else 0.0),
        )
        """Measured and asked rim speed along the way, left and right."""
        self.most_m = self.rolled_m(1.0, False)

    def aim(self, heading_rad: float) -> None:
        """What is only needed with something near: directions, and the ways it is already committed to."""
        bounds, (left_to, right_to, difference) = self.bounds, self._turning
        weak_mps2, slow_s = bounds.brake.deceleration_mps2[0], bounds.brake.lag_s[1]
        (left, _), (right, _) = self._wheels
        self.heading_rad = heading_rad + math.pi if self._backwards else heading_rad
        self.committed_m = (
            left * bounds.standing_s + bounds.coast_m(left) + right * bounds.standing_s + bounds.coast_m(right)
        ) / 2
        self.braking_m = (stop_m(left, weak_mps2, slow_s) + stop_m(right, weak_mps2, slow_s)) / 2
        separation_m = bounds.brake.separation_m
        turn = _turn_rad(left_to, right_to, bounds) / 2
        lasting = difference / separation_m * slow_s
        self._left_rad = max(0.0, turn) + max(0.0, lasting)
        self._right_rad = max(0.0, -turn) + max(0.0, -lasting)

    def off_rad(self, away_x: float, away_y: float) -> float:
        """Angle between that direction and the nearest one the robot may take."""
        off = math.remainder(math.atan2(away_y, away_x) - self.heading_rad, math.tau)
        off = off - self._left_rad if off >= 0.0 else -off - self._right_rad
        return off if off > 0.0 else 0.0

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
        (left, left_to), (right, right_to) = self._wheels
        if braking:
            brake = self.bounds.brake
            return (roll_m(left, share * left_to, brake) + roll_m(right, share * right_to, brake)) / 2
        roll = self.bounds.roll_m
        return (roll(left, share * left_to) + roll(right, share * right_to)) / 2


def _turn_rad(left_mps: float, right_mps: float, bounds: CutBounds) -> float:
    """Angle turned to the left by these rim speeds: kept for T, then both wheels coast to rest."""
    left_m = math.copysign(bounds.coast_m(left_mps), left_mps)
    right_m = math.copysign(bounds.coast_m(right_mps), right_mps)
    return ((right_mps - left_mps) * bounds.standing_s + right_m - left_m) / bounds.brake.separation_m


Wall = tuple[float, float, float]
"""Direction x and y, and the gap to the edge of the floor, m."""

Near = tuple[float, float, float, float, float, float, bool]
"""Way to it x and y, m; distance m; its speed and how fast it comes nearer, m/s; age of its pose, s; it is silent."""

Found = tuple[float, bool, str]
"""How far this robot may roll, m, braking or else cut, and what is there."""


def _walls(x: float, y: float, most_m: float, bounds: CutBounds) -> list[Wall]:
    """The sides of the floor within reach."""
    low_x, low_y, high_x, high_y = bounds.brake.fence
    reach_m = most_m - bounds.beyond_fence_m
    if x - low_x >= reach_m and y - low_y >= reach_m and high_x - x >= reach_m and high_y - y >= reach_m:
        return []
    sides = ((-1.0, 0.0, x - low_x), (0.0, -1.0, y - low_y), (1.0, 0.0, high_x - x), (0.0, 1.0, high_y - y))
    return [(away_x, away_y, gap_m + bounds.beyond_fence_m) for away_x, away_y, gap_m in sides if gap_m < reach_m]


def _near(x: float, y: float, most_m: float, others: Sequence[Neighbour], bounds: CutBounds) -> list[Near]:
    """The other robots that may be met."""
    _, standing_s, coast_mps2, touching_m, _ = bounds
    near: list[Near] = []
    for other_x, other_y, vx, vy, age_s, silence_s in others:
        away_x, away_y = other_x - x, other_y - y
        distance_m = math.hypot(away_x, away_y)
        speed = math.hypot(vx, vy)
        if not age_s > 0.0:
            age_s = 0.0
        elif age_s > MAX_AGE_S:
            age_s = MAX_AGE_S
        silent = silence_s > standing_s
        cut_m = speed * speed / (2.0 * coast_mps2) + (0.0 if silent else speed * standing_s)
        if distance_m - touching_m - cut_m - speed * age_s < 2.0 * most_m:
            closing = -(vx * away_x + vy * away_y) / distance_m if distance_m > 0.0 else speed
            near.append((away_x, away_y, distance_m, speed, closing, age_s, silent))
    return near


def _rooms(course: _Course, walls: list[Wall], near: list[Near]) -> list[Found]:
    """What is in the way."""
    found: list[Found] = []
    for away_x, away_y, gap_m in walls:
        off = course.off_rad(away_x, away_y)
        if off < math.pi / 2:
            found.append((max(0.0, gap_m) / max(1e-9, math.cos(off)), False, "fence"))
    for other in near:
        off = course.off_rad(other[0], other[1])
        if off < math.pi / 2:
            _rooms_before(course, other, off, found)
    return found


def _rooms_before(course: _Course, other: Near, off_rad: float, found: list[Found]) -> None:
    """Before one other robot: cut while it brakes, and braking while it is cut."""
    bounds = course.bounds
    (weak_mps2, strong_mps2), (quick_s, slow_s) = bounds.brake.deceleration_mps2, bounds.brake.lag_s
    _, _, distance_m, speed, closing, age_s, silent = other
    lateral_m, touching_m = distance_m * math.sin(off_rad), bounds.contact_m
    touch_m = distance_m * math.cos(off_rad) - math.sqrt(max(0.0, touching_m * touching_m - lateral_m * lateral_m))
    gap_m = touch_m - max(0.0, closing) * age_s
    if not silent and lateral_m < touching_m + stop_m(speed, weak_mps2, slow_s) + speed * age_s:
        stopping_m = stop_m(closing, weak_mps2, slow_s) if closing > 0.0 else -stop_m(-closing, strong_mps2, quick_s)
        found.append((_share_m(gap_m - stopping_m, course.committed_m), False, "separation"))
    if closing > REST_MPS:
        miss_m = math.sqrt(max(0.0, speed * speed - closing * closing)) / speed * distance_m
        if miss_m < touching_m + course.braking_m:
            coming_m = bounds.coast_m(closing) + (0.0 if silent else closing * bounds.standing_s)
            found.append((_share_m(gap_m - coming_m, course.braking_m), True, "separation"))


def _share_m(left_m: float, committed_m: float) -> float:
    """Half of what is left beyond the way already committed to; all that is left where that is less; never negative."""
    share_m = (left_m + committed_m) / 2
    if left_m < share_m:
        share_m = left_m
    return share_m if share_m > 0.0 else 0.0
