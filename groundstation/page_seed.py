"""Targets placed by hand: what is wrong with them, and the cloud they make. Pure."""

import math
from collections.abc import Sequence

from contract.arena import Arena
from contract.messages import Target, TargetCloud
from contract.units import Point
from groundstation.targets import pointing

MOST_TARGETS = 1000


class SeedError(ValueError):
    """These targets cannot be used; the text names the target, the limit and the remedy."""


def points_of(value: object) -> tuple[Point, ...]:
    """A list of ``[x, y]`` in metres, from a browser or a file.

    :raises SeedError: it is something else.
    """
    if not isinstance(value, list) or not 1 <= len(value) <= MOST_TARGETS:
        raise SeedError(f"targets: a list of 1 to {MOST_TARGETS} points [x, y] in metres is needed")
    points = []
    for number, pair in enumerate(value, 1):
        fair = isinstance(pair, list) and len(pair) == 2
        if not fair or not all(type(c) in (int, float) and math.isfinite(c) for c in pair):
            raise SeedError(f"target {number}: [x, y] in metres is needed")
        points.append((round(float(pair[0]), 4), round(float(pair[1]), 4)))
    return tuple(points)


def checked(arena: Arena, points: Sequence[Point]) -> None:
    """Every target within the fence.

    :raises SeedError: naming the first that is not.
    """
    floor = arena.arena
    low, high = floor.fence_m, [size - floor.fence_m for size in floor.size_m]
    for number, (x, y) in enumerate(points, 1):
        if not (low <= x <= high[0] and low <= y <= high[1]):
            raise SeedError(
                f"target {number} at x {x:.2f}, y {y:.2f} is beyond the fence: "
                f"x {low:g} to {high[0]:g}, y {low:g} to {high[1]:g} m"
            )


def unreachable(points: Sequence[Point], reach_m: float) -> list[tuple[int, float]]:
    """(target, distance in m to the nearest other piece) of every target not in the largest piece.

    Targets are one piece when each is within ``reach_m`` of the next: then a swarm can go from one to
    all others without losing itself.
    """
    left = set(range(len(points)))
    pieces: list[list[int]] = []
    while left:
        piece, todo = [], [left.pop()]
        while todo:
            here = todo.pop()
            piece.append(here)
            near = {other for other in left if math.dist(points[here], points[other]) <= reach_m}
            left -= near
            todo.extend(near)
        pieces.append(piece)
    if len(pieces) < 2:
        return []
    largest = max(pieces, key=len)
    lost = []
    for piece in pieces:
        if piece is not largest:
            others = [points[k] for other in pieces if other is not piece for k in other]
            lost += [(k, min(math.dist(points[k], other) for other in others)) for k in piece]
    return sorted(lost)


def cloud(arena: Arena, points: Sequence[Point], mission: str) -> TargetCloud:
    """The mission's targets, the swarm pointed at their middle.

    :raises SeedError: a target is beyond the fence.
    """
    checked(arena, points)
    starts = [robot.start for robot in arena.robots.values()]
    direction = math.remainder(pointing(starts, points), math.tau)
    targets = tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(points))
    return TargetCloud(mission=mission, start_direction_rad=round(direction, 5), targets=targets)
