"""Crowds are looked at by cells of the floor: what comes out is what a look at every pair would give."""

import itertools
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

import groundstation.lockstep as lockstep
import groundstation.referee as referees
from groundstation.grid import Grid
from groundstation.lockstep import World
from groundstation.referee import Referee
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario

coordinates = st.floats(-5.0, 5.0)
places = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=12)


def named(points: list[tuple[float, float]]) -> dict[str, tuple[float, float]]:
    return {f"r{k:02d}": point for k, point in enumerate(points)}


@given(places, st.floats(0.3, 2.0), st.integers(0, 2))
def test_nobody_within_so_many_cells_is_left_out(points: list[tuple[float, float]], cell_m: float, rings: int) -> None:
    swarm = named(points)
    grid = Grid(swarm, cell_m)
    for name, place in swarm.items():
        around = grid.around(grid.cell(place), rings)
        assert len(set(around)) == len(around)
        for other, there in swarm.items():
            if other == name or math.dist(place, there) < rings * cell_m:
                assert other in around
            if math.dist(place, there) > (rings + 1) * cell_m * math.sqrt(2):
                assert other not in around


def judged(walk: list[dict[str, tuple[float, float]]]) -> tuple[int, int, float]:
    referee = Referee(1.0, 0.14)
    for moment in walk:
        referee.look(moment)
    return referee.disconnected, referee.collisions, referee.min_distance_m


@pytest.mark.parametrize("seed", range(4))
def test_the_referee_sees_in_a_crowd_what_it_sees_pair_by_pair(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(seed)
    walk = [named([(rng.uniform(0.0, 3.0), rng.uniform(0.0, 3.0)) for _ in range(8 + 4 * seed)]) for _ in range(20)]
    pair_by_pair = judged(walk)
    monkeypatch.setattr(referees, "CROWD", 0)
    assert judged(walk) == pair_by_pair
    assert pair_by_pair[0] or pair_by_pair[1]


def whole(places: dict[str, tuple[float, float]], radius_m: float) -> bool:
    """Whether everybody is reached from the first, hop by hop."""
    inside, frontier = set(), [next(iter(places))]
    while frontier:
        inside.add(here := frontier.pop())
        frontier += [
            name for name in places if name not in inside and math.dist(places[here], places[name]) <= radius_m
        ]
    return len(inside) == len(places)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("cells", [False, True])
def test_the_referee_misses_nothing_between_two_looks_at_everybody(
    seed: int, cells: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Robots that wander, stand, jump and leave, against a plain look at every pair and every path."""
    if cells:
        monkeypatch.setattr(referees, "CROWD", 0)
    rng = random.Random(seed)
    swarm = {name: (rng.uniform(0.0, 1.5), rng.uniform(0.0, 1.5)) for name in "abcdef"}
    referee, partings, collisions, least_m, touching = Referee(1.0, 0.14), 0, 0, math.inf, set()
    for moment in range(600):
        stride_m = rng.choice((0.0, 0.003, 0.003, 0.02))
        swarm = {n: (x + rng.gauss(0, stride_m), y + rng.gauss(0, stride_m)) for n, (x, y) in swarm.items()}
        if moment % 97 == 96:
            swarm[rng.choice(list(swarm))] = (rng.uniform(0.0, 2.0), rng.uniform(0.0, 2.0))
        if moment == 400:
            del swarm["c"]
        referee.look(swarm)
        partings += not whole(swarm, 1.0)
        for pair in itertools.combinations(swarm, 2):
            distance_m = math.sqrt(sum((b - a) ** 2 for a, b in zip(*(swarm[name] for name in pair), strict=True)))
            least_m = min(least_m, distance_m)
            collisions += distance_m < 0.14 and pair not in touching
            (touching.add if distance_m < 0.14 else touching.discard)(pair)
        assert (referee.disconnected, referee.collisions) == (partings, collisions)
        assert referee.min_distance_m == pytest.approx(least_m, abs=1e-12)
    assert collisions or partings


def test_a_mission_is_the_same_where_robots_are_given_only_what_is_near(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without loss: it draws a number for every hearer."""

    def played() -> tuple[list[object], int]:
        job = Job(10, 8, 4, "field", "ideal", 0.8)
        place = scenario(10, 8, 4)
        world = World(
            arena_for(job), place._replace(starts=tuple((0.4 + 0.8 * k, 0.4) for k in range(10))), job.faced, 4
        )
        world.until(0.8)
        shown = min(
            len(agent.reception.frame.bodies) for agent in world.agents.values() if agent.reception.frame is not None
        )
        return [world.hops.pose(name) for name in world.agents], shown

    whole, all_bodies = played()
    monkeypatch.setattr(lockstep, "CROWD", 0)
    culled, bodies = played()
    assert culled == whole
    assert bodies < all_bodies
