"""Algorithm 2: cooperative target observation, tracking and release, as a transition table.

    state     event      next      line
    free      observed   tracking  3-5
    tracking  reached    occupied  12-13
    tracking  lost       free      the field profile's yielding, HELP and flooded occupation
    occupied  held       free      15-18

Target choice, yielding and the indicator are pure functions of what one robot knows.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import Enum
from typing import Final, NamedTuple

from onboard.ahdc.parameters import Vector


class Task(Enum):
    """State of algorithm 2."""

    FREE = "free"
    TRACKING = "tracking"
    OCCUPIED = "occupied"


class Event(Enum):
    """What moves algorithm 2 on."""

    OBSERVED = "observed"
    REACHED = "reached"
    LOST = "lost"
    HELD = "held"


TRANSITIONS: dict[tuple[Task, Event], Task] = {
    (Task.FREE, Event.OBSERVED): Task.TRACKING,
    (Task.TRACKING, Event.REACHED): Task.OCCUPIED,
    (Task.TRACKING, Event.LOST): Task.FREE,
    (Task.OCCUPIED, Event.HELD): Task.FREE,
}


def transition(task: Task, event: Event) -> Task:
    """Next state of algorithm 2; an event that means nothing in a state leaves it."""
    return TRANSITIONS.get((task, event), task)


class Claim(NamedTuple):
    """A neighbour's claim on a target."""

    robot: str
    target: int
    distance_m: float


TIE_M: Final = 0.01
"""Distances closer than this are equal; then the lower id keeps the target."""
REACHABLE_SHARE: Final = 0.9
"""Edges of the swarm longer than this share of r_c' make a target costly."""
STRETCH_COST: Final = 2.0
OTHERS_SHARE: Final = 0.6
"""Weight of the way by which another robot will be nearer to a target."""
OUTSIDE_SHARE: Final = 0.5
"""Weight of a target's distance from the middle of all open ones: below 1, so that nobody passes one on the way out."""


def nearest_target(own: Vector, targets: Mapping[int, Vector]) -> int | None:
    """Line 4: the nearest open target; equal distances: the lower index."""
    return min(targets, key=lambda k: (math.dist(own, targets[k]), k), default=None)


def yields(robot: str, distance_m: float, claims: Collection[Claim], target: int) -> bool:
    """Whether a neighbour's claim on the same target is better: the farther robot yields, ties to the lower id."""
    for other, claimed, other_m in claims:
        if claimed == target and (
            other_m < distance_m - TIE_M or (abs(other_m - distance_m) <= TIE_M and other < robot)
        ):
            return True
    return False


def spanning_excess_m(points: Sequence[Vector], free_m: float) -> float:
    """Sum of max(0, l - free) over the edges of the minimum spanning tree of the points."""
    if len(points) < 2:
        return 0.0
    first, *rest = points
    return _excess_m([math.dist(first, point) for point in rest], _table(rest), free_m)


def _table(points: Sequence[Vector]) -> list[list[float]]:
    """Distances between all points, m."""
    return [[math.dist(point, other) for other in points] for point in points]


def _excess_m(gaps_m: list[float], table_m: list[list[float]], free_m: float) -> float:
    """The sum of :func:`spanning_excess_m` for one more point, ``gaps_m`` away from those of the table."""
    gaps_m, rest = gaps_m.copy(), list(range(len(gaps_m)))
    excess = 0.0
    while rest:
        least_m = min(gaps_m)
        nearest = gaps_m.index(least_m)
        if least_m > free_m:
            excess += least_m - free_m
        del gaps_m[nearest]
        row = table_m[rest.pop(nearest)]
        for k, other in enumerate(rest):
            if row[other] < gaps_m[k]:
                gaps_m[k] = row[other]
    return excess


def reachable_target(
    own: Vector,
    targets: Mapping[int, Vector],
    options: Iterable[tuple[float, int]],
    anchors: Sequence[Vector],
    link_radius_m: float,
    middle: Vector | None = None,
) -> int | None:
    """The target with the least d + 2 sum max(0, l - 0.9 r_c') + 0.6 max(0, d - d_other) - 0.5 d_middle.

    l: edges of the tree it would stretch; d_other: from it to the nearest other robot, d_middle: to the middle of all
    open targets: what another is nearer to is left to that one, and what lies outside is not left for the end.

    ``options`` are d and index of those it may choose of ``targets``, the nearest first; ``anchors`` are where the
    neighbours will be: their claimed targets, else their positions. The search ends where no farther target can cost
    less: d_middle is at most d and the robot's own way to the middle, and the tree has an edge to the target that is no
    shorter than d less the robot's way to the farthest anchor.
    """
    free_m = REACHABLE_SHARE * link_radius_m
    table = _table(anchors)
    share, centre = (0.0, own) if middle is None else (OUTSIDE_SHARE, middle)
    centre_m = math.dist(own, centre)
    bound_m = free_m + max((math.dist(own, anchor) for anchor in anchors), default=math.inf)
    best: tuple[float, int] | None = None
    for distance_m, index in options:
        if best is not None:
            least = distance_m + STRETCH_COST * max(0.0, distance_m - bound_m)
            if least - share * (distance_m + centre_m) > best[0]:
                break
        place = targets[index]
        gaps = [math.dist(place, anchor) for anchor in anchors]
        farther_m = distance_m - min(gaps, default=distance_m)
        value = distance_m + STRETCH_COST * _excess_m(gaps, table, free_m) - share * math.dist(place, centre)
        cost = (value + OTHERS_SHARE * farther_m if farther_m > 0.0 else value, index)
        if best is None or cost < best:
            best = cost
    return None if best is None else best[1]


def is_indicator(task: Task, tracked: int | None, open_targets: Mapping[int, Vector]) -> bool:
    """Line 10-11: a tracking or occupying robot that observes another open target guides free robots."""
    return task is not Task.FREE and len(open_targets) > (tracked in open_targets)
