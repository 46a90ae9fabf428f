"""Which links the field profile offers: the sooner none, the longer robots take to come to rest."""

import dataclasses

import pytest
from msgspec.structs import replace

from contract.messages import NeighbourState
from onboard import unicycle
from onboard.ahdc.field_law import ADD_SHARE, FieldLaw
from onboard.ahdc.links import OFF, ON, Link
from onboard.ahdc.parameters import Parameters
from onboard.ahdc.plan import Motion
from onboard.ahdc.stopping import Brake, stop_distance_m
from onboard.ahdc.view import Heard, Sighted, View
from tests.onboard.link_ends import life, sent, tell
from tests.onboard.samples import field_parameters, state


def hears(law: FieldLaw, told: NeighbourState, silent: bool = False) -> None:
    """One step of a robot at the origin that sees and hears one other."""
    sighted = {told.robot: Sighted(told.x_m, told.y_m, 0.0, 0.0, 0.0, True)}
    heard = {told.robot: Heard(told, 0.0, silent)}
    law.keep_links(View(9.0, Motion(0.0, 0.0, 0.0, 0.0, 0.0), sighted, heard, {}, 0.0, True))


def joined_law(robot: str, parameters: Parameters) -> FieldLaw:
    law = FieldLaw(robot, 1, parameters, 0.01, unicycle.steer)
    law.joined = True
    return law


def offered(parameters: Parameters, distance_m: float) -> bool:
    law = joined_law("r01", parameters)
    hears(law, state("r02", distance_m))
    entry = law.links.entries.get("r02")
    return entry is not None and entry.state is not OFF


@pytest.mark.parametrize(
    ("brake", "lag"), [((100.0, 100.0), (0.001, 0.001)), ((1.6, 2.4), (0.06, 0.15)), ((0.2, 0.3), (0.1, 0.2))]
)
def test_links_are_offered_up_to_what_half_the_longest_way_to_rest_leaves(
    brake: tuple[float, float], lag: tuple[float, float]
) -> None:
    parameters = dataclasses.replace(field_parameters(2), brake_deceleration_mps2=brake, motor_lag_s=lag)
    way_m = stop_distance_m(parameters.max_speed_mps, Brake(brake[0], lag[1]))
    whole_m = parameters.link_radius_m
    limit_m = ADD_SHARE * max(whole_m / 2, whole_m - way_m / 2)
    assert offered(parameters, limit_m - 0.001)
    assert not offered(parameters, limit_m + 0.001)


@pytest.mark.parametrize("other", ["r01", "r05"])
def test_a_link_that_the_other_end_has_given_up_is_offered_anew_however_long_it_is(other: str) -> None:
    law = joined_law("r03", field_parameters(2))
    tell(law.links, other, "add", life(other, 1))
    tell(law.links, other, "confirm", life(other, 1))
    for kept in ({"links_on": ("r03",)}, {"links_kept": ("r03", "r04")}):
        hears(law, replace(state(other, 0.99), **kept))
        assert law.links.state(other) is ON
    forgot = replace(state(other, 0.99), links_on=("r04",))
    hears(law, forgot, silent=True)
    assert law.links.state(other) is ON
    hears(law, forgot)
    assert law.links.state(other) is Link.OFFERED
    (offer,) = sent(law.links)
    assert (offer.to, offer.kind) == (other, "add")
    hears(law, forgot)
    assert sent(law.links) == [], "said again after a while only"
    assert [m.kind for m in tell(law.links, other, "accept", offer.tx)] == ["confirm"]
    assert law.links.state(other) is ON


def test_nothing_is_offered_to_one_that_is_taken_out() -> None:
    law = joined_law("r03", field_parameters(2))
    hears(law, state("r05", 0.3))
    assert law.links.state("r05") is Link.OFFERED
    tell(law.links, "r05", "accept", law.links.entries["r05"].life)
    law.excluded = frozenset({"r05"})
    hears(law, state("r05", 0.3))
    assert law.links.state("r05") is ON
