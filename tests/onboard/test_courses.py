"""Ways of robots that brake or are cut off against their fine integration; the line between two ways."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.ahdc.stopping import Brake, rim_after
from onboard.courses import brake_way, cut_bounds, cut_way
from onboard.hulls import Way, least, nearest
from tests.onboard.cut_adversary import BOUNDS, BRAKE
from tests.onboard.samples import arena

rims = st.tuples(st.floats(-0.2, 0.8), st.floats(-0.2, 0.8))
points = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=9)
WEAK, COAST = Brake(1.6, 0.15), Brake(0.6, 0.0)


def test_the_bounds_of_an_arena() -> None:
    bounds = cut_bounds(arena())
    assert bounds.standing_s == pytest.approx(0.22)
    assert bounds.contact_m == pytest.approx(0.145)
    assert bounds.beyond_fence_m == pytest.approx(0.08)
    assert bounds.coast_m(0.8) == pytest.approx(0.64 / 1.2)


def fine_way(speeds: tuple[float, float], asked: tuple[float, float], standing_s: float, after: Brake) -> Way:
    """From the origin along x: the weakest drive while a command stands, then that brake."""
    x = y = heading = 0.0
    left, right = speeds
    way = []
    for step in range(2200):
        stands = step * 0.001 < standing_s
        brake, (left_to, right_to) = (WEAK, asked) if stands else (after, (0.0, 0.0))
        left, left_m = rim_after(left, left_to, brake, 0.001)
        right, right_m = rim_after(right, right_to, brake, 0.001)
        turn, rolled_m = (right_m - left_m) / BRAKE.separation_m, (left_m + right_m) / 2
        x, y = x + rolled_m * math.cos(heading + turn / 2), y + rolled_m * math.sin(heading + turn / 2)
        heading += turn
        way.append((x, y))
    return way


def beyond_m(hull: Way, way: Way) -> float:
    """How far a way gets out of the hull of another, over 64 directions."""
    directions = [(math.cos(k * math.tau / 64), math.sin(k * math.tau / 64)) for k in range(64)]
    return max(least(hull, *axis) - least(way, *axis) for axis in directions)


@pytest.mark.parametrize("seed", range(12))
def test_ways_hold_those_of_the_fine_integration(seed: int) -> None:
    draw = random.Random(seed)
    speeds = draw.uniform(-0.2, 0.8), draw.uniform(-0.2, 0.8)
    asked = speeds if seed % 2 else (draw.uniform(-0.2, 0.8), draw.uniform(-0.2, 0.8))
    course = (0.0, 0.0, 0.0, *speeds)
    coasting = fine_way(speeds, asked, 0.22, COAST)
    assert beyond_m(cut_way(course, *asked, 0.22, BOUNDS), coasting) < 0.01
    braking = fine_way(speeds, asked, 0.04, WEAK)
    assert beyond_m(brake_way(course, *asked, 0.04, BRAKE), braking) < 0.01


@given(rims, rims, st.floats(-3, 3))
def test_a_way_turns_with_the_heading_and_mirrors_with_the_rims(speeds, asked, heading) -> None:
    way = cut_way((0.0, 0.0, 0.0, *speeds), *asked, 0.22, BOUNDS)
    turned = cut_way((1.0, 2.0, heading, *speeds), *asked, 0.22, BOUNDS)
    mirrored = cut_way((0.0, 0.0, 0.0, *speeds[::-1]), *asked[::-1], 0.22, BOUNDS)
    cosine, sine = math.cos(heading), math.sin(heading)
    for (x, y), there, other in zip(way, turned, mirrored, strict=True):
        assert there == pytest.approx((1.0 + cosine * x - sine * y, 2.0 + sine * x + cosine * y), abs=1e-9)
        assert other == pytest.approx((x, -y), abs=1e-9)


def test_a_robot_at_rest_that_is_told_nothing_stays() -> None:
    course = (1.0, 2.0, 0.5, 0.0, 0.0)
    for way in (cut_way(course, 0.0, 0.0, 0.22, BOUNDS), brake_way(course, 0.0, 0.0, 0.04, BRAKE)):
        assert all(point == pytest.approx((1.0, 2.0)) for point in way)


@given(points, points)
def test_the_line_between_two_ways_parts_them_as_far_as_any_can(mine, theirs) -> None:
    widest = max(
        least(mine, x, y) + least(theirs, -x, -y)
        for x, y in ((math.cos(k * math.tau / 90), math.sin(k * math.tau / 90)) for k in range(90))
    )
    found = nearest(mine, theirs)
    if found is None:
        assert widest < 1e-3
        return
    x, y, begins, ends = found
    assert math.hypot(x, y) == pytest.approx(1.0)
    assert begins == pytest.approx(least(mine, x, y))
    assert ends == pytest.approx(-least(theirs, -x, -y))
    assert begins - ends >= widest - 0.02 * abs(widest) - 1e-3


@given(points, points)
def test_both_robots_find_the_same_line(mine, theirs) -> None:
    here, there = nearest(mine, theirs), nearest(theirs, mine)
    if here is None or there is None or here[2] - here[3] < 0.01:
        return
    gap = here[2] - here[3]
    assert there[2] - there[3] == pytest.approx(gap, rel=0.02)
    assert here[0] * there[0] + here[1] * there[1] < -0.97
