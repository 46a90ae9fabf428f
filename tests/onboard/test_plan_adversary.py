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


def test_where_the_plan_alone_is_beaten_the_supervisor_keeps_robots_apart() -> None:
    """Found by a search: poses up to 0.13 s old hide that both have begun to back into each other."""
    back = (Wish(0.09, 1.91, 6.0), Wish(-0.8, 0.84, 6.0), Wish(-0.8, -0.08, 6.0), Wish(0.8, 0.0), Wish(0.76, -9.0),
            Wish(0.47, 1.95, 9.0), Wish(-0.62, 0.0), Wish(-0.8, 0.0), Wish(-0.8, 9.0))  # fmt: skip
    turn = (Wish(0.8, 0.0), Wish(0.8, -2.93, 6.0), Wish(0.8, -9.0), Wish(-0.47, 2.25, 6.0), Wish(0.06, -2.76, 9.0),
            Wish(-0.8, -9.0), Wish(-0.21, 2.04, 6.0), Wish(0.8, -1.55, 6.0), Wish(0.3, -9.0))  # fmt: skip
    robots = (
        Robot(0.0, 0.0, 1.901, Brake(2.044, 0.1465), 0.0076, 0.1024, back, math.inf),
        Robot(0.3893, 0.0738, -1.9236, Brake(1.943, 0.1036), 0.0093, 0.0953, turn, math.inf),
    )
    assert fly(robots, linked=False, supervised=False)[1] < TOUCH_M
    assert fly(robots, linked=False)[1] >= TOUCH_M
