"""Crowds are looked at by cells of the floor: what comes out is what a look at every pair would give."""

import itertools
import math
import random
import sys
from types import FrameType

import pytest
from hypothesis import given
from hypothesis import strategies as st

import groundstation.lockstep as lockstep
import groundstation.referee as referees
from bench.crowd import crowd
from groundstation.grid import Grid
from groundstation.lockstep import World
from groundstation.referee import Referee
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from onboard.agent import Agent

coordinates = st.floats(-5.0, 5.0)
places = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=12)


def named(points: list[tuple[float, float]]) -> dict[str, tuple[float, float]]:
    return {f"r{k:02d}": point for k, point in enumerate(points)}


@given(places, st.floats(0.3, 2.0), st.floats(0.1, 4.0))
def test_nobody_within_reach_of_a_cell_is_left_out(
    points: list[tuple[float, float]], cell_m: float, reach_m: float
) -> None:
    swarm = named(points)
    grid = Grid(swarm, cell_m)
    for name, place in swarm.items():
        found = grid.within(grid.cell(place), reach_m)
        assert len(set(found)) == len(found)
        for other, there in swarm.items():
            if other == name or math.dist(place, there) < reach_m:
                assert other in found
            if math.dist(place, there) > reach_m + 2 * math.sqrt(2) * cell_m:
                assert other not in found


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


@pytest.mark.parametrize("crowd", [0, 40])
def test_a_way_round_a_torn_tie_is_watched_like_the_tie(crowd: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(referees, "CROWD", crowd)
    referee = Referee(1.0, 0.14)
    referee.look({"a": (0.0, 0.0), "b": (0.99, 0.0), "c": (0.5, 0.862)})
    referee.look({"a": (0.0, 0.0), "b": (1.005, 0.0), "c": (0.5, 0.862)})
    assert not referee.disconnected, "a and b by way of c"
    referee.look({"a": (0.0, 0.0), "b": (1.005, 0.0), "c": (0.48, 0.87)})
    assert referee.disconnected == 1, "b is out of reach of both"


def test_the_work_of_the_referee_grows_with_the_crowd_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a larger crowd more ties tear: each is made good where it tears, not by a look at everybody."""

    def looks_at_everybody(robots: int) -> int:
        rng, referee = random.Random(1), Referee(1.0, 0.14)
        spots = {f"r{k:04d}": (0.65 * (k % 12), 0.65 * (k // 12)) for k in range(robots)}
        looks = []
        everybody = Referee._surroundings
        monkeypatch.setattr(Referee, "_surroundings", lambda me, places: looks.append(1) or everybody(me, places))
        for _ in range(40):
            referee.look({n: (x + rng.uniform(0, 0.028), y + rng.uniform(0, 0.028)) for n, (x, y) in spots.items()})
        monkeypatch.undo()
        assert not referee.disconnected
        return len(looks)

    assert looks_at_everybody(48) == looks_at_everybody(480) == 1


def work(robots: int) -> tuple[int, int]:
    """Steps of these robots in a strip five abreast, and the lines of Python that they and their world take."""
    world, lines, steps = crowd(robots, columns=5), 0, 0
    world.until(0.05)
    begun = Agent.step.__code__

    def trace(frame: FrameType, event: str, arg: object) -> object:
        nonlocal lines, steps
        lines += event == "line"
        steps += event == "call" and frame.f_code is begun
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        world.until(0.07)
    finally:
        sys.settrace(before)
    return steps, lines


def test_every_robot_added_to_a_crowd_costs_the_same() -> None:
    """A strip has two ends however long it is; one loop over all robots in a robot's step would show as 4 %."""
    few, more, many = (work(robots) for robots in (80, 160, 320))
    assert (few[0], more[0], many[0]) == (160, 320, 640)
    early, late = ((after[1] - before[1]) / (after[0] - before[0]) for before, after in ((few, more), (more, many)))
    assert late == pytest.approx(early, rel=0.02)


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
