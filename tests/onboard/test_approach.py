"""The end of the way to a target: a robot brakes as soon as that suffices, and not before."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard import unicycle
from onboard.ahdc.field_law import FieldLaw
from onboard.ahdc.plan import Motion
from onboard.ahdc.stopping import Brake, rim_after, stop_distance_m
from onboard.ahdc.view import Goal
from tests.onboard.samples import field_parameters

PARAMETERS = field_parameters(1)
(WEAK, STRONG), (QUICK, SLOW) = PARAMETERS.brake_deceleration_mps2, PARAMETERS.motor_lag_s
PERIOD_S = 0.01


def velocity(law: FieldLaw, x_m: float, rim_mps: float, why: str = "target") -> tuple[float, float]:
    """What the law wants ``x_m`` before a goal straight ahead."""
    room = law.planner.room(Motion(-x_m, 0.0, 0.0, rim_mps, rim_mps), [])
    return law.velocity(Goal((0.0, 0.0), 0.0, why), room)


@given(st.floats(0.001, 0.3), st.floats(0.0, 0.8))
def test_a_robot_brakes_exactly_where_any_brake_ends_on_the_target(left_m: float, rim_mps: float) -> None:
    law = FieldLaw("r01", 1, PARAMETERS, PERIOD_S, unicycle.steer)
    near_m = PARAMETERS.reach_m - 0.01
    ends = [abs(left_m - stop_distance_m(rim_mps, brake)) for brake in (Brake(WEAK, SLOW), Brake(STRONG, QUICK))]
    if max(ends) < near_m - 2e-3:
        assert velocity(law, left_m, rim_mps) == (0.0, 0.0)
    if max(ends) > near_m + 2e-3:
        assert velocity(law, left_m, rim_mps) != (0.0, 0.0)
    assert velocity(law, left_m, rim_mps, "aside") != (0.0, 0.0)


@pytest.mark.parametrize("brake", [Brake(STRONG, QUICK), Brake(WEAK, QUICK), Brake(STRONG, SLOW)])
def test_with_all_but_the_longest_way_to_rest_a_robot_comes_to_rest_within_reach_at_the_first_go(brake: Brake) -> None:
    law = FieldLaw("r01", 1, PARAMETERS, PERIOD_S, unicycle.steer)
    left_m, rim_mps, passed = 1.0, 0.0, False
    for _ in range(400):
        wanted = velocity(law, left_m, rim_mps)[0]
        rim_mps, way_m = rim_after(rim_mps, wanted, brake, PERIOD_S)
        left_m -= way_m
        passed |= left_m < -PARAMETERS.reach_m
        if abs(left_m) <= PARAMETERS.reach_m and abs(rim_mps) < 0.05:
            break
    else:
        pytest.fail("it never came to rest on the target")
    assert not passed
