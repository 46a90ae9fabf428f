"""Where a robot may come to rest: radii that shrink with age, discs shared with partners, circles to keep out of."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.ahdc.room import (
    CONTACT_M,
    CREEP_SHARE,
    Disc,
    enforced_radius_m,
    inside_disc,
    keepout,
    make_disc,
    way_clearance_m,
)
from tests.onboard.samples import field_parameters

PARAMETERS = field_parameters()
near = st.floats(-1.2, 1.2).map(lambda x: round(x, 3))
points = st.tuples(near, near)
START, PARTNER = (0.1, 0.5), (0.7, -0.3)
"""1 m apart."""


@pytest.mark.parametrize(("age_s", "radius_m"), [(0.0, 0.98), (0.1, 0.98 - 0.064), (0.5, 0.98 - 0.32), (9.0, 0.2)])
def test_a_link_s_radius_is_r_c_less_the_margin_and_shrinks_with_age_down_to_the_avoidance_radius(
    age_s: float, radius_m: float
) -> None:
    """0.8 of u_max, 0.8 m/s, times the age."""
    assert enforced_radius_m(PARAMETERS, age_s) == pytest.approx(radius_m)


@pytest.mark.parametrize("diameter_m", [0.98, 1.0, 1.2])
def test_a_disc_lies_around_the_middle_and_its_rim_is_inside(diameter_m: float) -> None:
    disc = make_disc((0.0, 0.0), (0.6, 0.8), diameter_m)
    assert disc.inside == (diameter_m >= 1.0)
    disc = make_disc(START, PARTNER, diameter_m)
    middle = pytest.approx((0.4, 0.1))
    assert disc == Disc(START, PARTNER, diameter_m / 2, middle, pytest.approx(1.0), disc.inside)


def test_a_stop_point_inside_may_go_as_far_as_the_rim() -> None:
    disc = make_disc((0.0, 0.25), (0.5, 0.25), 1.0)
    for x, inside in ((-0.25, True), (-0.26, False), (0.75, True), (0.76, False)):
        assert inside_disc((x, 0.25), disc) == inside


@given(points, points, st.floats(0.1, 1.0), st.floats(0.0, 0.3), st.floats(0.0, 1.0))
def test_two_stop_points_in_their_disc_are_a_link_s_radius_apart_at_most(
    start: tuple[float, float], partner: tuple[float, float], diameter_m: float, way_m: float, turn: float
) -> None:
    """Each end checks its own stop point against the same disc."""
    angle = math.tau * turn
    ends = (start[0] + way_m * math.cos(angle), start[1] + way_m * math.sin(angle)), partner
    discs = make_disc(start, partner, diameter_m), make_disc(partner, start, diameter_m)
    if discs[0].inside and all(inside_disc(end, disc) for end, disc in zip(ends, discs, strict=True)):
        assert math.dist(*ends) <= diameter_m + 1e-9


@pytest.mark.parametrize(
    ("gain_share", "passes"), [(1.0, True), (1.01 * CREEP_SHARE, True), (0.9 * CREEP_SHARE, False), (-1.0, False)]
)
def test_outside_a_disc_a_way_must_bring_it_nearer_by_a_share_of_its_length(gain_share: float, passes: bool) -> None:
    disc = make_disc((1.2, 0.0), (0.0, 0.0), 0.98)
    gap_m = 1.2 - gain_share * 0.1
    x = (1.2**2 + gap_m**2 - 0.1**2) / (2 * 1.2)  # 0.1 m from the start, gap_m from the partner
    end = (x, math.sqrt(max(0.0, gap_m**2 - x**2)))
    assert math.dist(end, disc.start) == pytest.approx(0.1, abs=1e-6)
    assert inside_disc(end, disc) == passes


def test_outside_a_disc_braking_at_once_is_never_refused() -> None:
    disc = make_disc(START, PARTNER, 0.5)
    assert inside_disc(START, disc)


@pytest.mark.parametrize(
    ("gap_m", "distance_m", "resting", "radius_m"),
    [
        (0.57, 0.67, False, 0.37),
        (0.57, 0.67, True, CONTACT_M),
        (0.67, 0.57, False, 0.37),
        (CONTACT_M, 0.3, False, CONTACT_M),
        (0.12, 0.3, False, 0.12),
        (0.12, 0.3, True, 0.12),
        (0.3, 0.12, False, 0.12),
    ],
)
def test_kept_out_of_is_half_of_what_is_left_to_contact_all_of_it_to_one_at_rest_and_never_nearer_than_now(
    gap_m: float, distance_m: float, resting: bool, radius_m: float
) -> None:
    expected = ((0.3, 0.4), pytest.approx(radius_m), pytest.approx(distance_m - radius_m))
    assert keepout((0.3, 0.4), gap_m, distance_m, resting) == expected


@pytest.mark.parametrize(
    ("end", "point", "clearance_m"),
    [
        ((0.2, 0.3), (0.5, 0.7), 0.5),
        ((0.6, 0.3), (0.4, 0.8), 0.5),
        ((0.6, 0.3), (0.9, 0.7), 0.5),
        ((0.6, 0.3), (-0.1, -0.1), 0.5),
        ((0.2, 0.9), (0.4, 0.6), 0.2),
    ],
    ids=["no way at all", "beside it", "beyond its end", "behind its start", "beside one upwards"],
)
def test_the_clearance_of_a_way_from_a_known_place(
    end: tuple[float, float], point: tuple[float, float], clearance_m: float
) -> None:
    assert way_clearance_m((0.2, 0.3), end, point) == pytest.approx(clearance_m)


@given(points, points, points)
def test_the_clearance_of_a_way_is_the_least_distance_to_any_place_on_it(
    start: tuple[float, float], end: tuple[float, float], point: tuple[float, float]
) -> None:
    places = [tuple(a + k / 100 * (b - a) for a, b in zip(start, end, strict=True)) for k in range(101)]
    sampled = min(math.dist(place, point) for place in places)
    clearance = way_clearance_m(start, end, point)
    assert clearance <= sampled + 1e-9
    assert clearance >= sampled - math.dist(start, end) / 200 - 1e-9
