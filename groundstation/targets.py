"""Scenarios that compare: start grid, seeded target cloud, and the lower bound on the mission time. Pure."""

import math
import random
from collections.abc import Sequence
from typing import NamedTuple

from contract.arena import Arena
from contract.messages import Target, TargetCloud
from contract.units import Point, metres

MARGIN_M = 0.2
NEAREST_GAP_M = (0.22, 0.95)
"""Every target has its nearest earlier one within this interval, so the cloud is connected for r_c = 1 m."""
START_CLEARANCE_M = 1.1
"""No target is in sight at the start."""
START_CORNER_M = (0.35, 0.35)
GRID_M = 0.4
JITTER_M = 0.03
POINTING_ERROR_RAD = 0.1
SURE_SHARE = 0.8
"""Of the sensing radius: robots do not drive into the start direction in straight lines."""
MAX_DRAWS = 200_000


class Scenario(NamedTuple):
    """Floor size, starts, targets (m) and the direction in which the operator points the swarm (rad)."""

    size_m: Point
    starts: tuple[Point, ...]
    targets: tuple[Point, ...]
    start_direction_rad: float


class CloudError(ValueError):
    """No such cloud fits on this floor."""


def floor_size_m(targets: int) -> Point:
    """4 m x 5 m up to 50 targets, then growing with the square root of their number."""
    scale = math.sqrt(max(1.0, targets / 50))
    return (4.0 * scale, 5.0 * scale)


def start_grid(robots: int, rng: random.Random) -> tuple[Point, ...]:
    """Starts on a 0.4 m grid, jittered by up to 3 cm, from the corner opposite to the cloud."""
    columns = math.ceil(math.sqrt(robots))
    return tuple(
        (
            metres(START_CORNER_M[0] + GRID_M * (i % columns) + rng.uniform(-JITTER_M, JITTER_M)),
            metres(START_CORNER_M[1] + GRID_M * (i // columns) + rng.uniform(-JITTER_M, JITTER_M)),
        )
        for i in range(robots)
    )


def target_cloud(count: int, size_m: Point, starts: Sequence[Point], rng: random.Random) -> tuple[Point, ...]:
    """A Gaussian cloud, accepted point by point so that it stays connected (section IV-A).

    :raises CloudError: the floor cannot hold it.
    """
    width, height = size_m
    accepted: list[Point] = []
    for _ in range(MAX_DRAWS):
        point = (
            metres(rng.gauss(0.58 * width, 0.22 * width)),
            metres(rng.gauss(0.62 * height, 0.18 * height)),
        )
        inside = all(MARGIN_M <= c <= size - MARGIN_M for c, size in zip(point, size_m, strict=True))
        if not inside or any(math.dist(point, start) <= START_CLEARANCE_M for start in starts):
            continue
        if accepted:
            gap = min(math.dist(point, other) for other in accepted)
            if not NEAREST_GAP_M[0] <= gap <= NEAREST_GAP_M[1]:
                continue
        accepted.append(point)
        if len(accepted) == count:
            return tuple(accepted)
    raise CloudError(f"{count} targets do not fit on {width:g} x {height:g} m; {len(accepted)} do")


def scenario(robots: int, targets: int, seed: int) -> Scenario:
    """The scenario of a seed: same robots, targets and seed, same scenario.

    :raises CloudError: the floor cannot hold the cloud.
    """
    rng = random.Random(seed)
    size_m = floor_size_m(targets)
    starts = start_grid(robots, rng)
    cloud = target_cloud(targets, size_m, starts, rng)
    direction = pointing(starts, cloud) + rng.uniform(-POINTING_ERROR_RAD, POINTING_ERROR_RAD)
    return Scenario(size_m, starts, cloud, math.remainder(direction, math.tau))


def pointing(starts: Sequence[Point], targets: Sequence[Point]) -> float:
    """Direction from the middle of the starts to the middle of the targets, rad."""
    return math.atan2(
        sum(p[1] for p in targets) / len(targets) - sum(p[1] for p in starts) / len(starts),
        sum(p[0] for p in targets) / len(targets) - sum(p[0] for p in starts) / len(starts),
    )


def on_the_way(starts: Sequence[Point], targets: Sequence[Point], direction_rad: float, reach_m: float) -> bool:
    """Whether a robot that sets out from a start in that direction comes within reach of a target, sooner or later."""
    ahead_x, ahead_y = math.cos(direction_rad), math.sin(direction_rad)
    for start in starts:
        for target in targets:
            x, y = target[0] - start[0], target[1] - start[1]
            ahead, aside = x * ahead_x + y * ahead_y, y * ahead_x - x * ahead_y
            if math.hypot(min(ahead, 0.0), aside) <= reach_m:
                return True
    return False


def cloud_of(arena: Arena, mission: str) -> TargetCloud:
    """The target cloud an arena file asks for: its points, or a seeded cloud for its starts.

    :raises CloudError: the floor cannot hold the cloud.
    """
    starts = [robot.start for robot in arena.robots.values()]
    wish = arena.targets
    rng = random.Random(wish.seed)
    points = wish.points or target_cloud(wish.count, arena.arena.size_m, starts, rng)
    direction = wish.start_direction_rad
    if direction is None:
        direction = pointing(starts, points)
        if not wish.points:
            direction += rng.uniform(-POINTING_ERROR_RAD, POINTING_ERROR_RAD)
    return TargetCloud(
        mission=mission,
        seed=wish.seed,
        start_direction_rad=round(math.remainder(direction, math.tau), 5),
        targets=tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(points)),
    )


def lower_bound_s(
    starts: Sequence[Point], targets: Sequence[Point], speed_mps: float, hold_s: float, reach_m: float
) -> float:
    """A time that no set of all-knowing robots at full speed beats by much, s.

    The largest of: (spanning tree from the nearest start, edges shortened by the reach, over speed, plus the
    holds) shared by all robots; the way to the farthest target; the way to the first target and the holds
    and shortest hops of the busiest robot. The last N targets need no hold: the mission ends on arrival.
    """
    n, m = len(starts), len(targets)
    if not n or not m:
        return 0.0
    reach_from_start = [min(math.dist(start, target) for start in starts) for target in targets]
    tree_m = _tree_m(targets, reach_from_start, reach_m)
    shared = (tree_m / speed_mps + max(m - n, 0) * hold_s) / n
    farthest = (max(reach_from_start) - reach_m) / speed_mps
    first = (min(reach_from_start) - reach_m) / speed_mps
    rounds = math.ceil(m / n) - 1
    if rounds:
        gap = min(math.dist(a, b) for i, a in enumerate(targets) for b in targets[i + 1 :])
        first += rounds * (hold_s + max(0.0, gap - 2 * reach_m) / speed_mps)
    return max(shared, farthest, first, 0.0)


def _tree_m(targets: Sequence[Point], from_start: Sequence[float], reach_m: float) -> float:
    """Prim's tree over the targets and the starts (one node), each edge shortened by the reach."""
    best = list(from_start)
    left = set(range(len(targets)))
    total = 0.0
    while left:
        index = min(left, key=best.__getitem__)
        left.remove(index)
        total += max(0.0, best[index] - reach_m)
        for other in left:
            best[other] = min(best[other], math.dist(targets[index], targets[other]))
    return total
