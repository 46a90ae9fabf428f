"""Limits on *any* law's velocity: the fence and the distance to other robots. Pure.

Plant: each wheel rim obeys ``dv/dt = clip((command - v) / L, -a, a)``. From rim speed v with
command zero it falls at ``a`` until ``v = a L`` and then decays exponentially, so it rolls

    S(v) = v L                                     for v <= a L
    S(v) = (v^2 - (a L)^2) / (2 a) + a L^2         for v >  a L

which grows with L and falls with a: the weakest calibrated brake is (a_lo, L_hi). A command c kept
for the reaction time T and followed by zero rolls at most ``D(v, c)``, see :func:`roll_m`.

Share. With ``g`` the gap to a neighbour (distance less ``min_distance_m`` and what it may have
done since it was seen), ``S_i`` and ``S_j`` the stopping distances of both towards each other, each
robot may lengthen its own stop by half of what is left: ``D_i <= (g + S_i - S_j) / 2``. If both do
so, ``D_i + D_j <= g``. A wall does not move: ``D <= g``.

A limit shrinks the velocity, never reverses or enlarges it; motion away passes; zero passes.
"""

import math
from typing import Final, NamedTuple

from contract.arena import Arena
from onboard.record import record

REST_MPS: Final = 0.02
REACTION_S: Final = 0.04
"""From one command to the next that can correct it: a control period, a lost frame, the bus."""
MAX_AGE_S: Final = 0.5
"""Older neighbours are taken to have come to rest within what this age allows."""


class Bounds(NamedTuple):
    """What the limits need to know of the arena, once."""

    fence: tuple[float, float, float, float]
    """x low, y low, x high, y high, m: the centre stays inside."""
    min_distance_m: float
    separation_m: float
    """Between the wheels."""
    deceleration_mps2: tuple[float, float]
    """Calibrated brake interval, low and high."""
    lag_s: tuple[float, float]
    reaction_s: float = REACTION_S


Place = tuple[float, float, float]
"""x m, y m, heading rad."""
RimSpeeds = tuple[float, float]
"""Speeds of the left and the right rim, m/s."""


class Told:
    """What another robot's newest message says of its motion, at one moment."""

    __slots__ = ("asked", "place", "rims")

    def __init__(self, place: Place, rims: RimSpeeds, asked: RimSpeeds) -> None:
        """
        :param place: for the time it was sent.
        :param rims: measured.
        :param asked: commanded.
        """
        self.place = place
        self.rims = rims
        self.asked = asked


class Neighbour(NamedTuple):
    """Another robot as last seen."""

    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float
    age_s: float
    """Of the pose."""
    silence_s: float = 0.0
    """Age of its newest message; 0 where it has never spoken."""
    told: Told | None = None
    """That message."""


class Limited(NamedTuple):
    v_mps: float
    omega_radps: float
    by: str
    """'' for unlimited, else 'fence', 'separation' or 'not finite'."""


def bounds_of(arena: Arena) -> Bounds:
    """The limits of an arena file; the paper profile's arena uses the default brake interval."""
    floor = arena.arena
    return Bounds(
        fence=(floor.fence_m, floor.fence_m, floor.size_m[0] - floor.fence_m, floor.size_m[1] - floor.fence_m),
        min_distance_m=arena.safety.min_distance_m,
        separation_m=arena.platform.wheel_separation_m,
        deceleration_mps2=arena.control.field.brake_deceleration_mps2,
        lag_s=arena.control.field.motor_lag_s,
        reaction_s=max(REACTION_S, 2 * arena.control.control_period_s),
    )


def inside_fence(bounds: Bounds, x_m: float, y_m: float, tolerance_m: float = 0.05) -> bool:
    """Whether a centre is inside the fence, give or take what braking errors explain."""
    low_x, low_y, high_x, high_y = bounds.fence
    return low_x - tolerance_m <= x_m <= high_x + tolerance_m and low_y - tolerance_m <= y_m <= high_y + tolerance_m


def stop_m(v_mps: float, deceleration_mps2: float, lag_s: float) -> float:
    """S(v), m: distance rolled from speed ``v >= 0`` with command zero (module docstring)."""
    knee = deceleration_mps2 * lag_s
    if v_mps <= knee:
        return v_mps * lag_s
    return (v_mps * v_mps - knee * knee) / (2 * deceleration_mps2) + knee * lag_s


def respond(
    v_mps: float, command_mps: float, time_s: float, acceleration_mps2: float, lag_s: float
) -> tuple[float, float]:
    """(distance m, speed m/s) after a constant command for ``time_s``: ramp, then exponential."""
    error = v_mps - command_mps
    knee = acceleration_mps2 * lag_s
    distance = 0.0
    if error > knee or -error > knee:
        slope, beyond = (-acceleration_mps2, error - knee) if error > 0.0 else (acceleration_mps2, -error - knee)
        ramp_s = beyond / acceleration_mps2
        if ramp_s > time_s:
            ramp_s = time_s
        distance = v_mps * ramp_s + slope * ramp_s * ramp_s / 2
        v_mps += slope * ramp_s
        time_s -= ramp_s
        error = v_mps - command_mps
    decay = math.exp(-time_s / lag_s) if lag_s > 0 else 0.0
    distance += command_mps * time_s + error * lag_s * (1 - decay)
    return distance, command_mps + error * decay


def roll_m(v_mps: float, command_mps: float, bounds: Bounds) -> float:
    """D(v, c), m: the farthest the rim gets when ``c`` stands for the reaction time, then zero.

    Both speeds are along the direction of interest and not negative. Speeding up is judged with the
    strongest drive, braking with the weakest brake.
    """
    (weak, strong), (quick, slow) = bounds.deceleration_mps2, bounds.lag_s
    if command_mps > v_mps:
        distance, speed = respond(v_mps, command_mps, bounds.reaction_s, strong, quick)
    else:
        distance, speed = respond(v_mps, command_mps, bounds.reaction_s, weak, slow)
    return distance + stop_m(speed, weak, slow)


def limit(
    v_mps: float,
    omega_radps: float,
    pose: tuple[float, float, float],
    wheels_mps: tuple[float, float],
    neighbours: list[Neighbour],
    bounds: Bounds,
) -> Limited:
    """The nearest velocity on the same curve that the fence and the neighbours allow.

    :param pose: own x m, y m, heading rad, dead-reckoned to now.
    :param wheels_mps: measured rim speeds, left and right.
    """
    x, y, heading = pose
    left, right = wheels_mps
    if not math.isfinite(v_mps + omega_radps + x + y + heading + left + right):
        return Limited(0.0, 0.0, "not finite")
    if v_mps == 0.0:
        return record(Limited, (0.0, omega_radps, ""))
    turning = bounds.separation_m / 2 * omega_radps
    if v_mps > 0:
        rims = (
            left if left > 0.0 else 0.0,
            right if right > 0.0 else 0.0,
            v_mps - turning if v_mps > turning else 0.0,
            v_mps + turning if v_mps > -turning else 0.0,
        )
    else:
        rims = (
            -left if left < 0.0 else 0.0,
            -right if right < 0.0 else 0.0,
            turning - v_mps if turning > v_mps else 0.0,
            -turning - v_mps if -turning > v_mps else 0.0,
        )
    most_m = _rolled_m(rims, 1.0, bounds)
    near = _robots(x, y, neighbours, bounds, most_m)
    low_x, low_y, high_x, high_y = bounds.fence
    if x - low_x < most_m or y - low_y < most_m or high_x - x < most_m or high_y - y < most_m:
        near = _walls(x, y, bounds.fence, most_m) + near
    if not near:
        return record(Limited, (v_mps, omega_radps, ""))
    arc = _Arc(rims, most_m, heading if v_mps > 0 else heading + math.pi, (right - left, omega_radps), bounds)
    allowed, by, least_m = 1.0, "", math.inf
    for away_x, away_y, gap, theirs, name in near:
        towards = arc.towards(math.atan2(away_y, away_x))
        if towards <= 0.0:
            continue
        share = gap if name == "fence" else (gap + towards * arc.committed_m - theirs) / 2
        room_m = max(share, 0.0) / towards
        if room_m < least_m:
            least_m = room_m
            fraction = arc.fraction(room_m)
            if fraction < allowed:
                allowed, by = fraction, name
    if not by:
        return record(Limited, (v_mps, omega_radps, ""))
    speed = allowed * abs(v_mps)
    moving = max(abs(left), abs(right)) > REST_MPS
    omega = omega_radps * allowed if speed > 0.0 or moving else omega_radps
    return record(Limited, (math.copysign(1.0, v_mps) * speed, omega, by))


Rims = tuple[float, float, float, float]
"""Along the way, none negative: measured left and right, asked left and right, m/s."""


def _rolled_m(rims: Rims, fraction: float, bounds: Bounds) -> float:
    """How far that fraction of what is asked, then braking, can get."""
    left, right, asked_left, asked_right = rims
    return (roll_m(left, fraction * asked_left, bounds) + roll_m(right, fraction * asked_right, bounds)) / 2


class _Arc:
    """How far, and into which directions, one command and the brake after it can take this robot."""

    def __init__(
        self, rims: Rims, most_m: float, heading_rad: float, turning: tuple[float, float], bounds: Bounds
    ) -> None:
        """``turning``: difference of the measured rim speeds, m/s, and the turn rate asked for, rad/s."""
        self._rims = rims
        self._most_m = most_m
        self._heading = heading_rad
        self._bounds = bounds
        measured, asked = turning[0] / bounds.separation_m, turning[1]
        self._turns = self._turn(max(0.0, measured, asked)), self._turn(max(0.0, -measured, -asked))
        deceleration, lag = bounds.deceleration_mps2[0], bounds.lag_s[1]
        self.committed_m = (stop_m(rims[0], deceleration, lag) + stop_m(rims[1], deceleration, lag)) / 2
        """Stopping distance of what the wheels do already."""

    def _turn(self, rate_radps: float) -> float:
        """Angle turned at most: rate kept for the reaction time, then braked (rim: rate * b / 2)."""
        if rate_radps == 0.0:
            return 0.0
        bounds = self._bounds
        half = bounds.separation_m / 2
        braked_m = stop_m(rate_radps * half, bounds.deceleration_mps2[0], bounds.lag_s[1])
        return rate_radps * bounds.reaction_s + braked_m / half

    def towards(self, bearing_rad: float) -> float:
        """Largest cosine between ``bearing_rad`` and any direction of travel on the way, 0 to 1."""
        left, right = self._turns
        off = math.remainder(bearing_rad - self._heading, math.tau)
        if -right <= off <= left:
            return 1.0
        return max(0.0, math.cos(off - left), math.cos(off + right))

    def fraction(self, room_m: float) -> float:
        """Largest f in [0, 1] such that f times the command, then braking, rolls at most ``room_m``."""
        if self._most_m <= room_m:
            return 1.0
        if _rolled_m(self._rims, 0.0, self._bounds) >= room_m:
            return 0.0
        low, high = 0.0, 1.0
        for _ in range(12):
            middle = (low + high) / 2
            if _rolled_m(self._rims, middle, self._bounds) <= room_m:
                low = middle
            else:
                high = middle
        return low


Obstacle = tuple[float, float, float, float, str]
"""Direction x and y, gap m, its stopping distance towards us m, name."""


def _walls(x: float, y: float, fence: tuple[float, float, float, float], most_m: float) -> list[Obstacle]:
    """The sides of the fence nearer than ``most_m``."""
    low_x, low_y, high_x, high_y = fence
    near: list[Obstacle] = []
    if x - low_x < most_m:
        near.append((-1.0, 0.0, x - low_x, 0.0, "fence"))
    if y - low_y < most_m:
        near.append((0.0, -1.0, y - low_y, 0.0, "fence"))
    if high_x - x < most_m:
        near.append((1.0, 0.0, high_x - x, 0.0, "fence"))
    if high_y - y < most_m:
        near.append((0.0, 1.0, high_y - y, 0.0, "fence"))
    return near


def _robots(
    x: float,
    y: float,
    neighbours: list[Neighbour],
    bounds: Bounds,
    most_m: float,
) -> list[Obstacle]:
    """The robots that a roll of ``most_m`` would come too near to."""
    (weak, strong), (_, slow) = bounds.deceleration_mps2, bounds.lag_s
    min_distance_m = bounds.min_distance_m
    near: list[Obstacle] = []
    for other_x, other_y, vx, vy, age_s, _, _ in neighbours:
        away_x, away_y = other_x - x, other_y - y
        distance = math.hypot(away_x, away_y)
        closing = -(vx * away_x + vy * away_y) / distance if distance > 0 else math.hypot(vx, vy)
        if not closing > 0.0:
            closing = 0.0
        if not age_s > 0.0:
            age_s = 0.0
        elif age_s > MAX_AGE_S:
            age_s = MAX_AGE_S
        unseen = closing * age_s + strong * age_s * age_s / 2
        gap = distance - min_distance_m - unseen
        theirs = stop_m(closing, weak, slow) if closing else 0.0
        if (gap - theirs) / 2 < most_m:
            near.append((away_x, away_y, gap, theirs, "separation"))
    return near
