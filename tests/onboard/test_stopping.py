"""The brake model against fine integration, and the properties the plan leans on."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from onboard.ahdc import stopping
from onboard.ahdc.stopping import (
    NODES,
    TABLE_RANGE,
    Brake,
    Stops,
    StopTable,
    rim_after,
    speed_for_stop_mps,
    stop_distance_m,
    stop_tables,
)
from tests.onboard.samples import field_parameters

WEAK, STRONG = Brake(1.6, 0.15), Brake(2.4, 0.06)
TRACK_M, U_MAX = 0.11, 0.8
TABLES = {brake: StopTable(brake, U_MAX, TRACK_M) for brake in (WEAK, STRONG)}
brakes = st.sampled_from([WEAK, STRONG])
speeds = st.floats(-0.8, 0.8)


def integrate(
    left: float,
    right: float,
    brake: Brake,
    step_s: float = 2e-4,
    command: tuple[float, float] = (0.0, 0.0),
    command_steps: int = 0,
) -> tuple[float, float]:
    """The resting place by small steps of the closed-form wheel, the first of them under a command."""
    x = y = heading = 0.0
    steps = 0
    while steps < command_steps or max(abs(left), abs(right)) > 1e-6:
        to_left, to_right = command if steps < command_steps else (0.0, 0.0)
        steps += 1
        left, way_left = rim_after(left, to_left, brake, step_s)
        right, way_right = rim_after(right, to_right, brake, step_s)
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


def test_wheels_without_lag_ramp_to_their_command_and_keep_it() -> None:
    at_once = Brake(2.0, 0.0)
    assert rim_after(0.0, 0.4, at_once, 0.1) == pytest.approx((0.2, 0.01))
    assert rim_after(0.0, 0.4, at_once, 1.0) == pytest.approx((0.4, 0.04 + 0.4 * 0.8))
    assert rim_after(0.4, 0.0, at_once, 1.0) == pytest.approx((0.0, 0.04))
    assert stop_distance_m(0.4, at_once) == pytest.approx(0.04)
    assert speed_for_stop_mps(0.04, at_once) == pytest.approx(0.4)


@pytest.mark.parametrize("left_m", [0.0, -0.1])
def test_where_no_way_is_left_the_speed_is_none(left_m: float) -> None:
    assert speed_for_stop_mps(left_m, WEAK) == 0.0


@pytest.mark.parametrize("brake", [WEAK, STRONG, Brake(0.3, 0.05), Brake(100.0, 0.001), Brake(2.0, 0.0)])
def test_a_new_table_holds_at_its_nodes_what_fine_integration_finds(brake: Brake) -> None:
    table = StopTable(brake, U_MAX, TRACK_M)
    middle = NODES // 2
    node_mps = U_MAX * TABLE_RANGE / middle
    step_s = (U_MAX / brake.deceleration_mps2 + 9 * brake.lag_s) / 10_000
    for i, j in ((middle, middle), (middle, -3), (20, 8), (8, 20), (-middle, 10), (-7, -20), (0, 0)):
        left, right = i * node_mps, j * node_mps
        assert math.dist(table.place(left, right), integrate(left, right, brake, min(2e-4, step_s))) < 1e-5


def test_a_new_table_is_within_half_a_millimetre_between_its_nodes() -> None:
    table = StopTable(WEAK, U_MAX, TRACK_M)
    for left, right in ((0.785, 0.785), (0.1, 0.135), (-0.41, -0.6), (0.3, -0.02), (-0.9, -0.9)):
        assert math.dist(table.place(left, right), integrate(left, right, WEAK)) < 5e-4


LIMIT_MPS = U_MAX * TABLE_RANGE
inside = st.floats(-LIMIT_MPS, LIMIT_MPS)


@given(inside, inside, brakes, st.floats(1.0, 3.0))
def test_beyond_the_range_the_edge_is_scaled_up_as_ways_to_rest_grow(
    left: float, right: float, brake: Brake, excess: float
) -> None:
    """Which grow with the square of the speed."""
    table = TABLES[brake]
    for edge in ((math.copysign(LIMIT_MPS, left), right), (left, math.copysign(LIMIT_MPS, right))):
        forward, aside = table.place(*edge)
        beyond = table.place(edge[0] * excess, edge[1] * excess)
        assert beyond == pytest.approx((forward * excess**2, aside * excess**2), abs=1e-9)


@pytest.mark.parametrize(("left", "right"), [(1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (0, 1)])
def test_one_look_reaches_to_the_edge_and_serves_tables_of_other_ranges(left: int, right: int) -> None:
    long, short, narrow = TABLES[WEAK], TABLES[STRONG], StopTable(STRONG, U_MAX / 2, TRACK_M)
    rims = (left * LIMIT_MPS, right * LIMIT_MPS)
    assert long.places(*rims, short) == (*long.place(*rims), *short.place(*rims))
    assert long.places(*rims, narrow) == (*long.place(*rims), *narrow.place(*rims))
    half = (rims[0] / 3, rims[1] / 3)
    assert long.places(*half, narrow) == (*long.place(*half), *narrow.place(*half))


@given(speeds, speeds, speeds, speeds, brakes)
def test_place_after_a_command_is_where_braking_after_it_ends(
    left: float, right: float, left_to: float, right_to: float, brake: Brake
) -> None:
    assume(abs(left - right) < 0.6 and abs(left_to - right_to) < 0.6)
    place = TABLES[brake].place_after(left, right, left_to, right_to, 0.04)
    assert math.dist(place, integrate(left, right, brake, 1e-3, (left_to, right_to), 40)) < 1e-3


@pytest.mark.parametrize("side", [1, -1])
def test_a_robot_that_stops_at_once_after_an_arc_lies_on_its_chord(side: int) -> None:
    """Half a radian in a tenth of a second; the chord points half as far aside as the robot then faces."""
    brake = Brake(100.0, 0.001)
    rims = (0.4 - side * 2.5 * TRACK_M, 0.4 + side * 2.5 * TRACK_M)
    x, y = StopTable(brake, U_MAX, TRACK_M).place_after(*rims, *rims, 0.1)
    arc_x, arc_y = integrate(*rims, brake, 1e-3, rims, 100)
    assert math.atan2(y, x) == pytest.approx(math.atan2(arc_y, arc_x), abs=1e-3)
    assert math.hypot(x, y) == pytest.approx(math.hypot(arc_x, arc_y), rel=0.015)


def test_the_long_table_is_of_the_weakest_and_slowest_brake_and_the_short_one_of_the_strongest_and_quickest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stopping, "_tables", {})  # whoever asked for the same tables before had them made
    parameters = field_parameters()
    (weak, strong), (quick, slow) = parameters.brake_deceleration_mps2, parameters.motor_lag_s
    stops = stop_tables(parameters)
    assert stops.long.brake == Brake(weak, slow)
    assert stops.short.brake == Brake(strong, quick)
    for table in stops:
        new = StopTable(table.brake, parameters.max_speed_mps, parameters.wheel_separation_m)
        for rims in ((0.9, 0.3), (0.2, -0.1)):
            assert table.place(*rims) == new.place(*rims)
            assert table.place_after(*rims, 0.5, 0.1, 0.02) == new.place_after(*rims, 0.5, 0.1, 0.02)
    assert all(a is b for a, b in zip(stops, stop_tables(field_parameters()), strict=True))
