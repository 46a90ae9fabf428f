"""A mission over real bytes in virtual time, and what one damaged hop does to it."""

import math
from collections import Counter

import msgspec
import pytest

from drivers.mock.faults import FaultSettings
from groundstation.conditions import FIELD
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from groundstation.wire import Wire, sound

ODRIVE, ROBOCLAW = "r01", "r02"
STOPPED_S = 2.0
"""Silent poses hold after 0.15 s. A controller that hears no setpoint gets no other packet either, so its watchdog
releases the motors within 0.3 s, and they coast for up to 1.4 s."""


def world_of(limit_s: float = 5.0, seed: int = 1) -> World:
    job = Job(6, 19, seed, "field", "field", limit_s, wired=True)
    return World(arena_for(job), scenario(6, 19, seed), FIELD, seed, limit_s, wired=True)


def wire_of(world: World) -> Wire:
    assert isinstance(world.hops, Wire)
    return world.hops


def refused(wire: Wire) -> dict[str, Counter[str]]:
    """What each hop refused; a command the gate made smaller is none of it."""
    return {
        hop: found
        for hop, counters in wire.counters().items()
        if (found := Counter({name: n for name, n in counters.items() if not name.startswith("gate_")}))
    }


def flip(data: bytes, index: int = 2) -> bytes:
    """Byte 2 is the length of a datagram, and inside the first field's name of a message."""
    return data[:index] + bytes([data[index] ^ 0x80]) + data[index + 1 :]


def damage(wire: Wire, hop: str, on: bool = True) -> None:
    if hop == "udp":
        wire.damage_datagram = flip if on else sound
    elif hop == "message":
        wire.damage_message = flip if on else sound
    elif on:
        wire.emulated.fault(hop, "corrupted", FaultSettings())
    else:
        wire.emulated.repair(hop, "corrupted")


def test_mission_makes_progress_and_repeats_bit_for_bit() -> None:
    worlds = [world_of(), world_of()]
    first, second = (world.run() for world in worlds)
    kinds = [robot.wheels["kind"] for robot in worlds[0].arena.robots.values()]
    assert Counter(kinds) == {"odrive": 3, "roboclaw": 3}
    assert first.occupied >= 1
    assert (first.disconnected_steps, first.collisions) == (0, 0)
    assert msgspec.json.encode(first) == msgspec.json.encode(second)
    poses = [[world.hops.pose(name) for name in world.agents] for world in worlds]
    assert poses[0] == poses[1]
    assert not refused(wire_of(worlds[0]))


@pytest.mark.parametrize("hop", ["udp", "message", ODRIVE, ROBOCLAW])
def test_damage_before_the_start_is_counted_and_turns_nothing(hop: str) -> None:
    world = world_of()
    wire = wire_of(world)
    world.until(-0.3)
    damage(wire, hop)
    hit = [hop] if hop in world.agents else list(world.agents)
    before = {name: world.hops.pose(name) for name in hit}
    world.until(0.7)
    assert set(refused(wire)) == {hop}
    assert {name: world.hops.pose(name) for name in hit} == before


@pytest.mark.parametrize("hop", ["udp", "message", ODRIVE, ROBOCLAW])
def test_lasting_damage_is_counted_and_stops_who_depends_on_it(hop: str) -> None:
    world = world_of()
    wire = wire_of(world)
    world.until(1.5)
    assert not refused(wire)
    hit = [hop] if hop in world.agents else list(world.agents)
    assert any(abs(speed) > 1.0 for name in world.agents for speed in wire.emulated.speeds(name))
    damage(wire, hop)
    world.until(1.5 + STOPPED_S)
    assert set(refused(wire)) == {hop}
    rest = {name: world.hops.pose(name) for name in hit}
    world.until(1.7 + STOPPED_S)
    assert max(math.dist(world.hops.pose(name), rest[name]) for name in hit) < 1e-4
    if hop not in world.agents:
        assert (world.referee.disconnected, world.referee.collisions) == (0, 0)


@pytest.mark.parametrize("hop", ["udp", "message", ODRIVE, ROBOCLAW])
def test_passing_damage_is_counted_and_the_mission_goes_on(hop: str) -> None:
    world = world_of()
    wire = wire_of(world)
    world.until(1.5)
    damage(wire, hop)
    world.until(1.53)
    damage(wire, hop, on=False)
    world.until(2.0)
    assert set(refused(wire)) == {hop}
    assert {agent.run_state for agent in world.agents.values()} == {"running"}
