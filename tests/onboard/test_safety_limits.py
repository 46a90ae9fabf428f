"""The limits: closed forms against fine integration, and hostile laws in a small pure plant."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.limits import Bounds, Neighbour, limit, respond, roll_m, stop_m

BOUNDS = Bounds(
    fence=(0.15, 0.15, 3.85, 4.85),
    min_distance_m=0.15,
    separation_m=0.11,
    deceleration_mps2=(1.6, 2.4),
    lag_s=(0.06, 0.15),
)
OPEN = BOUNDS._replace(fence=(-1e3, -1e3, 1e3, 1e3))
speeds = st.floats(0.0, 1.5)


def integrate(v: float, command: float, time_s: float, a: float, lag: float, dt: float = 1e-5) -> tuple[float, float]:
    distance = 0.0
    for _ in range(round(time_s / dt)):
        middle = v + max(-a, min(a, (command - v) / lag)) * dt / 2
        v += max(-a, min(a, (command - middle) / lag)) * dt
        distance += middle * dt
    return distance, v


@given(speeds, st.floats(0.5, 5.0), st.floats(0.02, 0.3))
def test_stopping_distance_is_that_of_the_fine_integration(v: float, a: float, lag: float) -> None:
    rolled, rest = integrate(v, 0.0, v / a + 10 * lag, a, lag, 1e-4)
    assert stop_m(v, a, lag) == pytest.approx(rolled + rest * lag, abs=2e-6)


@given(speeds, speeds, st.floats(0.01, 0.5), st.floats(0.5, 5.0), st.floats(0.02, 0.3))
def test_response_is_that_of_the_fine_integration(
    v: float, command: float, time_s: float, a: float, lag: float
) -> None:
    time_s = round(time_s, 3)
    assert respond(v, command, time_s, a, lag) == pytest.approx(integrate(v, command, time_s, a, lag, 1e-4), abs=1e-5)


@given(speeds, st.floats(0.5, 5.0), st.floats(0.02, 0.3), st.floats(1.0, 1.5))
def test_a_weaker_brake_rolls_farther(v: float, a: float, lag: float, worse: float) -> None:
    assert stop_m(v, a / worse, lag) >= stop_m(v, a, lag) - 1e-12
    assert stop_m(v, a, lag * worse) >= stop_m(v, a, lag) - 1e-12


@given(speeds, speeds, st.floats(0.0, 1.0))
def test_rolling_grows_with_the_command(v: float, command: float, part: float) -> None:
    assert roll_m(v, part * command, BOUNDS) <= roll_m(v, command, BOUNDS) + 1e-12


@given(
    st.floats(-1, 1),
    st.floats(-10, 10),
    st.tuples(st.floats(0, 4), st.floats(0, 5), st.floats(-math.pi, math.pi)),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    st.lists(
        st.builds(Neighbour, st.floats(0, 4), st.floats(0, 5), st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 9))
    ),
)
def test_a_limit_only_shrinks_and_a_zero_passes(v, omega, pose, wheels, neighbours) -> None:
    limited = limit(v, omega, pose, wheels, neighbours, BOUNDS)
    assert abs(limited.v_mps) <= abs(v)
    assert limited.v_mps * v >= 0.0
    assert abs(limited.omega_radps) <= abs(omega)
    assert limited.omega_radps * omega >= 0.0
    assert bool(limited.by) == (limited[:2] != (v, omega)) or limited.by
    assert limit(0.0, omega, pose, wheels, neighbours, BOUNDS) == (0.0, omega, "")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(7))
def test_not_finite_is_zero(bad: float, place: int) -> None:
    values = [0.5, 0.1, 1.0, 1.0, 0.0, 0.2, 0.2]
    values[place] = bad
    v, omega, x, y, heading, left, right = values
    assert limit(v, omega, (x, y, heading), (left, right), [], BOUNDS) == (0.0, 0.0, "not finite")


def test_motion_away_always_passes() -> None:
    at_the_wall = (0.10, 2.0, 0.0)
    assert limit(0.8, 0.0, at_the_wall, (0.0, 0.0), [], BOUNDS).by == ""
    assert limit(-0.8, 0.0, at_the_wall, (0.0, 0.0), [], BOUNDS) == (0.0, 0.0, "fence")
    touching = [Neighbour(2.1, 2.0, 0.0, 0.0, 0.0)]
    assert limit(-0.8, 0.0, (2.0, 2.0, 0.0), (0.0, 0.0), touching, OPEN).by == ""
    assert limit(0.8, 0.0, (2.0, 2.0, 0.0), (0.0, 0.0), touching, OPEN) == (0.0, 0.0, "separation")


def test_turning_in_place_is_allowed_when_blocked_and_at_rest() -> None:
    blocked = [Neighbour(2.1, 2.0, 0.0, 0.0, 0.0)]
    assert limit(0.8, 1.0, (2.0, 2.0, 0.0), (0.0, 0.0), blocked, OPEN).omega_radps == 1.0
    assert limit(0.8, 1.0, (2.0, 2.0, 0.0), (0.3, 0.3), blocked, OPEN).omega_radps == 0.0


def test_an_older_neighbour_is_kept_farther_away() -> None:
    allowed = [
        limit(0.8, 0.0, (2.0, 2.0, 0.0), (0.5, 0.5), [Neighbour(2.4, 2.0, -0.4, 0.0, age)], OPEN).v_mps
        for age in (0.0, 0.1, 0.2, 9.0)
    ]
    assert allowed == sorted(allowed, reverse=True)
    assert allowed[0] > allowed[2]


class Body:
    """A differential drive whose wheels lag; brake quality of its own within the calibrated interval."""

    def __init__(self, x: float, y: float, heading: float, draw: random.Random) -> None:
        self.x, self.y, self.heading = x, y, heading
        self.left = self.right = 0.0
        self.command = (0.0, 0.0)
        self.a = draw.uniform(*BOUNDS.deceleration_mps2)
        self.lag = draw.uniform(*BOUNDS.lag_s)

    def advance(self, dt: float) -> None:
        before = (self.left + self.right) / 2
        self.left += max(-self.a, min(self.a, (self.command[0] - self.left) / self.lag)) * dt
        self.right += max(-self.a, min(self.a, (self.command[1] - self.right) / self.lag)) * dt
        speed = (before + (self.left + self.right) / 2) / 2
        self.heading += (self.right - self.left) / BOUNDS.separation_m * dt
        self.x += speed * math.cos(self.heading) * dt
        self.y += speed * math.sin(self.heading) * dt

    def give(self, v: float, omega: float) -> None:
        half = BOUNDS.separation_m / 2
        self.command = (v - half * omega, v + half * omega)

    @property
    def velocity(self) -> tuple[float, float]:
        speed = (self.left + self.right) / 2
        return speed * math.cos(self.heading), speed * math.sin(self.heading)


def chase(body: Body, point: tuple[float, float], draw: random.Random) -> tuple[float, float]:
    """The hostile law: full speed at a point, forwards or backwards, turning hard."""
    bearing = math.remainder(math.atan2(point[1] - body.y, point[0] - body.x) - body.heading, math.tau)
    forward = 1.0 if abs(bearing) < math.pi / 2 else -1.0
    error = bearing if forward > 0 else math.remainder(bearing - math.pi, math.tau)
    return forward * draw.choice((0.4, 0.8, 0.8)), max(-8.0, min(8.0, 6 * error + draw.uniform(-2, 2)))


@pytest.mark.parametrize("seed", range(5))
def test_hostile_laws_neither_collide_nor_leave(seed: int) -> None:
    """Everybody drives at the nearest robot or at a wall; poses of others are up to 60 ms old, frames get lost."""
    draw = random.Random(seed)
    places = [(0.4 + 0.45 * i, 0.5 + 0.5 * j) for i in range(3) for j in range(2)]
    bodies = [Body(*place, draw.uniform(-3, 3), draw) for place in places]
    history: list[list[tuple[float, float, float, float]]] = []
    nearest, outside = math.inf, 0.0
    low_x, low_y, high_x, high_y = BOUNDS.fence
    for step in range(900):
        history.append([(b.x, b.y, *b.velocity) for b in bodies])
        for i, body in enumerate(bodies):
            if draw.random() < 0.1:
                continue
            ages = [draw.randrange(0, 7) for _ in bodies]
            seen = [Neighbour(*history[max(0, step - age)][j], age * 0.01) for j, age in enumerate(ages) if j != i]
            prey = min(seen, key=lambda n: math.dist((n.x_m, n.y_m), (body.x, body.y)))
            wall = (body.x + draw.choice((-9.0, 9.0)), body.y)
            goal = (prey.x_m, prey.y_m) if (seed + step // 200 + i) % 3 else wall
            v, omega = chase(body, goal, draw)
            limited = limit(v, omega, (body.x, body.y, body.heading), (body.left, body.right), seen, BOUNDS)
            body.give(limited.v_mps, limited.omega_radps)
        for _ in range(5):
            for body in bodies:
                body.advance(0.002)
        points = [(b.x, b.y) for b in bodies]
        nearest = min(nearest, min(math.dist(p, q) for k, p in enumerate(points) for q in points[k + 1 :]))
        outside = max(outside, *(max(low_x - x, x - high_x, low_y - y, y - high_y) for x, y in points))
    assert nearest > 0.14, "bodies of 0.14 m touched"
    assert nearest > BOUNDS.min_distance_m - 0.005
    assert outside < 0.005
    assert nearest < 0.3, "the hostile law never got close: the test shows nothing"
