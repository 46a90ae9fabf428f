"""What the planner lets pass, keeps: stop points inside the discs, ways outside the keep-outs."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.ahdc.plan import (
    CONTACT_M,
    MOVE_SHARE,
    Motion,
    Partner,
    Planner,
    enforced_radius_m,
    inside_disc,
    make_disc,
    way_clearance_m,
)
from onboard.ahdc.stopping import rim_after, stop_tables
from tests.onboard.samples import field_parameters

PARAMETERS = field_parameters()
PLANNER = Planner(PARAMETERS, stop_tables(PARAMETERS), 0.01)
near = st.floats(-1.2, 1.2)
points = st.tuples(near, near)
rims = st.floats(-0.8, 0.8)
motions = st.builds(Motion, near, near, st.floats(-math.pi, math.pi), rims, rims)


@st.composite
def partners(draw: st.DrawFn) -> Partner:
    x, y = draw(points)
    stop = (x + draw(st.floats(-0.2, 0.2)), y + draw(st.floats(-0.2, 0.2)))
    return Partner(
        draw(st.sampled_from(["r02", "r03", "r04"])),
        draw(st.booleans()),
        (x, y),
        (stop,),
        (stop,),
        draw(st.floats(0, 0.15)),
        draw(st.booleans()),
    )


@given(motions, rims, st.floats(-6, 6), st.lists(partners(), max_size=4))
def test_a_passed_command_keeps_every_disc_or_is_the_brake(
    motion: Motion, speed: float, turn: float, others: list[Partner]
) -> None:
    command = PLANNER.choose(PLANNER.room(motion, others), speed, turn)
    brakes = PLANNER.brake_points(motion)
    ends = PLANNER.stop_points(motion, command.left_mps, command.right_mps)
    kept = True
    for partner in others:
        diameter = enforced_radius_m(PARAMETERS, partner.age_s)
        stops = (partner.long_stops, partner.short_stops)
        for brake, end, points_ in zip(brakes, ends, stops, strict=True):
            kept &= not partner.enforced or all(inside_disc(end, make_disc(brake, q, diameter)) for q in points_)
    braking = command.left_mps + command.right_mps == pytest.approx(0.0, abs=1e-12)
    assert kept or braking
    assert max(abs(command.left_mps), abs(command.right_mps)) <= PARAMETERS.max_speed_mps + 1e-9


@given(motions, rims, st.floats(-6, 6), st.lists(partners(), max_size=4))
def test_a_passed_way_keeps_half_the_gap_to_every_robot(
    motion: Motion, speed: float, turn: float, others: list[Partner]
) -> None:
    """The full rule, also for the robots that the planner leaves out as too far to bind."""
    command = PLANNER.choose(PLANNER.room(motion, others), speed, turn)
    if command.left_mps + command.right_mps == pytest.approx(0.0, abs=1e-9):
        return
    own, brake = (motion.x_m, motion.y_m), PLANNER.brake_points(motion)[0]
    end = PLANNER.stop_points(motion, command.left_mps, command.right_mps)[0]
    for partner in others:
        for point in (partner.place, *partner.long_stops):
            gap = min(math.dist(own, point), math.dist(brake, point))
            least = gap if gap <= CONTACT_M else CONTACT_M if partner.resting else (CONTACT_M + gap) / 2
            clearance = way_clearance_m(own, end, point)
            assert clearance >= min(least, math.dist(own, point)) - 1e-6


@given(motions, rims, rims)
def test_a_stop_point_moves_less_in_a_period_than_the_planner_allows_for(
    motion: Motion, left: float, right: float
) -> None:
    reach = MOVE_SHARE * PARAMETERS.max_speed_mps * PLANNER.period_s
    ends = PLANNER.stop_points(motion, left, right)
    assert all(math.dist(end, brake) < reach for end, brake in zip(ends, PLANNER.brake_points(motion), strict=True))


@given(motions, rims, st.floats(-6, 6))
def test_alone_nothing_is_held_back(motion: Motion, speed: float, turn: float) -> None:
    command = PLANNER.choose(PLANNER.room(motion, []), speed, turn)
    assert command.bound == ""


@given(motions, rims, st.floats(-6, 6), st.lists(partners(), max_size=4))
def test_the_wanted_speed_is_never_exceeded_nor_reversed(
    motion: Motion, speed: float, turn: float, others: list[Partner]
) -> None:
    command = PLANNER.choose(PLANNER.room(motion, others), speed, turn)
    forward = (command.left_mps + command.right_mps) / 2
    assert forward * speed >= -1e-12
    assert abs(forward) <= abs(speed) + 1e-12


@given(points, points, points, st.floats(0.1, 1.0))
def test_two_ends_inside_one_disc_rest_within_its_diameter(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], diameter: float
) -> None:
    disc = make_disc(a, b, diameter)
    if disc.inside and inside_disc(a, disc) and inside_disc(c, disc):
        assert math.dist(c, b) <= diameter + 1e-9 or not inside_disc(b, disc)


@given(points, points, points, st.floats(0.1, 1.0))
def test_outside_a_disc_a_way_must_lead_nearer(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], diameter: float
) -> None:
    disc = make_disc(a, b, diameter)
    if not disc.inside and inside_disc(c, disc):
        assert math.dist(c, b) <= math.dist(a, b)


@given(points, points, points)
def test_clearance_is_the_least_distance_on_the_way(
    a: tuple[float, float], b: tuple[float, float], p: tuple[float, float]
) -> None:
    sampled = min(math.dist((a[0] + (b[0] - a[0]) * k / 200, a[1] + (b[1] - a[1]) * k / 200), p) for k in range(201))
    clearance = way_clearance_m(a, b, p)
    assert clearance <= sampled + 1e-9
    assert clearance >= sampled - math.dist(a, b) / 200


def test_the_enforced_radius_shrinks_with_age() -> None:
    ages = [0.0, 0.02, 0.05, 0.1, 0.15]
    radii = [enforced_radius_m(PARAMETERS, age) for age in ages]
    assert radii == sorted(radii, reverse=True)
    assert radii[0] == pytest.approx(PARAMETERS.sensing_radius_m - PARAMETERS.link_margin_m)
    assert radii[-1] == pytest.approx(0.98 - 0.8 * 0.8 * 0.15)


def test_driving_at_a_resting_robot_stops_short_of_contact() -> None:
    """Closed loop on the weakest brake: the way never comes nearer than the contact distance."""
    brake = PLANNER.weak_brake
    x, v = -0.8, 0.0
    other = Partner("r02", False, (0.0, 0.0), ((0.0, 0.0),), ((0.0, 0.0),), 0.0, True)
    for _ in range(400):
        command = PLANNER.choose(PLANNER.room(Motion(x, 0.0, 0.0, v, v), [other]), 0.8, 0.0)
        v, way = rim_after(v, (command.left_mps + command.right_mps) / 2, brake, 0.01)
        x += way
    assert -x >= CONTACT_M - 1e-6
    assert -x < CONTACT_M + 0.05
