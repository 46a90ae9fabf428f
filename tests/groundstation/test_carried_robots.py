"""Robots without power are carried about by hand: the next mission is as if they had never been elsewhere."""

import math

import pytest

from groundstation.conditions import FIELD
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import Scenario, scenario
from onboard.odometry import Pose


def ordered(world: World, *orders: str) -> None:
    """Each order a while after the one before; then until the last is obeyed."""
    for number, order in enumerate(orders):
        world.orders.append((world.now_ns + number * 400_000_000, order, ()))  # type: ignore[arg-type]
    on(world, 0.4 * len(orders))


def on(world: World, seconds: float) -> bool:
    return world.until((world.now_ns - world._start_ns) * 1e-9 + seconds)


def links_of(world: World) -> set[frozenset[str]]:
    """Links that both ends keep."""
    kept = {name: set(agent.controller.link_states()) for name, agent in world.agents.items()}
    return {frozenset((a, b)) for a in kept for b in kept[a] if a in kept[b]}


def in_reach(world: World) -> set[frozenset[str]]:
    places = world.hops.places()
    return {frozenset((a, b)) for a in places for b in places if a < b and math.dist(places[a], places[b]) <= 1.0}


@pytest.mark.parametrize("seed", range(4))
def test_after_robots_were_carried_to_other_places_the_mission_goes_on_to_its_end(seed: int) -> None:
    job = Job(4, 12, seed, "field", "field", 90.0)
    place = scenario(4, 12, seed)
    world = World(arena_for(job), place, FIELD, seed, job.limit_s)
    assert not on(world, 4.0)
    ordered(world, "hold", "disarm")
    on(world, 1.0)
    here = world.hops.places()
    order = sorted(here, key=lambda name: -math.dist(here[name], place.starts[0]))
    for name, start in zip(order, place.starts, strict=True):
        world.hops.place(name, Pose(*start, 0.3))
    on(world, 1.0)
    assert all(agent.run_state == "disarmed" for agent in world.agents.values())
    before = world.referee.disconnected
    ordered(world, "arm", "run")
    assert world.until(job.limit_s), world._why()
    assert world.referee.disconnected == before
    assert world.referee.collisions == 0


def test_a_link_just_out_of_reach_holds_nobody_after_a_release() -> None:
    """A robot that was cut off rolled 15 mm out of its neighbour's reach; a third is put within reach of both."""
    starts = ((1.811, 2.653), (1.35, 1.95), (2.2, 3.3))
    arena = arena_for(Job(3, 2, 1, "field", "field", 40.0))
    targets = ((2.9, 3.3), (2.6, 3.5))
    world = World(arena, Scenario(arena.arena.size_m, starts, targets, 0.7), FIELD, 1, 40.0)
    assert not on(world, 0.3)
    r06, r08, r09 = world.agents
    assert frozenset((r06, r08)) in links_of(world)
    x, y = starts[1]
    for step in range(1, 9):  # as slowly as it coasts: no jump
        world.hops.place(r08, Pose(x - 0.13 / 8 * step, y - 0.122 / 8 * step, 0.0))
        on(world, 0.1)
    ordered(world, "disarm")
    world.hops.place(r09, Pose(1.679, 2.1, 0.0))
    on(world, 0.5)
    assert frozenset((r06, r08)) not in links_of(world)
    ordered(world, "arm")
    on(world, 0.5)
    assert links_of(world) == in_reach(world)
    ordered(world, "run")
    assert world.until(40.0), world._why()


def half_links_of(world: World) -> set[tuple[str, str]]:
    """Links that the first keeps and the second does not."""
    kept = {name: set(agent.controller.link_states()) for name, agent in world.agents.items()}
    return {(a, b) for a in kept for b in kept[a] if a not in kept[b]}


def test_one_that_was_carried_alone_and_drives_back_is_linked_again_by_those_who_never_let_go() -> None:
    """Its neighbour still held its end: bound to a robot that was not bound to it, for as long as the mission."""
    arena = arena_for(Job(3, 4, 1, "field", "field", 60.0))
    starts, targets = ((2.0, 3.0), (2.0, 2.1), (2.4, 1.6)), ((2.3, 3.7), (2.0, 2.5), (2.4, 1.2), (2.0, 4.6))
    world = World(arena, Scenario(arena.arena.size_m, starts, targets, 1.57), FIELD, 1, 60.0)
    first, carried, _ = world.agents
    on(world, 0.1)
    ordered(world, "hold")
    world.orders.append((world.now_ns, "disarm", (carried,)))
    for step in range(1, 9):
        on(world, 0.1)
        world.hops.place(carried, Pose(2.0, 2.1 - 0.02 * step, 1.57))
    on(world, 0.5)
    assert half_links_of(world) == {(first, carried)}
    ordered(world, "arm", "run")
    while math.dist(*(world.hops.places()[name] for name in (first, carried))) > 0.95:
        assert not on(world, 0.1), world._why()
    on(world, 0.5)
    assert not half_links_of(world)
    assert frozenset((first, carried)) in links_of(world)
    assert world.until(60.0), world._why()
    assert world.referee.collisions == 0
