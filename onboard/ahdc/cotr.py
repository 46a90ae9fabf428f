"""Algorithm 2: cooperative target observation, tracking and release, as a transition table.

    state     event      next      line
    free      observed   tracking  3-5
    tracking  reached    occupied  12-13
    tracking  lost       free      the field profile's yielding, HELP and flooded occupation
    occupied  held       free      15-18

Target choice, yielding and the indicator are pure functions of what one robot knows.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from enum import Enum
from typing import NamedTuple

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


TIE_M = 0.01
"""Distances closer than this are equal; then the lower id keeps the target."""
REACHABLE_SHARE = 0.9
"""Edges of the swarm longer than this share of r_c' make a target costly."""
STRETCH_COST = 2.0


def nearest_target(own: Vector, targets: Mapping[int, Vector]) -> int | None:
    """Line 4: the nearest open target; equal distances: the lower index."""
    return min(targets, key=lambda k: (math.dist(own, targets[k]), k), default=None)


def yields(robot: str, distance_m: float, claims: Collection[Claim], target: int) -> bool:
    """Whether a neighbour's claim on the same target is better: the farther robot yields, ties to the lower id."""
    return any(
        claim.target == target
        and (
            claim.distance_m < distance_m - TIE_M
            or (abs(claim.distance_m - distance_m) <= TIE_M and claim.robot < robot)
        )
        for claim in claims
    )


def spanning_excess_m(points: Sequence[Vector], free_m: float) -> float:
    """Sum of max(0, l - free) over the edges of the minimum spanning tree of the points."""
    if len(points) < 2:
        return 0.0
    gaps = [math.dist(points[0], point) for point in points[1:]]
    rest = list(points[1:])
    excess = 0.0
    while rest:
        index = min(range(len(rest)), key=gaps.__getitem__)
        excess += max(0.0, gaps.pop(index) - free_m)
        new = rest.pop(index)
        gaps = [min(gap, math.dist(new, point)) for gap, point in zip(gaps, rest, strict=True)]
    return excess


def reachable_target(
    own: Vector, targets: Mapping[int, Vector], anchors: Sequence[Vector], link_radius_m: float
) -> int | None:
    """The target with the least d + 2 sum max(0, l - 0.9 r_c'), edges of the tree it would stretch.

    ``anchors`` are where the neighbours will be: their claimed targets, else their positions.
    """
    free_m = REACHABLE_SHARE * link_radius_m

    def cost(index: int) -> tuple[float, int]:
        point = targets[index]
        return (math.dist(own, point) + STRETCH_COST * spanning_excess_m([point, *anchors], free_m), index)

    return min(targets, key=cost, default=None)


def is_indicator(task: Task, tracked: int | None, open_targets: Mapping[int, Vector]) -> bool:
    """Line 10-11: a tracking or occupying robot that observes another open target guides free robots."""
    return task is not Task.FREE and any(index != tracked for index in open_targets)
