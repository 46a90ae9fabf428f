"""What the plan of a motion looks at: other robots, the discs shared with linked ones, and circles to keep out of."""

import math
from typing import Final, NamedTuple

from onboard.ahdc.parameters import Parameters, Vector
from onboard.record import record

RUN_AHEAD: Final = 0.8
"""Share of u_max by which an accelerating partner's stop point runs ahead per second of age, fitted."""
CONTACT_M: Final = 0.17
"""Centre distance that separation plans for; collision is at one diameter, 0.14 m."""
CREEP_SHARE: Final = 0.1
"""Outside a disc a plan must come nearer by this share of its way, or a robot creeps round the rim."""


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
    place: Vector
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


Keepout = tuple[Vector, float, float]
"""A circle that the way to the stop point must not enter: centre, radius m, length m of a way too short to enter."""


class Room(NamedTuple):
    """Where a robot may come to rest at one step."""

    motion: Motion
    axis: Vector
    """Cosine and sine of the heading."""
    brakes: tuple[Vector, Vector]
    """(long, short) resting places after braking at once."""
    long: list[Disc]
    short: list[Disc]
    """Discs near enough to bind within one period."""
    far: list[tuple[float, float, Vector]]
    """(gap, diameter, stop point) of long discs that cannot, but that a velocity, which looks farther ahead, minds."""
    keepouts: list[Keepout]
    near: list[tuple[float, Partner]]
    """Robots near enough to matter to a velocity, with their distances, m."""


def enforced_radius_m(parameters: Parameters, age_s: float) -> float:
    """R_ij = r_c - m0 - 0.8 u_max age; never below the avoidance radius."""
    radius = parameters.link_radius_m - RUN_AHEAD * parameters.max_speed_mps * age_s
    return radius if radius > parameters.avoidance_radius_m else parameters.avoidance_radius_m


def make_disc(start: Vector, partner: Vector, diameter_m: float) -> Disc:
    gap = math.dist(start, partner)
    middle = ((start[0] + partner[0]) / 2, (start[1] + partner[1]) / 2)
    return record(Disc, (start, partner, diameter_m / 2, middle, gap, gap <= diameter_m))


def inside_disc(end: Vector, disc: Disc) -> bool:
    """Whether a stop point respects a link: inside the shared disc, or, once outside it, truly nearer."""
    start, partner, radius_m, middle, gap_m, inside = disc
    if inside:
        return math.dist(end, middle) <= radius_m
    return math.dist(end, partner) <= gap_m - CREEP_SHARE * math.dist(end, start)


def keepout(point: Vector, gap_m: float, distance_m: float, resting: bool) -> Keepout:
    """Half of what is left of the gap to contact; all of it to a robot at rest; already inside: never nearer.

    ``gap_m``, the least of it and the distance, is from the stop point of braking at once, ``distance_m`` from where
    the robot is.
    """
    if distance_m < gap_m:
        gap_m = distance_m
    radius_m = gap_m
    if gap_m > CONTACT_M:
        radius_m = CONTACT_M if resting else CONTACT_M + (gap_m - CONTACT_M) / 2
    return (point, radius_m, distance_m - radius_m)


def way_clearance_m(start: Vector, end: Vector, point: Vector) -> float:
    """Least distance between a point and the straight way from start to end."""
    x, y = start
    wx, wy = end[0] - x, end[1] - y
    px, py = point[0] - x, point[1] - y
    length2 = wx * wx + wy * wy
    along = px * wx + py * wy
    if length2 < 1e-12 or along <= 0.0:
        return math.hypot(px, py)
    share = along / length2
    if share > 1.0:
        share = 1.0
    return math.hypot(px - share * wx, py - share * wy)
