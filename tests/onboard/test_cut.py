"""A robot cut off in the middle of a motion: what its way is, and that nobody stands in it."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.ahdc.stopping import Brake, rim_after
from onboard.cut import CutBounds, cut_bounds, limit_cut
from onboard.limits import Bounds, Neighbour, limit
from tests.onboard.samples import arena

DIAMETER_M = 0.14
BRAKE = Bounds(
    fence=(-1e3, -1e3, 1e3, 1e3),
    min_distance_m=0.15,
    separation_m=0.11,
    deceleration_mps2=(1.6, 2.4),
    lag_s=(0.06, 0.15),
)
BOUNDS = CutBounds(brake=BRAKE, standing_s=0.22, coast_mps2=0.6, contact_m=0.145, beyond_fence_m=0.08)
speeds = st.floats(0.0, 0.9)


def test_the_bounds_of_an_arena() -> None:
    bounds = cut_bounds(arena())
    assert bounds.standing_s == pytest.approx(0.22)
    assert bounds.contact_m == pytest.approx(0.145)
    assert bounds.beyond_fence_m == pytest.approx(0.08)
    assert bounds.roll_m(0.8, 0.8) == pytest.approx(0.8 * 0.22 + 0.64 / 1.2)


@given(speeds, speeds, st.sampled_from([0, 1]))
def test_the_way_of_a_cut_robot_is_that_of_the_fine_integration(speed: float, command: float, end: int) -> None:
    brake = Brake(BRAKE.deceleration_mps2[end], BRAKE.lag_s[1 - end])
    way = 0.0
    v = speed
    for _ in range(220):
        v, step = rim_after(v, command, brake, 0.001)
        way += step
    while v > 0.0:
        way += v * 0.001 - 0.6 * 0.001**2 / 2
        v -= 0.6 * 0.001
    assert BOUNDS.roll_m(speed, command) >= way - 1e-3
    if (end == 1) == (command > speed):
        assert BOUNDS.roll_m(speed, command) == pytest.approx(way, abs=2e-3)


@given(
    st.floats(-1, 1),
    st.floats(-8, 8),
    st.tuples(st.floats(0, 4), st.floats(0, 5), st.floats(-math.pi, math.pi)),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    st.lists(
        st.builds(
            Neighbour,
            st.floats(0, 4), st.floats(0, 5), st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 1), st.floats(0, 1),
        ),
        max_size=4,
    ),
)  # fmt: skip
def test_the_rule_only_shrinks_and_a_zero_passes(v, omega, pose, wheels, others) -> None:
    limited = limit_cut(v, omega, pose, wheels, others, BOUNDS)
    assert abs(limited.v_mps) <= abs(v)
    assert limited.v_mps * v >= 0.0
    assert abs(limited.omega_radps) <= abs(omega)
    assert limited.omega_radps * omega >= 0.0
    assert limit_cut(0.0, omega, pose, wheels, others, BOUNDS) == (0.0, omega, "")


@pytest.mark.parametrize("gap_m", [0.05, 0.2, 0.4, 0.6, 0.8])
def test_towards_a_robot_at_rest_a_cut_ends_before_it(gap_m: float) -> None:
    ahead = [Neighbour(0.145 + gap_m, 0.0, 0.0, 0.0, 0.0, 0.0)]
    speed = 0.8
    for _ in range(60):
        speed = limit_cut(0.8, 0.0, (0.0, 0.0, 0.0), (speed, speed), ahead, BOUNDS).v_mps
    assert BOUNDS.roll_m(speed, speed) <= gap_m + 1e-3
    assert speed == 0.8 or BOUNDS.roll_m(speed + 0.02, speed + 0.02) > gap_m


def test_what_is_beside_or_behind_does_not_slow() -> None:
    for place in ((0.0, 0.2), (-0.2, 0.0), (0.4, 0.2), (-0.1, -0.15)):
        others = [Neighbour(*place, 0.0, 0.0, 0.0, 0.0)]
        assert limit_cut(0.8, 0.0, (0.0, 0.0, 0.0), (0.8, 0.8), others, BOUNDS).by == ""
    bounds = BOUNDS._replace(brake=BRAKE._replace(fence=(0.0, 0.0, 4.0, 5.0)))
    assert limit_cut(0.8, 0.0, (3.6, 2.5, math.pi), (0.8, 0.8), [], bounds).by == ""
    assert limit_cut(0.8, 0.0, (3.6, 2.5, 0.0), (0.8, 0.8), [], bounds).by == "fence"


def test_a_silent_neighbour_is_expected_to_coast_not_to_brake() -> None:
    coming = Neighbour(0.45, 0.0, -0.5, 0.0, 0.0, 0.3)
    own = (0.0, 0.0, 0.0)
    braking = limit(0.6, 0.0, own, (0.3, 0.3), [coming], BRAKE)
    assert limit_cut(0.6, 0.0, own, (0.3, 0.3), [coming], BOUNDS).v_mps < braking.v_mps


class Body:
    """A differential drive that obeys, then, cut off, keeps its command for a while and coasts."""

    def __init__(self, x: float, y: float, draw: random.Random) -> None:
        self.x, self.y, self.heading = x, y, draw.uniform(-math.pi, math.pi)
        self.rims = [0.0, 0.0]
        self.command = (0.0, 0.0)
        self.brake = Brake(draw.uniform(1.6, 2.4), draw.uniform(0.06, 0.15))
        self.cut_s = math.inf

    def advance(self, now_s: float, duration_s: float) -> None:
        released = now_s >= self.cut_s + 0.2
        ways = [0.0, 0.0]
        for side in (0, 1):
            command, brake = (0.0, Brake(0.6, 0.0)) if released else (self.command[side], self.brake)
            self.rims[side], ways[side] = rim_after(self.rims[side], command, brake, duration_s)
        turn = (ways[1] - ways[0]) / 0.11
        self.x += sum(ways) / 2 * math.cos(self.heading + turn / 2)
        self.y += sum(ways) / 2 * math.sin(self.heading + turn / 2)
        self.heading += turn

    def velocity(self) -> tuple[float, float]:
        speed = sum(self.rims) / 2
        return speed * math.cos(self.heading), speed * math.sin(self.heading)


def chase(seed: int, cut_rule: bool) -> float:
    """Least distance of two robots that always drive at each other, one of which is cut at some time."""
    draw = random.Random(seed)
    bodies = [Body(0.0, 0.0, draw), Body(draw.uniform(0.5, 1.2), draw.uniform(-0.3, 0.3), draw)]
    hurry = [draw.uniform(0.2, 1.0), draw.choice((0.0, draw.uniform(0.2, 1.0)))]
    bodies[0].cut_s = draw.uniform(0.2, 2.5)
    spoke_s, least = 0.0, math.inf
    for step in range(2200):
        now = step * 0.002
        for index, own in enumerate(bodies if step % 5 == 0 else ()):
            other = bodies[1 - index]
            if now >= own.cut_s:
                continue
            if index == 0:
                spoke_s = now
            off = math.remainder(math.atan2(other.y - own.y, other.x - own.x) - own.heading, math.tau)
            v, omega = 0.8 * hurry[index] * max(0.0, math.cos(off)), max(-6.0, min(6.0, 6.0 * off))
            pose, rims = (own.x, own.y, own.heading), (own.rims[0], own.rims[1])
            near = (other.x, other.y, *other.velocity(), 0.0)
            limited = limit(v, omega, pose, rims, [Neighbour(*near)], BRAKE)
            if cut_rule:
                silence = now - spoke_s if index == 1 else 0.0
                limited = limit_cut(limited.v_mps, limited.omega_radps, pose, rims, [Neighbour(*near, silence)], BOUNDS)
            half = limited.omega_radps * 0.055
            own.command = (limited.v_mps - half, limited.v_mps + half)
        for body in bodies:
            body.advance(now, 0.002)
        least = min(least, math.dist((bodies[0].x, bodies[0].y), (bodies[1].x, bodies[1].y)))
    return least


def test_robots_that_drive_at_each_other_do_not_collide_when_one_is_cut() -> None:
    assert min(chase(seed, cut_rule=True) for seed in range(60)) >= DIAMETER_M


def test_without_the_rule_they_do() -> None:
    assert min(chase(seed, cut_rule=False) for seed in range(6)) < DIAMETER_M - 0.02
