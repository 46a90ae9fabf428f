"""The brake model against fine integration, and the properties the plan leans on."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.ahdc.stopping import Brake, Stops, StopTable, rim_after, speed_for_stop_mps, stop_distance_m

WEAK, STRONG = Brake(1.6, 0.15), Brake(2.4, 0.06)
TRACK_M, U_MAX = 0.11, 0.8
TABLES = {brake: StopTable(brake, U_MAX, TRACK_M) for brake in (WEAK, STRONG)}
brakes = st.sampled_from([WEAK, STRONG])
speeds = st.floats(-0.8, 0.8)


def integrate(left: float, right: float, brake: Brake, step_s: float = 2e-4) -> tuple[float, float]:
    """The resting place by small steps of the closed-form wheel."""
    x = y = heading = 0.0
    while max(abs(left), abs(right)) > 1e-5:
        left, way_left = rim_after(left, 0.0, brake, step_s)
        right, way_right = rim_after(right, 0.0, brake, step_s)
        turn = (way_right - way_left) / TRACK_M
        way = (way_left + way_right) / 2
        x += way * math.cos(heading + turn / 2)
        y += way * math.sin(heading + turn / 2)
        heading += turn
    return (x, y)


@given(speeds, speeds, brakes, st.floats(0.001, 0.5))
def test_a_rim_follows_its_command_as_small_steps_do(speed: float, command: float, brake: Brake, time_s: float) -> None:
    v, way = speed, 0.0
    steps = 2000
    for _ in range(steps):
        slope = max(-brake.deceleration_mps2, min(brake.deceleration_mps2, (command - v) / brake.lag_s))
        new = v + slope * time_s / steps
        way += (v + new) / 2 * time_s / steps
        v = new
    assert rim_after(speed, command, brake, time_s) == pytest.approx((v, way), abs=2e-4)


@given(speeds, brakes)
def test_stop_distance_is_the_straight_resting_place(speed: float, brake: Brake) -> None:
    assert abs(integrate(speed, speed, brake)[0]) == pytest.approx(stop_distance_m(speed, brake), abs=1e-4)
    assert speed_for_stop_mps(stop_distance_m(speed, brake), brake) == pytest.approx(abs(speed), abs=1e-6)


@given(speeds, st.floats(-0.33, 0.33), brakes)
def test_the_table_is_within_half_a_millimetre_of_fine_integration(mean: float, half: float, brake: Brake) -> None:
    left, right = (max(-U_MAX, min(U_MAX, rim)) for rim in (mean - half, mean + half))
    assert math.dist(TABLES[brake].place(left, right), integrate(left, right, brake)) < 5e-4


@given(speeds, speeds, brakes, st.floats(0.005, 0.02))
def test_place_after_braking_command_is_the_same_place(
    left: float, right: float, brake: Brake, period_s: float
) -> None:
    now = TABLES[brake].place(left, right)
    later = TABLES[brake].place_after(left, right, 0.0, 0.0, period_s)
    assert math.dist(now, later) < 1e-3


@given(speeds, brakes)
def test_the_weak_brake_rolls_farther(speed: float, brake: Brake) -> None:
    assert stop_distance_m(speed, WEAK) >= stop_distance_m(speed, STRONG)
    assert TABLES[brake].place(speed, speed)[0] * speed >= 0


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_one_look_at_both_tables_finds_what_each_finds(left: float, right: float) -> None:
    long, short = TABLES[WEAK], TABLES[STRONG]
    assert Stops(long, short).places(left, right) == (*long.place(left, right), *short.place(left, right))
