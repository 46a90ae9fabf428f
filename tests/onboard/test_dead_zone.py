"""Wheels that do not turn at a creeping command: what a robot learns of them, and how it comes home on them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.dead_zone import GROWTH, STANDS_S, DeadZone

SPEED = st.floats(-1.0, 1.0)


def learnt(true_mps: float, told_mps: float, seconds: float = 10.0) -> DeadZone:
    """A robot that wants ``told_mps``, on wheels that turn from ``true_mps`` on."""
    zone = DeadZone(0.48)
    for step in range(int(seconds * 12)):
        (told, _) = zone.raised(told_mps, 0.0)
        zone.saw(told, told if told >= true_mps else 0.0, step / 12)
    return zone


@given(true_mps=st.floats(0.001, 0.45), told_mps=st.floats(0.004, 0.48))
def test_it_finds_a_command_that_turns_the_wheels_and_not_much_more(true_mps: float, told_mps: float) -> None:
    zone = learnt(true_mps, told_mps)
    if told_mps >= true_mps:
        assert zone.least_mps == 0.0
    else:
        assert true_mps <= zone.least_mps <= GROWTH * true_mps + 1e-9


def test_wheels_that_never_turn_are_told_no_more_than_the_most() -> None:
    assert learnt(1.0, 0.01).least_mps == 0.48


def test_a_start_takes_time_and_rest_teaches_nothing() -> None:
    zone = DeadZone(0.48)
    zone.saw(0.0, 0.0, 0.0)
    zone.saw(0.01, 0.0, STANDS_S)
    zone.saw(0.01, 0.0, STANDS_S + 1e-6)
    assert zone.least_mps == pytest.approx(GROWTH * 0.01)
    zone.forget(10.0)
    zone.saw(0.01, 0.0, 10.0 + 0.9 * STANDS_S)
    zone.saw(0.0, 0.0, 20.0)
    zone.saw(0.01, 0.0, 20.0 + 0.9 * STANDS_S)
    zone.saw(0.01, 0.0025 + 1e-9, 21.0)
    zone.saw(0.01, 0.0, 21.0 + 0.9 * STANDS_S)
    assert zone.least_mps == 0.0


@given(least_mps=st.floats(0.0, 0.48), left=SPEED, right=SPEED)
def test_both_rims_are_raised_by_one_factor_and_a_zero_stays(least_mps: float, left: float, right: float) -> None:
    zone = DeadZone(0.48)
    zone.least_mps = least_mps
    a, b = zone.raised(left, right)
    assert a * right == pytest.approx(b * left, abs=1e-9)
    assert abs(a) >= abs(left)
    assert abs(b) >= abs(right)
    if left or right:
        assert max(abs(a), abs(b)) == pytest.approx(max(abs(left), abs(right), least_mps))
    else:
        assert (a, b) == (0.0, 0.0)


def test_how_exactly_it_arrives_follows_from_the_slowest_command() -> None:
    zone = DeadZone(0.48)
    assert zone.roll_m(1.6) == 0.0
    zone.least_mps = 0.4
    assert zone.roll_m(1.6) == pytest.approx(0.08 + 0.05)
