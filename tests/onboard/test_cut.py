"""A robot cut off in the middle of a motion: nobody stands in its way, and it is in nobody's."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.ahdc.stopping import Brake, rim_after
from onboard.courses import cut_way
from onboard.cut import limit_cut
from onboard.limits import Neighbour, Told, limit
from tests.onboard.cut_adversary import BOUNDS, BRAKE, DIAMETER_M, FaultKind, flight, search

speeds = st.floats(-0.8, 0.8)
places = st.tuples(st.floats(0, 4), st.floats(0, 5), st.floats(-math.pi, math.pi))
rim_pairs = st.tuples(speeds, speeds)
tellings = st.none() | st.builds(Told, places, rim_pairs, rim_pairs)
neighbours = st.lists(
    st.builds(
        Neighbour, st.floats(0, 4), st.floats(0, 5), speeds, speeds, st.floats(0, 1), st.floats(0, 1), tellings
    ),
    max_size=4,
)  # fmt: skip
HERE = (0.0, 0.0, 0.0)


def told(x: float, y: float, heading: float, speed: float, turn: float = 0.0, silence_s: float = 0.0) -> Neighbour:
    """A neighbour that does what it is told."""
    half = BRAKE.separation_m / 2 * turn
    rims = (speed - half, speed + half)
    velocity = (speed * math.cos(heading), speed * math.sin(heading))
    return Neighbour(x, y, *velocity, 0.0, silence_s, Told((x, y, heading), rims, rims))


@given(st.floats(-1, 1), st.floats(-8, 8), places, rim_pairs, rim_pairs, neighbours)
def test_the_rule_only_shrinks_and_a_zero_passes(v, omega, pose, wheels, asked, others) -> None:
    limited = limit_cut(v, omega, pose, wheels, asked, others, BOUNDS)
    assert abs(limited.v_mps) <= abs(v)
    assert limited.v_mps * v >= 0.0
    assert abs(limited.omega_radps) <= abs(omega)
    assert limited.omega_radps * omega >= 0.0
    assert limit_cut(0.0, omega, pose, wheels, asked, others, BOUNDS) == (0.0, omega, "")


@pytest.mark.parametrize("gap_m", [0.05, 0.2, 0.4, 0.6, 0.8])
def test_towards_a_robot_at_rest_a_cut_ends_before_it(gap_m: float) -> None:
    others = [told(0.145 + gap_m, 0.0, 1.0, 0.0)]
    speed = command = 0.0
    for _ in range(300):
        command = limit_cut(0.8, 0.0, HERE, (speed, speed), (command, command), others, BOUNDS).v_mps
        speed, _ = rim_after(speed, command, Brake(1.6, 0.15), 0.01)

    def way_m(speed: float) -> float:
        return cut_way((*HERE, speed, speed), speed, speed, BOUNDS.standing_s, BOUNDS)[-1][0]

    assert way_m(speed) <= gap_m + 1e-3
    assert speed == pytest.approx(0.8) or way_m(speed + 0.04) > gap_m


def test_what_is_beside_or_behind_does_not_slow() -> None:
    fast = (0.8, 0.8)
    for place in ((0.0, 0.2), (-0.2, 0.0), (0.4, 0.2), (-0.1, -0.15)):
        assert limit_cut(0.8, 0.0, HERE, fast, fast, [told(*place, 0.0, 0.0)], BOUNDS).by == ""
    bounds = BOUNDS._replace(brake=BRAKE._replace(fence=(0.0, 0.0, 4.0, 5.0)))
    assert limit_cut(0.8, 0.0, (3.6, 2.5, math.pi), fast, fast, [], bounds).by == ""
    assert limit_cut(0.8, 0.0, (3.6, 2.5, 0.0), fast, fast, [], bounds).by == "fence"


def test_beyond_the_edge_of_the_floor_only_the_way_back_is_free() -> None:
    bounds = BOUNDS._replace(brake=BRAKE._replace(fence=(0.0, 0.0, 4.0, 5.0)))
    still = (0.0, 0.0)
    assert limit_cut(0.3, 0.0, (4.2, 2.5, 0.0), still, still, [], bounds) == (0.0, 0.0, "fence")
    assert limit_cut(-0.3, 0.0, (4.2, 2.5, 0.0), still, still, [], bounds) == (-0.3, 0.0, "")


def test_robots_that_stand_too_near_may_only_part() -> None:
    still, near = (0.0, 0.0), [told(0.142, 0.0, 0.0, 0.0)]
    assert limit_cut(0.3, 0.0, HERE, still, still, near, BOUNDS).v_mps == 0.0
    assert limit_cut(-0.3, 0.0, HERE, still, still, near, BOUNDS).v_mps == -0.3
    assert limit_cut(0.3, 2.0, HERE, still, still, near, BOUNDS).omega_radps == 2.0
    assert limit_cut(0.3, 2.0, HERE, still, still, [told(0.0, 0.0, 0.0, 0.0)], BOUNDS).v_mps == 0.0


def test_a_neighbour_that_turns_out_of_the_way_slows_less_and_one_that_turns_into_it_more() -> None:
    def allowed(turn: float) -> float:
        other = told(0.7, 0.35, -math.pi / 2, 0.5, turn)
        return limit_cut(0.8, 0.0, HERE, (0.5, 0.5), (0.5, 0.5), [other], BOUNDS).v_mps

    assert allowed(3.0) > allowed(0.0) > allowed(-3.0)


def test_what_a_neighbour_has_been_told_counts_before_its_wheels_do_it() -> None:
    coming = told(0.8, 0.0, math.pi, 0.1)
    assert coming.told is not None
    sent = coming._replace(told=Told(coming.told.place, coming.told.rims, (0.6, 0.6)))
    pair = (0.3, 0.3)
    before, after = (limit_cut(0.8, 0.0, HERE, pair, pair, [other], BOUNDS).v_mps for other in (coming, sent))
    assert after < before


def test_a_silent_neighbour_is_expected_to_coast_not_to_brake() -> None:
    for coming in (told(0.45, 0.0, math.pi, 0.5, 0.0, 0.3), Neighbour(0.45, 0.0, -0.5, 0.0, 0.0, 0.3)):
        braking = limit(0.6, 0.0, HERE, (0.3, 0.3), [coming], BRAKE)
        assert limit_cut(0.6, 0.0, HERE, (0.3, 0.3), (0.3, 0.3), [coming], BOUNDS).v_mps < braking.v_mps


@pytest.mark.parametrize(("oldest_s", "fault"), [(0.0, "hung"), (0.08, "hung"), (0.0, "unheard"), (0.08, "deaf")])
def test_nobody_is_touched_when_one_of_two_or_three_robots_is_cut_off(oldest_s: float, fault: FaultKind) -> None:
    assert search(1, 14, oldest_s, fault=fault)[0][0] >= DIAMETER_M


@pytest.mark.parametrize(
    ("seed", "oldest_s", "fault"),
    [
        *[(seed, 0.08, "hung") for seed in (10084, 50587, 80002, 80069)],
        *[(seed, 0.0, "unheard") for seed in (5263, 5234)],
        (5296, 0.08, "unheard"),
        (5296, 0.08, "deaf"),
    ],
)
def test_flights_that_once_ended_in_contact_do_not(seed: int, oldest_s: float, fault: FaultKind) -> None:
    least = flight(seed, oldest_s, fault=fault)
    assert least is not None
    assert least >= DIAMETER_M


def test_without_the_rule_robots_are_touched() -> None:
    assert min(flight(seed, 0.08, ruled=False) or 1.0 for seed in (80002, 80069)) < DIAMETER_M - 0.02
