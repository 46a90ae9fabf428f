"""Targets placed by hand: what is wrong with them, and the cloud they make. Pure."""

import math
from collections.abc import Sequence

import numpy as np

from contract.arena import Arena
from contract.messages import Target, TargetCloud
from contract.units import Point
from groundstation.targets import pointing

MOST_TARGETS = 1000
ROUNDING_M = 1e-9


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
    if len(points) < 2:
        return []
    places = np.array(points)
    ways = np.sqrt(((places[:, None, :] - places[None, :, :]) ** 2).sum(axis=2))
    close = ways <= reach_m + ROUNDING_M
    piece = np.full(len(points), -1)
    while (left := np.flatnonzero(piece < 0)).size:
        front = left[:1]
        while front.size:
            piece[front] = left[0]
            front = np.flatnonzero(close[front].any(axis=0) & (piece < 0))
    apart = np.flatnonzero(piece != np.bincount(piece).argmax())
    gaps = np.where(piece[apart, None] == piece[None, :], np.inf, ways[apart])
    return list(zip(apart.tolist(), gaps.min(axis=1).tolist() if apart.size else [], strict=True))


def cloud(arena: Arena, points: Sequence[Point], mission: str) -> TargetCloud:
    """The mission's targets, the swarm pointed at their middle.

    :raises SeedError: a target is beyond the fence.
    """
    checked(arena, points)
    starts = [robot.start for robot in arena.robots.values()]
    direction = math.remainder(pointing(starts, points), math.tau)
    targets = tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(points))
    return TargetCloud(mission=mission, start_direction_rad=round(direction, 5), targets=targets)
