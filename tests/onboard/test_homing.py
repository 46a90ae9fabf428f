"""The way home: free directions never enter a disc or leave the fence; arrival, resting and going back."""

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from onboard.ahdc.plan import Motion
from onboard.ahdc.view import Sighted, View
from onboard.homing import ARRIVED_M, FREE_M, Disc, Home, Homing, free_length_m
from onboard.limits import bounds_of
from tests.onboard.samples import arena, field_parameters

BOUNDS = bounds_of(arena())
INSIDE = st.tuples(st.floats(0.2, 3.8), st.floats(0.2, 4.8))
ANGLE = st.floats(-math.pi, math.pi)


MIDDLE = Home(2.0, 2.0, 0.0)


def homing(home: Home = MIDDLE) -> Homing:
    return Homing("r01", home, field_parameters(), BOUNDS, 0.01)


def view(
    x_m: float, y_m: float, heading_rad: float, others: dict[str, Sighted] | None = None, now_s: float = 0.0
) -> View:
    motion = Motion(x_m, y_m, heading_rad, 0.0, 0.0)
    return View(now_s, motion, others or {}, {}, {}, 0.0, True)


@given(INSIDE, ANGLE, st.lists(st.tuples(INSIDE, st.floats(0.1, 0.3)), max_size=5))
def test_what_is_free_enters_no_disc_and_stays_inside_the_fence(
    own: tuple[float, float], angle: float, others: list[tuple[tuple[float, float], float]]
) -> None:
    discs = [Disc(*place, radius) for place, radius in others]
    assume(all(math.dist(own, disc[:2]) > disc.radius_m for disc in discs))
    way = (math.cos(angle), math.sin(angle))
    free_m = free_length_m(own, way, discs, BOUNDS, FREE_M)
    assert 0.0 <= free_m <= FREE_M
    for share in (0.25, 0.5, 0.75, 1.0):
        x, y = own[0] + share * free_m * way[0], own[1] + share * free_m * way[1]
        assert all(math.dist((x, y), disc[:2]) >= disc.radius_m - 1e-6 for disc in discs)
        low_x, low_y, high_x, high_y = BOUNDS.fence
        assert low_x - 1e-9 <= x <= high_x + 1e-9
        assert low_y - 1e-9 <= y <= high_y + 1e-9


@given(ANGLE)
def test_from_inside_a_disc_only_the_way_out_is_free(angle: float) -> None:
    own, way = (2.0, 2.0), (math.cos(angle), math.sin(angle))
    free_m = free_length_m(own, way, [Disc(2.1, 2.0, 0.2)], BOUNDS, FREE_M)
    assert (free_m == 0.0) == (way[0] > 0.0)


@given(st.floats(0.1, 1.5), ANGLE, ANGLE)
def test_alone_it_goes_straight_and_slows_down_to_arrive(away_m: float, bearing: float, heading: float) -> None:
    law = homing()
    law.begin(0.0)
    u = law._velocity((2.0 - away_m * math.cos(bearing), 2.0 - away_m * math.sin(bearing)), (2.0, 2.0), [], 0.0)
    assert abs(math.remainder(math.atan2(u[1], u[0]) - bearing, math.tau)) < 1e-9
    assert 0.0 < math.hypot(*u) <= 0.48 + 1e-9
    assert math.hypot(*u) ** 2 / (2 * 1.6) < away_m


def test_at_home_it_turns_to_its_heading_rests_and_goes_back_when_carried_off() -> None:
    law = homing()
    turning = law.decide(view(2.0, 2.0 + ARRIVED_M / 2, 1.0))
    assert turning.left_mps == -turning.right_mps > 0
    assert not law.arrived
    resting = law.decide(view(2.0, 2.0, 0.05))
    assert (resting.left_mps, resting.right_mps) == (0.0, 0.0)
    assert law.arrived
    assert law.decide(view(2.05, 2.0, 0.1))[:2] == (0.0, 0.0), "a little off is no reason to move"
    assert law.decide(view(2.3, 2.0, 0.0))[:2] != (0.0, 0.0)
    assert not law.arrived


def test_without_leave_it_rests_and_its_patience_does_not_run_out() -> None:
    law = homing()
    law.begin(0.0)
    for now_s in range(30):
        assert law.decide(view(3.0, 2.0, 0.0, now_s=now_s)._replace(may_move=False))[:2] == (0.0, 0.0)
    assert law._detours == 0


def test_robots_that_meet_pass_on_the_right() -> None:
    law = homing(Home(3.0, 2.0, 0.0))
    other = Sighted(2.4, 2.0, -0.3, 0.0, 0.0, True)
    u = law._velocity((2.1, 2.0), (3.0, 2.0), [law._disc(other)], 0.0)
    assert u[0] > 0
    assert u[1] < 0
