"""The field bound: a command passes only if the robot, braking after it, comes to rest where it may.

For every enforced link the robot and its partner share the disc of diameter R around the middle of their
stop points: while each keeps its own stop point inside, they rest within R. R is r_c less a margin and
less what a partner's stop point may run ahead of its announcement while the announcement grows old.
Separation is checked on the same plan: the way to the stop point stays outside half the gap to every
other robot's pose and stop points.

Both ends of the calibrated brake interval are planned (braking better than announced is as wrong as
braking worse); each is compared with the partner's stop point of the same end.
"""

import math
from typing import Final, NamedTuple

from onboard.ahdc.behaviour import FADED_M
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.room import (
    CONTACT_M,
    RUN_AHEAD,
    Motion,
    Partner,
    Room,
    enforced_radius_m,
    inside_disc,
    keepout,
    make_disc,
    way_clearance_m,
)
from onboard.ahdc.stopping import Brake, Stops
from onboard.record import record

__all__ = [
    "CONTACT_M",
    "Command",
    "Motion",
    "Partner",
    "Planner",
    "Room",
    "enforced_radius_m",
    "inside_disc",
    "make_disc",
    "way_clearance_m",
]

TURNING_STOP_MPS: Final = 0.005
"""Above this speed a fallback brakes straight: turning would cancel braking of one wheel."""
SHARES = (1.0, 0.5, 0.25, 0.1, 0.0)
"""Shares of the wanted speed tried first; the interval of the first that passes is halved further."""
REFINEMENTS: Final = 2
YIELD_RANGE_M: Final = 0.6
"""A velocity gives way to robots nearer than this."""
LOOK_AHEAD_S: Final = 0.12
"""T_p: how far ahead the wanted velocity must respect the link discs."""
MOVE_SHARE: Final = 10.0
"""In one period a stop point moves by less than this many u_max T: farther discs cannot bind."""


class Command(NamedTuple):
    """Rim speeds, m/s, and what bounded them: '', 'link', 'separation' or 'brake'."""

    left_mps: float
    right_mps: float
    bound: str


class Planner:
    """Finds the largest share of a wanted motion whose plan passes every disc and keep-out."""

    def __init__(self, parameters: Parameters, stops: Stops, period_s: float) -> None:
        self._parameters = parameters
        self._stops = stops
        self.period_s = period_s
        self._half_track_m = parameters.wheel_separation_m / 2
        self._run_ahead_mps = RUN_AHEAD * parameters.max_speed_mps
        self._near_m = max(YIELD_RANGE_M, parameters.avoidance_radius_m + FADED_M)
        self._reach_m = MOVE_SHARE * parameters.max_speed_mps * period_s
        self._ahead_m = 2 * LOOK_AHEAD_S * parameters.max_speed_mps + 1e-9
        """Discs wider than the gap by more than this are too wide even for a velocity to mind."""

    @property
    def weak_brake(self) -> Brake:
        return self._stops.long.brake

    def stop_points(self, motion: Motion, left_mps: float, right_mps: float) -> tuple[Vector, Vector]:
        """(long, short) resting places after one period of a command and then full braking."""
        x, y, heading, left, right = motion
        axis, (long, short), period_s = (math.cos(heading), math.sin(heading)), self._stops, self.period_s
        return (
            _in_arena(x, y, axis, long.place_after(left, right, left_mps, right_mps, period_s)),
            _in_arena(x, y, axis, short.place_after(left, right, left_mps, right_mps, period_s)),
        )

    def brake_points(self, motion: Motion) -> tuple[Vector, Vector]:
        """(long, short) resting places after braking at once."""
        return self._brakes(motion, (math.cos(motion[2]), math.sin(motion[2])))

    def _brakes(self, motion: Motion, axis: Vector) -> tuple[Vector, Vector]:
        x, y, _, left, right = motion
        cosine, sine = axis
        forward, aside, short_forward, short_aside = self._stops.places(left, right)
        return (
            (x + forward * cosine - aside * sine, y + forward * sine + aside * cosine),
            (x + short_forward * cosine - short_aside * sine, y + short_forward * sine + short_aside * cosine),
        )

    def room(self, motion: Motion, partners: list[Partner]) -> Room:
        """Discs of all enforced links for the long and the short model, and keep-outs of all robots.

        Keep-outs are circles of half the gap around every other robot's pose and stop points. Left out are those
        that cannot bind: a way of at most l clears a point at d >= 2 l + contact by half the gap.
        """
        axis = (math.cos(motion[2]), math.sin(motion[2]))
        brakes = self._brakes(motion, axis)
        own, (brake, brake_short), reach_m, near_m = motion[:2], brakes, self._reach_m, self._near_m
        ahead_m, run_ahead_mps, dist = self._ahead_m, self._run_ahead_mps, math.dist
        link_radius_m, least_m = self._parameters.link_radius_m, self._parameters.avoidance_radius_m
        way_m = dist(own, brake)
        horizon_m = 2 * (way_m + reach_m) + CONTACT_M
        beyond_m = horizon_m + way_m + 1e-9
        room = record(Room, (motion, axis, brakes, [], [], [], [], []))
        _, _, _, long, short, far, keepouts, near = room
        for partner in partners:
            _, enforced, place, long_stops, short_stops, age_s, resting = partner
            distance = dist(own, place)
            if distance <= near_m:
                near.append((distance, partner))
            if distance < horizon_m:
                keepouts.append(keepout(place, dist(brake, place), distance, resting))
            if enforced:
                diameter = link_radius_m - run_ahead_mps * age_s  # enforced_radius_m
                if diameter <= least_m:
                    diameter = least_m
                slack_m = diameter - 2 * reach_m
            for point in long_stops:
                gap = dist(brake, point)
                if enforced:
                    if gap > slack_m:
                        long.append(make_disc(brake, point, diameter))
                    elif gap + ahead_m > diameter:
                        far.append((gap, diameter, point))
                if gap < beyond_m:
                    distance = dist(own, point)
                    if distance < horizon_m:
                        keepouts.append(keepout(point, gap, distance, resting))
            if enforced:
                for point in short_stops:
                    if dist(brake_short, point) > slack_m:
                        short.append(make_disc(brake_short, point, diameter))
        return room

    def choose(self, room: Room, speed_mps: float, turn_rate_radps: float) -> Command:
        """The command nearest to the wanted speed (forward, m/s) and turn rate (rad/s) whose plan passes."""
        good, bound = -1.0, ""
        tried = 1.0
        for share in SHARES:
            refusal = self._refusal(room, share * speed_mps, turn_rate_radps)
            if not refusal:
                good = share
                break
            tried, bound = share, refusal
        if good < 0:
            return self._fallback(room.motion, turn_rate_radps, bound)
        for _ in range(REFINEMENTS if good < 1.0 else 0):
            middle = (good + tried) / 2
            if self._refusal(room, middle * speed_mps, turn_rate_radps):
                tried = middle
            else:
                good = middle
        left, right = self._rims(good * speed_mps, turn_rate_radps)
        return record(Command, (left, right, bound))

    def _fallback(self, motion: Motion, turn_rate_radps: float, bound: str) -> Command:
        """Full braking; at rest it may still turn on the spot towards where it wants to go."""
        if abs(motion.left_mps + motion.right_mps) / 2 < TURNING_STOP_MPS:
            left, right = self._rims(0.0, turn_rate_radps)
            return Command(left, right, bound)
        return Command(0.0, 0.0, bound)

    def _rims(self, speed_mps: float, turn_rate_radps: float) -> tuple[float, float]:
        half = turn_rate_radps * self._half_track_m
        left, right = speed_mps - half, speed_mps + half
        limit = self._parameters.max_speed_mps
        if -limit <= left <= limit and -limit <= right <= limit:
            return (left, right)
        excess = max(abs(left), abs(right)) / limit
        return (left, right) if excess <= 1 else (left / excess, right / excess)

    def _refusal(self, room: Room, speed_mps: float, turn_rate_radps: float) -> str:
        """What a candidate's plan violates: '', 'link' or 'separation'."""
        motion, axis, _, long_discs, short_discs, _, keepouts, _ = room
        if not (long_discs or short_discs or keepouts):
            return ""
        x, y, _, left, right = motion
        left_to, right_to = self._rims(speed_mps, turn_rate_radps)
        (long, short), period_s = self._stops, self.period_s
        if long_discs or keepouts:
            end = _in_arena(x, y, axis, long.place_after(left, right, left_to, right_to, period_s))
            for disc in long_discs:
                if not inside_disc(end, disc):
                    return "link"
        if short_discs:
            end_short = _in_arena(x, y, axis, short.place_after(left, right, left_to, right_to, period_s))
            for disc in short_discs:
                if not inside_disc(end_short, disc):
                    return "link"
        if keepouts:
            start = (x, y)
            way_m = math.dist(start, end)
            for centre, radius_m, free_m in keepouts:
                if way_m > free_m and way_clearance_m(start, end, centre) < radius_m - 1e-9:
                    return "separation"
        return ""


def _in_arena(x_m: float, y_m: float, axis: Vector, place: Vector) -> Vector:
    """A place seen from the body (forward, left), in the arena frame."""
    (cosine, sine), (forward, left) = axis, place
    return (x_m + forward * cosine - left * sine, y_m + forward * sine + left * cosine)
