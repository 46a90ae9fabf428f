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
from collections.abc import Sequence
from typing import NamedTuple

from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.stopping import Brake, Stops

RUN_AHEAD = 0.8
"""Share of u_max by which an accelerating partner's stop point runs ahead per second of age, fitted."""
CONTACT_M = 0.17
"""Centre distance that separation plans for; collision is at one diameter, 0.14 m."""
CREEP_SHARE = 0.1
"""Outside a disc a plan must come nearer by this share of its way, or a robot creeps round the rim."""
TURNING_STOP_MPS = 0.005
"""Above this speed a fallback brakes straight: turning would cancel braking of one wheel."""
SHARES = (1.0, 0.5, 0.25, 0.1, 0.0)
"""Shares of the wanted speed tried first; the interval of the first that passes is halved further."""
REFINEMENTS = 2
MOVE_SHARE = 10.0
"""In one period a stop point moves by less than this many u_max T: farther discs cannot bind."""


class Motion(NamedTuple):
    """Own pose and measured rim speeds, dead-reckoned to now."""

    x_m: float
    y_m: float
    heading_rad: float
    left_mps: float
    right_mps: float


class Partner(NamedTuple):
    """Another robot as the plan sees it; positions in the arena frame."""

    robot: str
    enforced: bool
    x_m: float
    y_m: float
    """Predicted to now."""
    long_stops: tuple[Vector, ...]
    """Hypotheses of where it rests with the weakest brake."""
    short_stops: tuple[Vector, ...]
    """The same with the strongest brake."""
    age_s: float
    """Of the announcement the stop points come from."""
    resting: bool
    """It holds zero and says so."""


class Disc(NamedTuple):
    """Where one stop point may lie for one link and one hypothesis."""

    start: Vector
    """Own resting place if braking at once."""
    partner: Vector
    radius_m: float
    """R / 2."""
    middle: Vector
    gap_m: float
    inside: bool


class Keepout(NamedTuple):
    """A circle that the way to the stop point must not enter."""

    centre: Vector
    radius_m: float


class Room(NamedTuple):
    """Where a robot may come to rest at one step."""

    motion: Motion
    brakes: tuple[Vector, Vector]
    """(long, short) resting places after braking at once."""
    long: list[Disc]
    short: list[Disc]
    """Discs near enough to bind within one period."""
    far: list[Disc]
    """The long discs that are not: they matter only to a velocity that looks farther ahead."""
    keepouts: list[Keepout]


class Command(NamedTuple):
    """Rim speeds, m/s, and what bounded them: '', 'link', 'separation' or 'brake'."""

    left_mps: float
    right_mps: float
    bound: str


def enforced_radius_m(parameters: Parameters, age_s: float) -> float:
    """R_ij = r_c - m0 - 0.8 u_max age; never below the avoidance radius."""
    radius = parameters.link_radius_m - RUN_AHEAD * parameters.max_speed_mps * age_s
    return max(radius, parameters.avoidance_radius_m)


def make_disc(start: Vector, partner: Vector, diameter_m: float) -> Disc:
    gap = math.dist(start, partner)
    middle = ((start[0] + partner[0]) / 2, (start[1] + partner[1]) / 2)
    return Disc(start, partner, diameter_m / 2, middle, gap, gap <= diameter_m)


def inside_disc(end: Vector, disc: Disc) -> bool:
    """Whether a stop point respects a link: inside the shared disc, or, once outside it, truly nearer."""
    if disc.inside:
        return math.dist(end, disc.middle) <= disc.radius_m
    return math.dist(end, disc.partner) <= disc.gap_m - CREEP_SHARE * math.dist(end, disc.start)


def way_clearance_m(start: Vector, end: Vector, point: Vector) -> float:
    """Least distance between a point and the straight way from start to end."""
    wx, wy = end[0] - start[0], end[1] - start[1]
    px, py = point[0] - start[0], point[1] - start[1]
    length2 = wx * wx + wy * wy
    share = 0.0 if length2 < 1e-12 else min(1.0, max(0.0, (px * wx + py * wy) / length2))
    return math.hypot(px - share * wx, py - share * wy)


class Planner:
    """Finds the largest share of a wanted motion whose plan passes every disc and keep-out."""

    def __init__(self, parameters: Parameters, stops: Stops, period_s: float) -> None:
        self._parameters = parameters
        self._stops = stops
        self.period_s = period_s
        self._half_track_m = parameters.wheel_separation_m / 2

    @property
    def weak_brake(self) -> Brake:
        return self._stops.long.brake

    def stop_points(self, motion: Motion, left_mps: float, right_mps: float) -> tuple[Vector, Vector]:
        """(long, short) resting places after one period of a command and then full braking."""
        return (
            self._end(motion, self._stops.long.place_after(*motion[3:], left_mps, right_mps, self.period_s)),
            self._end(motion, self._stops.short.place_after(*motion[3:], left_mps, right_mps, self.period_s)),
        )

    def brake_points(self, motion: Motion) -> tuple[Vector, Vector]:
        """(long, short) resting places after braking at once."""
        return (
            self._end(motion, self._stops.long.place(*motion[3:])),
            self._end(motion, self._stops.short.place(*motion[3:])),
        )

    def room(self, motion: Motion, partners: Sequence[Partner]) -> Room:
        """Discs of all enforced links for the long and the short model, and keep-outs of all robots."""
        brakes = self.brake_points(motion)
        reach_m = MOVE_SHARE * self._parameters.max_speed_mps * self.period_s
        long: list[Disc] = []
        short: list[Disc] = []
        far: list[Disc] = []
        for partner in partners:
            if partner.enforced:
                diameter = enforced_radius_m(self._parameters, partner.age_s)
                slack_m = diameter - 2 * reach_m
                for point in partner.long_stops:
                    disc = make_disc(brakes[0], point, diameter)
                    (long if disc.gap_m > slack_m else far).append(disc)
                for point in partner.short_stops:
                    if math.dist(brakes[1], point) > slack_m:
                        short.append(make_disc(brakes[1], point, diameter))
        return Room(motion, brakes, long, short, far, self.keepouts(motion, brakes, partners))

    def keepouts(self, motion: Motion, brakes: tuple[Vector, Vector], partners: Sequence[Partner]) -> list[Keepout]:
        """Circles of half the gap around every other robot's pose and stop points.

        Left out where they cannot bind: a way of at most l clears a point at d >= 2 l + contact by half the gap.
        """
        circles: list[Keepout] = []
        own = (motion.x_m, motion.y_m)
        way_m = math.dist(own, brakes[0]) + MOVE_SHARE * self._parameters.max_speed_mps * self.period_s
        horizon_m = 2 * way_m + CONTACT_M
        for partner in partners:
            for point in ((partner.x_m, partner.y_m), *partner.long_stops):
                distance = math.dist(own, point)
                if distance >= horizon_m:
                    continue
                gap = min(math.dist(brakes[0], point), distance)
                if gap <= CONTACT_M:
                    radius = gap
                elif partner.resting:
                    radius = CONTACT_M
                else:
                    radius = CONTACT_M + (gap - CONTACT_M) / 2
                circles.append(Keepout(point, radius))
        return circles

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
        return Command(left, right, bound)

    def _fallback(self, motion: Motion, turn_rate_radps: float, bound: str) -> Command:
        """Full braking; at rest it may still turn on the spot towards where it wants to go."""
        if abs(motion.left_mps + motion.right_mps) / 2 < TURNING_STOP_MPS:
            left, right = self._rims(0.0, turn_rate_radps)
            return Command(left, right, bound)
        return Command(0.0, 0.0, bound)

    def _rims(self, speed_mps: float, turn_rate_radps: float) -> tuple[float, float]:
        half = turn_rate_radps * self._half_track_m
        left, right = speed_mps - half, speed_mps + half
        excess = max(abs(left), abs(right)) / self._parameters.max_speed_mps
        return (left, right) if excess <= 1 else (left / excess, right / excess)

    def _refusal(self, room: Room, speed_mps: float, turn_rate_radps: float) -> str:
        """What a candidate's plan violates: '', 'link' or 'separation'."""
        if not (room.long or room.short or room.keepouts):
            return ""
        motion = room.motion
        left, right = self._rims(speed_mps, turn_rate_radps)
        stops = self._stops
        end = self._end(motion, stops.long.place_after(*motion[3:], left, right, self.period_s))
        for disc in room.long:
            if not inside_disc(end, disc):
                return "link"
        if room.short:
            end_short = self._end(motion, stops.short.place_after(*motion[3:], left, right, self.period_s))
            for disc in room.short:
                if not inside_disc(end_short, disc):
                    return "link"
        start = (motion.x_m, motion.y_m)
        for circle in room.keepouts:
            clearance = way_clearance_m(start, end, circle.centre)
            if clearance < circle.radius_m - 1e-9 and clearance < math.dist(start, circle.centre) - 1e-9:
                return "separation"
        return ""

    @staticmethod
    def _end(motion: Motion, placement: tuple[float, float, float]) -> Vector:
        forward, left, _ = placement
        cosine, sine = math.cos(motion.heading_rad), math.sin(motion.heading_rad)
        return (motion.x_m + forward * cosine - left * sine, motion.y_m + forward * sine + left * cosine)
