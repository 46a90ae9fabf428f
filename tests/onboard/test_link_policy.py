"""Which links the field profile offers: the sooner none, the longer robots take to come to rest."""

import dataclasses

import pytest

from onboard import unicycle
from onboard.ahdc.field_law import ADD_SHARE, FieldLaw
from onboard.ahdc.links import OFF
from onboard.ahdc.parameters import Parameters
from onboard.ahdc.plan import Motion
from onboard.ahdc.stopping import Brake, stop_distance_m
from onboard.ahdc.view import Heard, Sighted, View
from tests.onboard.samples import field_parameters, state


def offered(parameters: Parameters, distance_m: float) -> bool:
    law = FieldLaw("r01", 1, parameters, 0.01, unicycle.steer)
    law.joined = True
    told = state("r02", distance_m)
    sighted = {"r02": Sighted(distance_m, 0.0, 0.0, 0.0, 0.0, True)}
    law.keep_links(View(9.0, Motion(0.0, 0.0, 0.0, 0.0, 0.0), sighted, {"r02": Heard(told, 0.0, False)}, {}, 0.0, True))
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
