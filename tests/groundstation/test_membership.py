"""Robots come late, crash, reboot, vanish from sight, are carried off or taken out; the others stay whole."""

import pytest

from contract.messages import StationHeartbeat
from groundstation.result import Result
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from onboard.ahdc.links import Link
from tests.groundstation.eventful import Befalls, Event, EventfulWorld


def world_of(*script: Event, robots: int = 4, seed: int = 3, limit_s: float = 6.0) -> EventfulWorld:
    job = Job(robots, 12, seed, "field", "field", limit_s)
    return EventfulWorld(arena_for(job), scenario(robots, 12, seed), job.faced, seed, limit_s, script=script)


def whole_and_clear(result: Result) -> bool:
    return (result.disconnected_steps, result.collisions) == (0, 0)


@pytest.mark.parametrize("what", ["late", "crash", "reboot"])
def test_the_network_stays_whole(what: Befalls) -> None:
    world = world_of(Event(1.5, what, "r02"))
    assert whole_and_clear(world.run())
    if what != "crash":
        assert world.agents["r02"].run_state == "running"
        assert "on" in world.agents["r02"].controller.link_states().values()


@pytest.mark.parametrize("seconds", [0.1, 1.0, 4.5])
def test_a_robot_lost_from_sight_keeps_its_links(seconds: float) -> None:
    world = world_of(Event(1.0, "occlude", "r02", seconds))
    assert whole_and_clear(world.run())
    assert world.agents["r02"].run_state == "running"


@pytest.mark.parametrize("script", [(), (Event(0.5, "late", "r19"),)], ids=["all at once", "one late"])
def test_in_a_crowd_everybody_comes_to_move(script: tuple[Event, ...]) -> None:
    world = world_of(*script, robots=20, seed=82_006_000)
    world.until(2.0)
    fields = {name: agent.controller.field for name, agent in world.agents.items()}
    assert [name for name, field in fields.items() if field is None or not field.joined] == []


def test_a_robot_that_crashed_holds_the_others_until_it_is_taken_out() -> None:
    kept, freed = (
        world_of(Event(1.0, "crash", "r02"), *more, limit_s=4.0) for more in ([], [Event(2.0, "exclude", "r02")])
    )
    for world in (kept, freed):
        assert whole_and_clear(world.run())
    held = {name for name, agent in kept.agents.items() if "r02" in agent.controller.linked}
    assert held - {"r02"}
    assert not any("r02" in agent.controller.linked for name, agent in freed.agents.items() if name != "r02")


def test_a_robot_whose_last_neighbour_is_taken_out_goes_on_alone() -> None:
    world = world_of(Event(1.0, "exclude", "r02"), robots=2)
    world.until(1.2)
    tasking = world.agents["r01"].controller.tasking
    assert "r02" not in world.agents["r01"].controller.linked
    before = tasking.memory.occupied
    world.run()
    assert tasking.memory.occupied != before


def test_a_robot_carried_off_and_taken_out_leaves_the_others_whole() -> None:
    world = world_of(Event(1.0, "exclude", "r02"), Event(1.0, "carry", "r02", 1.0, (3.5, 0.5)), limit_s=5.0)
    assert whole_and_clear(world.run())
    assert max(abs(speed) for speed in rims(world, "r02")) < 1e-6


def test_a_robot_carried_off_does_not_drag_the_swarm() -> None:
    world = world_of(Event(1.0, "carry", "r04", 1.0, (3.5, 0.5)), limit_s=5.0)
    result = world.run()
    assert result.collisions == 0
    assert result.disconnected_steps > 0


def rims(world: EventfulWorld, name: str) -> tuple[float, float]:
    drive = world.agents[name].tick(world.now_ns)
    return drive.left_radps, drive.right_radps


def test_a_robot_taken_out_hears_nothing_of_links_and_is_heard_no_more() -> None:
    world = world_of(limit_s=0.5)
    world.until(0.5)
    first = world.agents["r01"]
    field = first.controller.field
    assert field is not None
    other = next(name for name in world.agents if field.links.state(name) is Link.ON)
    first.controller.exclude(frozenset({other}))
    assert field.links.state(other) is Link.OFF
    world.excluded.add(other)
    world.until(1.5)
    assert field.links.state(other) is Link.OFF
    world.excluded.clear()
    world.until(3.0)
    assert first.supervisor.excluded == frozenset()
    assert first.controller.field is field
    assert other not in field.excluded


def test_an_old_heartbeat_takes_nobody_out() -> None:
    world = world_of(limit_s=0.5)
    world.until(0.3)
    agent = world.agents["r01"]
    beat = StationHeartbeat(boot=1, seq=1, stamp_ns=0, order="run", order_id=3, excluded=("r02",))
    agent.receive(beat, world.now_ns)
    assert agent.supervisor.excluded == frozenset()


def test_a_mission_over_real_bytes_has_no_script() -> None:
    job = Job(2, 2, 3, "field", "field", 1.0)
    with pytest.raises(ValueError, match="not wired"):
        EventfulWorld(arena_for(job), scenario(2, 2, 3), job.faced, 3, 1.0, wired=True)
