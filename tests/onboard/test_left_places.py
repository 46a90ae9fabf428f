"""A linked robot that has jumped is at one of two places, and the law answers for both."""

import math

from hypothesis import given
from hypothesis import strategies as st

from onboard import unicycle
from onboard.ahdc.field_law import REACTION_S, FieldLaw
from onboard.ahdc.link_state import Entry
from onboard.ahdc.links import ON
from onboard.ahdc.parameters import Vector
from onboard.ahdc.plan import Motion, enforced_radius_m
from onboard.ahdc.stopping import stop_distance_m
from onboard.ahdc.view import Goal, Heard, Left, Sighted, View
from tests.onboard.samples import field_parameters, state

PARAMETERS = field_parameters(2)
PERIOD_S = 0.01
"""Of one step, in which the wheels are taken to do what they are told."""


def law_with(linked: bool = True) -> FieldLaw:
    law = FieldLaw("r01", 1, PARAMETERS, PERIOD_S, unicycle.steer)
    law.joined = True
    if linked:
        law.links.entries["r02"] = Entry(ON)
    return law


def view(motion: Motion, seen_at: Vector, left: tuple[Left, ...], now_s: float = 9.0) -> View:
    sighted = {"r02": Sighted(*seen_at, 0.0, 0.0, 0.0, True)}
    told = state("r02", *seen_at, moving=False, links_on=("r01",))
    return View(now_s, motion, sighted, {"r02": Heard(told, 0.0, False)}, {}, 0.0, True, left)


def was(x_m: float, y_m: float, vx_mps: float = 0.0, age_s: float = 1.0, linked: bool = True) -> Left:
    return Left("r02", Sighted(x_m, y_m, vx_mps, 0.0, age_s, False), linked)


def rest(law: FieldLaw, left: tuple[Left, ...], seen_at: Vector, goal: Vector) -> Vector:
    """Where a robot that starts at the origin, at rest, ends on its way to a goal."""
    x, y, heading, left_mps, right_mps = 0.0, 0.0, math.atan2(goal[1], goal[0]), 0.0, 0.0
    for _ in range(1000):
        motion = Motion(x, y, heading, left_mps, right_mps)
        left_mps, right_mps, _ = law.command(view(motion, seen_at, left), Goal(goal, 0.0, "start"), None)
        speed, turn = unicycle.body(left_mps, right_mps, PARAMETERS.wheel_separation_m)
        heading += turn * PERIOD_S
        x, y = x + speed * math.cos(heading) * PERIOD_S, y + speed * math.sin(heading) * PERIOD_S
    return (x, y)


@given(bearing=st.floats(-math.pi, math.pi), was_m=st.floats(0.3, 0.6), seen_m=st.floats(0.3, 0.6))
def test_it_stays_in_reach_of_both_places(bearing: float, was_m: float, seen_m: float) -> None:
    there, seen_at = (-was_m, 0.0), (seen_m * math.cos(bearing), seen_m * math.sin(bearing))
    reach_m = enforced_radius_m(PARAMETERS, REACTION_S)
    for goal in ((5.0, 0.0), (0.0, 5.0)):
        end = rest(law_with(), (was(*there),), seen_at, goal)
        assert math.dist(end, there) <= reach_m + 1e-6
        assert math.dist(end, seen_at) <= PARAMETERS.link_radius_m + 1e-6


def test_without_a_link_then_or_now_it_goes_where_it_will() -> None:
    seen_at, goal = (0.5, 0.0), (0.9, 0.0)
    free = rest(law_with(), (), seen_at, goal)
    assert rest(law_with(), (was(-0.5, 0.0, linked=False),), seen_at, goal) == free
    assert rest(law_with(linked=False), (was(-0.5, 0.0),), seen_at, goal) == rest(
        law_with(linked=False), (), seen_at, goal
    )
    assert rest(law_with(), (was(-0.5, 0.0),), seen_at, goal) != free


def test_one_that_was_driving_may_have_come_to_rest_as_far_on_as_it_could_brake() -> None:
    law = law_with()
    place = was(-0.4, 0.0, -0.5)
    partners = law.partners(view(Motion(0.0, 0.0, 0.0, 0.0, 0.0), (0.3, 0.0), (place,)))
    seen, jumped = partners
    way_m = stop_distance_m(0.5, law.planner.weak_brake)
    assert seen.place == (0.3, 0.0)
    assert jumped.place == (-0.4, 0.0)
    assert jumped.enforced
    assert not jumped.resting
    assert jumped.age_s == REACTION_S
    assert jumped.long_stops == jumped.short_stops
    (nearest, _), (farthest, _) = jumped.long_stops
    assert nearest == -0.4
    assert -0.75 <= farthest <= -0.4 - 0.5 * REACTION_S - way_m


def test_a_link_to_a_robot_in_doubt_is_not_vouched_for() -> None:
    law = law_with()
    motion = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
    law.keep_links(view(motion, (0.3, 0.0), ()))
    assert law.links.vouches("r02")
    law.keep_links(view(motion, (0.3, 0.0), (was(-0.5, 0.0),)))
    assert not law.links.vouches("r02")
    law.keep_links(view(motion, (0.3, 0.0), ()))
    assert law.links.vouches("r02")
