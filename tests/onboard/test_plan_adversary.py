"""A small share of the adversary's searches against the stop-point plan; ``./kit prove plan_adversary`` is the rest."""

import math

import pytest

from onboard.ahdc.stopping import Brake
from tests.onboard.plan_adversary import PARAMETERS, Robot, Wish, fly, search

TOUCH_M = PARAMETERS.diameter_m


@pytest.mark.parametrize("max_age_s", [0.08, 0.15])
@pytest.mark.parametrize("robots", [2, 3])
def test_no_link_is_stretched_beyond_r_c(robots: int, max_age_s: float) -> None:
    for seed in range(2):
        found = search(seed, 5, robots, max_age_s)
        assert found.longest_m <= PARAMETERS.sensing_radius_m, found.worst


@pytest.mark.parametrize("max_age_s", [0.08, 0.15])
def test_no_robot_is_touched(max_age_s: float) -> None:
    for seed in range(2):
        found = search(seed, 5, 2, max_age_s, close=True)
        assert found.nearest_m >= TOUCH_M, found.worst


def test_the_adversary_can_win_against_brakes_outside_the_interval() -> None:
    """Otherwise it would prove nothing: two robots drive apart at full speed and brake far worse than they say."""
    away = tuple(Wish(PARAMETERS.max_speed_mps, 0.0) for _ in range(9))
    bad = Brake(0.4, 0.3)
    robots = [Robot(x, 0.0, heading, bad, 0.0, 0.05, away, math.inf) for x, heading in ((0.0, math.pi), (0.3, 0.0))]
    assert fly(tuple(robots))[0] > PARAMETERS.sensing_radius_m
    good = Brake(1.6, 0.15)
    assert fly(tuple(robot._replace(brake=good) for robot in robots))[0] <= PARAMETERS.sensing_radius_m
