"""The scenario: clouds that are connected, clear and repeatable, and a bound that no mission beats."""

import math
import random
from collections.abc import Sequence

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contract.units import Point
from groundstation import targets
from groundstation.sweep import Job, play
from groundstation.targets import CloudError, lower_bound_s, scenario

SPEED_MPS, HOLD_S, REACH_M = 0.8, 1.0, 0.05
seeds = st.integers(0, 2**32 - 1)
points = st.lists(st.tuples(st.floats(0, 8), st.floats(0, 8)), min_size=1, max_size=12)


def bound(starts: Sequence[Point], cloud: Sequence[Point]) -> float:
    return lower_bound_s(starts, cloud, SPEED_MPS, HOLD_S, REACH_M)


def connected(cloud: Sequence[Point], radius_m: float) -> bool:
    seen, frontier = {0}, [0]
    while frontier:
        here = cloud[frontier.pop()]
        near = {k for k, p in enumerate(cloud) if k not in seen and math.dist(here, p) <= radius_m}
        seen |= near
        frontier += near
    return len(seen) == len(cloud)


@given(seed=seeds, robots=st.integers(1, 10), count=st.integers(1, 60))
@settings(max_examples=25)
@example(seed=1, robots=10, count=100)
def test_cloud_is_connected_clear_of_starts_and_inside_its_margins(seed: int, robots: int, count: int) -> None:
    place = scenario(robots, count, seed)
    width, height = place.size_m
    assert len(place.targets) == count
    assert connected(place.targets, 0.95)
    for k, target in enumerate(place.targets):
        assert all(0.2 <= c <= size - 0.2 for c, size in zip(target, (width, height), strict=True))
        assert all(math.dist(target, start) > 1.1 for start in place.starts)
        assert all(math.dist(target, other) >= 0.22 for other in place.targets[:k])


@given(seed=seeds, robots=st.integers(1, 30))
def test_starts_are_a_jittered_grid(seed: int, robots: int) -> None:
    starts = targets.start_grid(robots, random.Random(seed))
    assert len(starts) == robots
    assert all(math.dist(a, b) >= 0.4 - 0.061 for i, a in enumerate(starts) for b in starts[:i])
    assert connected(starts, 0.4 + 0.09)


@given(seed=seeds)
@settings(max_examples=20)
def test_same_seed_same_scenario(seed: int) -> None:
    assert scenario(6, 19, seed) == scenario(6, 19, seed)
    assert scenario(6, 19, seed) != scenario(6, 19, (seed + 1) % 2**32)


@given(seed=seeds)
@settings(max_examples=20)
def test_swarm_is_pointed_at_the_cloud(seed: int) -> None:
    place = scenario(6, 19, seed)
    error = place.start_direction_rad - targets.pointing(place.starts, place.targets)
    assert abs(math.remainder(error, math.tau)) <= 0.1 + 1e-9


@given(seed=seeds)
@settings(max_examples=20)
def test_a_seeded_cloud_is_on_the_way_out(seed: int) -> None:
    place = scenario(6, 19, seed)
    assert targets.on_the_way(place.starts, place.targets, place.start_direction_rad, 0.8)


@pytest.mark.parametrize(
    ("target", "seen"),
    [((3.0, 0.5), True), ((3.0, 0.81), False), ((3.0, -0.81), False), ((-0.7, 0.0), True), ((-0.7, 0.5), False)],
    ids=["ahead", "too far left", "too far right", "behind, in sight", "behind, out of sight"],
)
def test_what_is_on_the_way(target: Point, seen: bool) -> None:
    turn = random.Random(1).uniform(-math.pi, math.pi)

    def turned(point: Point) -> Point:
        x, y = point
        return (x * math.cos(turn) - y * math.sin(turn) + 1.0, x * math.sin(turn) + y * math.cos(turn) - 2.0)

    assert targets.on_the_way([turned((0.0, 0.0))], [turned(target)], turn, 0.8) is seen
    assert targets.on_the_way([(50.0, 50.0), turned((0.0, 0.0))], [turned(target)], turn, 0.8) is seen
    assert not targets.on_the_way([(0.0, 0.0)], [], turn, 0.8)


@pytest.mark.parametrize(("count", "area_m2"), [(1, 20.0), (19, 20.0), (50, 20.0), (100, 40.0), (500, 200.0)])
def test_floor_grows_with_the_cloud(count: int, area_m2: float) -> None:
    width, height = targets.floor_size_m(count)
    assert width * height == pytest.approx(area_m2)
    assert height / width == pytest.approx(1.25)


def test_impossible_cloud_is_refused_with_how_many_fit() -> None:
    with pytest.raises(CloudError, match=r"50 targets do not fit on 2 x 2 m; \d+ do"):
        targets.target_cloud(50, (2.0, 2.0), [(0.35, 0.35)], random.Random(1))


@pytest.mark.parametrize(
    ("starts", "cloud", "seconds"),
    [
        ([(0.0, 0.0)], [(1.65, 0.0)], 2.0),
        ([(0.0, 0.0)], [(1.65, 0.0), (2.5, 0.0)], (1.6 + 0.8) / 0.8 + 1.0),
        ([(0.0, 0.0), (0.0, 1.0)], [(1.65, 0.0), (1.65, 1.0)], 2.0),
        ([(0.0, 0.0)], [(0.01, 0.0)], 0.0),
        ([], [(1.0, 1.0)], 0.0),
        ([(1.0, 1.0)], [], 0.0),
    ],
    ids=["there", "there-hold-on", "one-each", "in-reach", "no-robot", "no-target"],
)
def test_bound_by_hand(starts: list[Point], cloud: list[Point], seconds: float) -> None:
    assert bound(starts, cloud) == pytest.approx(seconds)


@given(starts=points, cloud=points)
def test_one_robot_that_visits_all_in_any_order_does_not_beat_the_bound(
    starts: list[Point], cloud: list[Point]
) -> None:
    here, way_m = starts[0], 0.0
    for target in cloud:
        way_m += max(0.0, math.dist(here, target) - REACH_M)
        here = target
    assert way_m / SPEED_MPS + (len(cloud) - 1) * HOLD_S >= bound(starts[:1], cloud) - 1e-9


@given(starts=points, cloud=points, extra=st.tuples(st.floats(0, 8), st.floats(0, 8)))
def test_more_robots_never_raise_the_bound(starts: list[Point], cloud: list[Point], extra: Point) -> None:
    assert bound([*starts, extra], cloud) <= bound(starts, cloud) + 1e-9


@pytest.mark.parametrize(("robots", "count", "seed"), [(1, 2, 1), (2, 3, 2), (3, 6, 3), (4, 4, 4), (6, 8, 5)])
def test_no_completed_mission_beats_the_bound(robots: int, count: int, seed: int) -> None:
    result = play(Job(robots, count, seed, "field", "ideal", limit_s=90.0))
    assert result.completed, result.why
    assert result.ratio_to_lower_bound is not None
    assert result.ratio_to_lower_bound >= 1.0
