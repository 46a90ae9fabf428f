"""The velocity the field law wants, and the command it makes of it."""

import dataclasses
import math

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from onboard import unicycle
from onboard.ahdc import behaviour
from onboard.ahdc.field_law import CLOSING_TIME_S, FACED_RADPS, FieldLaw, clip, into_discs, keep_closing_slow
from onboard.ahdc.link_state import ON, Entry
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.plan import CONTACT_M, LOOK_AHEAD_S, TURNING_STOP_MPS, YIELD_RANGE_M, Command, Motion, Partner, Room
from onboard.ahdc.room import make_disc
from onboard.ahdc.stopping import Brake, speed_for_stop_mps
from onboard.ahdc.view import Goal, Heard, Sighted, View
from tests.onboard.samples import field_parameters, state

PARAMETERS = field_parameters(2)
WEAKLY_BRAKED = dataclasses.replace(PARAMETERS, brake_deceleration_mps2=(0.2, 0.3))
U_MAX = PARAMETERS.max_speed_mps
PERIOD_S = 0.01
OWN = (0.3, -0.2)
AT_REST = Motion(*OWN, 0.4, 0.0, 0.0)
REST = Command(0.0, 0.0, "")
angles = st.floats(-math.pi, math.pi)


def make_law(parameters: Parameters = PARAMETERS) -> FieldLaw:
    law = FieldLaw("r01", 1, parameters, PERIOD_S, unicycle.steer)
    law.joined = True
    return law


def motors(slow_s: float) -> Parameters:
    return dataclasses.replace(PARAMETERS, motor_lag_s=(0.001, slow_s))


def polar(length: float, angle_rad: float) -> Vector:
    return (length * math.cos(angle_rad), length * math.sin(angle_rad))


def plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1])


def partner(place: Vector, resting: bool = True) -> Partner:
    return Partner("r02", False, place, (place,), (place,), 0.0, resting)


def look(motion: Motion, places: tuple[Vector, ...] = ()) -> View:
    named = {f"r{k + 2:02d}": place for k, place in enumerate(places)}
    sighted = {name: Sighted(*place, 0.0, 0.0, 0.0, True) for name, place in named.items()}
    heard = {name: Heard(state(name, *place), 0.0, False) for name, place in named.items()}
    return View(9.0, motion, sighted, heard, {}, 0.0, True)


# eq. 12 and the way to the goal


@given(st.sampled_from([PARAMETERS, WEAKLY_BRAKED]), st.floats(0.0, 2.0), angles)
def test_alone_it_wants_straight_to_its_goal_and_slows_as_the_weakest_brake_needs_it(
    parameters: Parameters, left_m: float, bearing: float
) -> None:
    """Behind commands two periods late, and motors halfway between the quickest and the slowest."""
    law = make_law(parameters)
    goal = Goal(plus(OWN, polar(left_m + 0.25, bearing)), 0.25, "indicator")
    (weak, _), (quick, slow) = parameters.brake_deceleration_mps2, parameters.motor_lag_s
    speed = min(U_MAX, speed_for_stop_mps(left_m, Brake(weak, (quick + slow) / 2 + 2 * PERIOD_S)))
    assert law.velocity(goal, law.planner.room(AT_REST, [])) == pytest.approx(polar(speed, bearing), abs=1e-6)


@given(angles, angles, st.floats(0.2, 0.3))
def test_near_others_it_wants_what_eq_12_says_without_cohesion(bearing: float, aside: float, distance_m: float) -> None:
    law = make_law()
    place = plus(OWN, polar(distance_m, aside))
    ahead = polar(1.0, bearing)
    apart = behaviour.separation(OWN, [place], ahead, PARAMETERS.avoidance_radius_m)
    weights = (0.0, PARAMETERS.separation_weight, PARAMETERS.alignment_weight)
    u = behaviour.velocity(((0.0, 0.0), apart, ahead), weights, U_MAX)
    near = [(distance_m, partner(place))]
    room = law.planner.room(AT_REST, [partner(place)])
    wanted = law.velocity(Goal(plus(OWN, polar(2.0, bearing)), 0.0, "target"), room)
    assert wanted == pytest.approx(keep_closing_slow(u, OWN, near), abs=1e-6)


def test_where_it_wants_to_be_it_makes_way_for_nobody() -> None:
    law = make_law()
    room = law.planner.room(AT_REST, [partner(plus(OWN, (0.19, 0.0)))])
    for goal in (Goal(OWN, 0.0, "aside"), Goal(plus(OWN, (0.3, 0.0)), 0.4, "indicator")):
        assert law.velocity(goal, room) == (0.0, 0.0)


# towards near robots


@example(0.8, 1.2, 0.25, 1.0, True)
@example(0.8, 1.2, 0.25, 1.0, False)
@given(st.floats(0.0, 0.8), angles, st.floats(0.01, YIELD_RANGE_M - 1e-6), angles, st.booleans())
def test_towards_a_near_robot_it_goes_no_faster_than_the_gap_closes_in_time_and_steps_to_the_right(
    speed: float, course: float, distance_m: float, bearing: float, resting: bool
) -> None:
    u, n, right = polar(speed, course), polar(1.0, bearing), polar(1.0, bearing - math.pi / 2)
    near = [(distance_m, partner(plus(OWN, polar(distance_m, bearing)), resting))]
    fastest = (1.0 if resting else 0.5) * max(0.0, distance_m - CONTACT_M) / CLOSING_TIME_S
    towards = u[0] * n[0] + u[1] * n[1]
    cut = max(0.0, towards - fastest)
    new = keep_closing_slow(u, OWN, near)
    assert new[0] * n[0] + new[1] * n[1] == pytest.approx(towards - cut)
    assert new[0] * right[0] + new[1] * right[1] == pytest.approx(u[0] * right[0] + u[1] * right[1] + 0.3 * cut)


def test_far_and_coincident_robots_change_nothing_and_those_after_them_count() -> None:
    u = (0.8, 0.0)
    far, same, near = (partner(plus(OWN, (x, 0.0))) for x in (YIELD_RANGE_M + 0.01, 0.0, 0.2))
    assert keep_closing_slow(u, OWN, [(YIELD_RANGE_M + 0.01, far), (0.0, same)]) == u
    only = keep_closing_slow(u, OWN, [(0.2, near)])
    assert only != u
    assert keep_closing_slow(u, OWN, [(YIELD_RANGE_M + 0.01, far), (0.0, same), (0.2, near)]) == only


# inside the link discs


def discs(start: Vector, others: list[tuple[Vector, float]], far: bool) -> Room:
    """A room of discs of those diameters shared with partners that rest there."""
    long = [] if far else [make_disc(start, place, diameter) for place, diameter in others]
    gaps = [(math.dist(start, place), diameter, place) for place, diameter in others] if far else []
    return Room(Motion(*start, 0.0, 0.0, 0.0), (1.0, 0.0), (start, (9.0, 9.0)), long, [], gaps, [], [])


def after(start: Vector, u: Vector) -> Vector:
    return (start[0] + u[0] * LOOK_AHEAD_S, start[1] + u[1] * LOOK_AHEAD_S)


@given(st.floats(0.0, 0.8), angles, st.floats(0.5, 1.1), angles, st.floats(0.7, 0.98), st.booleans())
def test_a_velocity_leads_to_the_nearest_place_in_the_disc(
    speed: float, course: float, gap_m: float, bearing: float, diameter_m: float, far: bool
) -> None:
    """The disc shared with the partner; once outside it, the one around the partner that leads no farther away."""
    u = polar(speed, course)
    place = plus(OWN, polar(gap_m, bearing))
    if gap_m <= diameter_m:
        middle, radius = plus(OWN, polar(gap_m / 2, bearing)), diameter_m / 2
    else:
        middle, radius = place, gap_m
    wish = after(OWN, u)
    distance = math.dist(wish, middle)
    assume(abs(gap_m - diameter_m) > 1e-6)
    if distance > radius:
        wish = (
            middle[0] + (wish[0] - middle[0]) * radius / distance,
            middle[1] + (wish[1] - middle[1]) * radius / distance,
        )
    new = ((wish[0] - OWN[0]) / LOOK_AHEAD_S, (wish[1] - OWN[1]) / LOOK_AHEAD_S)
    forth = new[0] * u[0] + new[1] * u[1]
    assume(abs(forth) > 1e-9 or speed == 0.0)
    expected = new if forth > 0.0 else (0.0, 0.0)
    assert into_discs(u, discs(OWN, [(place, diameter_m)], far)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("u", [(0.5, 0.0), (0.0, 0.5), (-0.5, 0.0), (0.0, -0.5), (0.0, 0.0)])
def test_without_links_it_goes_where_it_will(u: Vector) -> None:
    assert into_discs(u, discs(OWN, [], False)) == pytest.approx(u)


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize("course", [math.pi, math.pi - 0.3])
@pytest.mark.parametrize("half_angle", [0.5, 1.0, 1.4])
def test_between_two_partners_it_stays_in_both_discs(half_angle: float, course: float, far: bool) -> None:
    """To a few millimetres: each projection onto one disc leads out of the other again by less."""
    places = [plus(OWN, polar(0.9, bearing)) for bearing in (-half_angle, half_angle)]
    end = after(OWN, into_discs(polar(U_MAX, course), discs(OWN, [(place, 0.92) for place in places], far)))
    for x, y in places:
        assert math.dist(end, ((OWN[0] + x) / 2, (OWN[1] + y) / 2)) <= 0.92 / 2 + 0.007


# commands


@given(st.floats(-20.0, 20.0))
def test_no_robot_turns_faster_than_on_the_spot(rate: float) -> None:
    assert clip(rate) == max(-6.0, min(6.0, rate))


def test_without_a_goal_or_before_it_has_joined_it_rests() -> None:
    law = make_law()
    rolling = Motion(*OWN, 0.0, 0.3, 0.3)
    assert law.command(look(rolling), None, None) == REST
    assert law.command(look(rolling), None, (2.0, 0.0)) == REST
    law.joined = False
    assert law.command(look(rolling), Goal((2.0, 0.0), 0.0, "target"), None) == REST


@pytest.mark.parametrize("parameters", [PARAMETERS, motors(0.12), motors(0.01)])
@pytest.mark.parametrize("error", [-0.4, 0.3])
def test_at_rest_without_a_goal_it_turns_on_the_spot_towards_what_it_faces(
    parameters: Parameters, error: float
) -> None:
    law = make_law(parameters)
    facing = plus(OWN, polar(1.5, AT_REST.heading_rad + error))
    gain = unicycle.turn_gain_per_s(parameters.motor_lag_s[1] + 2 * PERIOD_S)
    half = gain * error * parameters.wheel_separation_m / 2
    assert law.command(look(AT_REST), None, facing) == pytest.approx(Command(-half, half, ""))


@pytest.mark.parametrize(
    ("left_mps", "right_mps", "turns"),
    [
        (0.9 * TURNING_STOP_MPS, 0.9 * TURNING_STOP_MPS, True),
        (1.1 * TURNING_STOP_MPS, 1.1 * TURNING_STOP_MPS, False),
        (-0.1, 0.1, True),
        (0.1, 0.1, False),
        (-0.1, -0.1, False),
    ],
)
def test_it_turns_only_where_that_does_not_cancel_braking(left_mps: float, right_mps: float, turns: bool) -> None:
    command = make_law().command(look(AT_REST._replace(left_mps=left_mps, right_mps=right_mps)), None, (2.0, 2.0))
    assert (command != REST) is turns


@pytest.mark.parametrize(("share", "turns"), [(0.9, False), (1.1, True)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_it_faces_well_enough_it_does_not_turn_to(share: float, turns: bool, side: float) -> None:
    error = side * share * FACED_RADPS / unicycle.TURN_GAIN_PER_S
    command = make_law().command(look(AT_REST), None, plus(OWN, polar(1.0, AT_REST.heading_rad + error)))
    assert (command != REST) is turns


@pytest.mark.parametrize("parameters", [PARAMETERS, motors(0.01)])
@pytest.mark.parametrize("error", [-1.2, -0.2, 0.3])
def test_it_steers_towards_its_goal(parameters: Parameters, error: float) -> None:
    law = make_law(parameters)
    goal = Goal(plus(OWN, polar(2.0, AT_REST.heading_rad + error)), 0.0, "target")
    gain = unicycle.turn_gain_per_s(parameters.motor_lag_s[1] + 2 * PERIOD_S)
    speed, turn = U_MAX * math.cos(error), clip(gain * error)
    rims = unicycle.rims(speed, turn, parameters.wheel_separation_m, U_MAX)
    assert law.command(look(AT_REST), goal, None) == pytest.approx(Command(*rims, ""))


def test_at_its_goal_it_rests_bound_by_nothing() -> None:
    law = make_law()
    law.links.entries["r02"] = Entry(ON)
    for rolling in (0.0, 0.3):
        for heading in (0.0, math.pi):
            motion = Motion(*OWN, heading, rolling, rolling)
            command = law.command(look(motion, ((1.4, -0.2),)), Goal(OWN, 0.1, "hold"), (2.0, 2.0))
            assert command == REST
