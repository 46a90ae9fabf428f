"""How the field law sees other robots: where they are by now, and every place where they may come to rest."""

import math

import pytest

from contract.messages import NeighbourState
from onboard import unicycle
from onboard.ahdc.field_law import MAX_AGE_S, REACTION_S, SAME_PLACE_M, FieldLaw
from onboard.ahdc.link_state import OFF, ON, Entry, Link
from onboard.ahdc.parameters import Vector
from onboard.ahdc.plan import Motion, Partner
from onboard.ahdc.view import Heard, Left, Sighted, View
from tests.onboard.samples import field_parameters, state

PARAMETERS = field_parameters(3)
WEAK_MPS2, SLOW_S = PARAMETERS.brake_deceleration_mps2[0], PARAMETERS.motor_lag_s[1]


def partners(
    sighted: dict[str, Sighted], heard: dict[str, Heard], links: dict[str, Link], left: tuple[Left, ...] = ()
) -> list[Partner]:
    law = FieldLaw("r01", 1, PARAMETERS, 0.01, unicycle.steer)
    law.links.entries.update({name: Entry(link) for name, link in links.items()})
    return law.partners(View(9.0, Motion(0.0, 0.0, 0.0, 0.0, 0.0), sighted, heard, {}, 0.0, True, left))


def seen(place: Vector, v: Vector = (0.0, 0.0), age_s: float = 0.0) -> Sighted:
    return Sighted(*place, *v, age_s, True)


def told(v: Vector, moving: bool = True) -> NeighbourState:
    return state(
        "r02", 0.3, 0.2, vx_mps=v[0], vy_mps=v[1], stop_long=(0.41, 0.17), stop_short=(0.37, 0.19), moving=moving
    )


def ends(place: Vector, v: Vector) -> Vector:
    """Where it comes to rest that rolls on for the longest lag and then brakes as weakly as any."""
    speed = math.hypot(*v)
    way_m = speed * SLOW_S + speed**2 / (2 * WEAK_MPS2)
    return (place[0] + v[0] / speed * way_m, place[1] + v[1] / speed * way_m)


@pytest.mark.parametrize(
    ("link", "enforced"), [(None, False), (OFF, False), (ON, True), (Link.DOUBT, True), (Link.OFFERED, True)]
)
def test_the_plan_respects_a_link_in_every_state_but_off(link: Link | None, enforced: bool) -> None:
    links = {} if link is None else {"r02": link}
    for heard in ({}, {"r02": Heard(told((0.0, 0.0)), 0.0, False)}):
        (partner,) = partners({"r02": seen((0.3, 0.2))}, heard, links)
        assert partner.enforced is enforced


@pytest.mark.parametrize("v", [(0.2, -0.1), (-0.3, 0.4)])
def test_who_is_not_heard_may_rest_where_it_is_or_as_far_on_as_it_can_roll(v: Vector) -> None:
    (partner,) = partners({"r02": seen((0.3, 0.2), v, 0.1)}, {}, {"r02": ON})
    place = (0.3 + v[0] * 0.1, 0.2 + v[1] * 0.1)
    assert partner[:3] == ("r02", True, place)
    assert partner.long_stops == partner.short_stops
    assert partner.long_stops[0] == place
    assert partner.long_stops[1] == pytest.approx(ends(place, v))
    assert partner[5:] == (0.1, False)


def test_who_is_not_heard_and_stands_rests_where_it_is() -> None:
    (partner,) = partners({"r02": seen((0.3, 0.2))}, {}, {})
    assert partner == Partner("r02", False, (0.3, 0.2), ((0.3, 0.2),), ((0.3, 0.2),), 0.0, False)


def test_a_robot_not_seen_for_long_is_carried_on_no_longer_than_the_most() -> None:
    for heard in ({}, {"r02": Heard(told((0.0, 0.0)), 0.0, False)}):
        (partner,) = partners({"r02": seen((0.3, 0.2), (0.1, -0.2), 3.0)}, heard, {})
        assert partner.place == pytest.approx((0.3 + 0.1 * MAX_AGE_S, 0.2 - 0.2 * MAX_AGE_S))


@pytest.mark.parametrize(("age_s", "carried_s"), [(0.08, 0.08), (3.0, MAX_AGE_S)])
def test_who_is_heard_may_rest_where_it_said_or_as_far_on_as_it_has_driven_since(
    age_s: float, carried_s: float
) -> None:
    heard = {"r02": Heard(told((0.2, -0.1)), age_s, False)}
    (partner,) = partners({"r02": seen((0.32, 0.21), (0.3, 0.1), 0.02)}, heard, {"r02": ON})
    dx, dy = 0.2 * carried_s, -0.1 * carried_s
    assert partner.place == (0.32 + 0.3 * 0.02, 0.21 + 0.1 * 0.02)
    assert partner.long_stops == ((0.41, 0.17), (0.41 + dx, 0.17 + dy))
    assert partner.short_stops == ((0.37, 0.19), (0.37 + dx, 0.19 + dy))
    assert partner.age_s == age_s


@pytest.mark.parametrize("v", [(1.0, 0.0), (0.0, -1.0), (0.5, 0.5)])
def test_places_next_to_each_other_count_as_one(v: Vector) -> None:
    for age_s, hypotheses in ((0.9 * SAME_PLACE_M, 1), (1.1 * SAME_PLACE_M, 2)):
        (partner,) = partners({"r02": seen((0.3, 0.2))}, {"r02": Heard(told(v), age_s, False)}, {})
        assert (len(partner.long_stops), len(partner.short_stops)) == (hypotheses, hypotheses)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("silent", [True, False])
def test_only_who_says_so_now_is_at_rest(moving: bool, silent: bool) -> None:
    (partner,) = partners({"r02": seen((0.3, 0.2))}, {"r02": Heard(told((0.0, 0.0), moving), 0.0, silent)}, {})
    assert partner.resting is (not moving and not silent)


def test_everybody_seen_is_a_partner_heard_or_not() -> None:
    sighted = {name: seen((0.3, 0.1 * k)) for k, name in enumerate(("r02", "r03", "r04"))}
    found = partners(sighted, {"r03": Heard(state("r03", 0.3, 0.1), 0.0, False)}, {})
    assert [partner.robot for partner in found] == ["r02", "r03", "r04"]


@pytest.mark.parametrize(("age_s", "since_s"), [(0.1, 0.1), (2.0, REACTION_S)])
@pytest.mark.parametrize("v", [(-0.3, 0.2), (0.0, 0.0)])
def test_a_linked_robot_that_has_jumped_is_held_on_to_where_it_was_as_well(
    age_s: float, since_s: float, v: Vector
) -> None:
    """It holds within REACTION_S of the jump."""
    left = (Left("r02", Sighted(-0.4, 0.1, *v, age_s, False), True),)
    here, there = partners({"r02": seen((0.3, 0.2))}, {}, {"r02": ON}, left)
    ahead = (-0.4 + v[0] * since_s, 0.1 + v[1] * since_s)
    assert here.place == (0.3, 0.2)
    assert there[:3] == ("r02", True, (-0.4, 0.1))
    assert there.long_stops == there.short_stops
    assert there.long_stops[0] == (-0.4, 0.1)
    assert there.long_stops[1] == pytest.approx(ahead if v == (0.0, 0.0) else ends(ahead, v))
    assert there[5:] == (since_s, False)


@pytest.mark.parametrize(("was_linked", "link"), [(False, ON), (True, OFF)])
def test_without_a_link_then_and_now_nobody_is_held_on_to(was_linked: bool, link: Link) -> None:
    left = (Left("r02", Sighted(-0.4, 0.1, 0.0, 0.0, 0.1, False), was_linked),)
    assert len(partners({"r02": seen((0.3, 0.2))}, {}, {"r02": link}, left)) == 1
