"""Six families on six robots in one lockstep mission over real bytes, and pulling their plugs."""

import math
import random
from typing import NamedTuple

import msgspec
from benches import COMMON, WHEELS

from contract.codec import decode
from contract.messages import SCHEMA_VERSION, Order, RobotReport, StationHeartbeat
from drivers.mock.faults import FaultKind
from groundstation.conditions import FIELD
from groundstation.lockstep import World
from groundstation.scoring import MISSION
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from groundstation.wire import Wire

SIX = ("odrive", "vesc", "cia402", "roboclaw", "dynamixel", "ros_arduino")
PULLS: dict[str, tuple[FaultKind, ...]] = {"unplug": ("unplugged",), "kill": ("hung", "off"), "bus-off": ("bus-off",)}
"""How a plug is pulled. A killed controller answers nothing and holds no motor."""
CAUSES = {"unplug": "hung up", "kill": "no telemetry for", "bus-off": "bus-off"}
WATCHDOG_S = 0.2
COAST_MPS2 = 0.6
"""Of :class:`contract.arena.Platform`."""
STEP_S = 0.01
TO_NOTICE_S = 0.6
"""Twice ``safety.driver_silence_s``, and a step."""


def six_families(seed: int, targets: int = 19, kinds: tuple[str, ...] = SIX, limit_s: float = 120.0) -> World:
    """A mission of six robots, one controller family each."""
    job = Job(6, targets, seed, "field", "field", limit_s, wired=True)
    arena = arena_for(job)
    robots = {
        name: msgspec.structs.replace(robot, wheels={"kind": kind, **COMMON, **WHEELS[kind]})
        for (name, robot), kind in zip(arena.robots.items(), kinds, strict=True)
    }
    arena = msgspec.structs.replace(arena, robots=robots)
    return World(arena, scenario(6, targets, seed), FIELD, seed, limit_s, wired=True)


class Pull(NamedTuple):
    """What one pulled plug came to."""

    robot: str
    how: str
    held_s: float
    """How long the motors were held after it."""
    rolled_m: float
    reason: str
    """The robot's report says so."""
    split: bool
    """Robots never pulled were not all in one piece of the network, those pulled counted as they stand."""
    moved_before_arming: bool
    runs_again: bool


class Puller:
    """Pulls plugs of a running mission, one after the other, and puts each robot back to work."""

    def __init__(self, world: World, seed: int) -> None:
        self.world = world
        self.random = random.Random(seed)
        self._order_id = 100
        self._time_s = 0.0
        assert isinstance(world.hops, Wire)
        self.emulated = world.hops.emulated
        self._reports: dict[str, bytes] = {}
        self._pulled: set[str] = set()
        self._split = False
        world.tap = self._hear

    def _hear(self, key: str, payload: bytes, now_ns: int) -> None:
        if key.endswith("/report"):
            self._reports[key.split("/")[-2]] = payload

    def run(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / STEP_S))):
            self._time_s += min(seconds, STEP_S)
            self.world.until(self._time_s)
            self._split = self._split or not self._others_are_connected()

    def _others_are_connected(self) -> bool:
        world = self.world
        range_m = world.arena.control.sensing_radius_m
        places = {name: world.hops.pose(name)[:2] for name in world.agents}
        others = set(places) - self._pulled
        seen, edge = set(), [next(iter(others))] if others else []
        while edge:
            here = edge.pop()
            seen.add(here)
            edge += [name for name in places if name not in seen and math.dist(places[name], places[here]) <= range_m]
        return others <= seen

    def order(self, robot: str, order: Order) -> None:
        """As the station would, to one robot."""
        world = self.world
        world._order_seq += 1
        self._order_id += 1
        heartbeat = StationHeartbeat(
            schema_version=SCHEMA_VERSION,
            boot=1,
            seq=world._order_seq,
            stamp_ns=world.now_ns,
            order=order,
            order_id=self._order_id,
            robots=(robot,),
            mission=MISSION,
            arena_hash=world._digest,
        )
        key = world.keys.heartbeat
        world.hops.deliver(robot, key, world.hops.pack(key, heartbeat), world.now_ns)

    def pull(self) -> Pull:
        """Wait for a moving robot, pull its plug, watch it stop, mend it, arm it again."""
        robot = self.random.choice(list(self.world.agents))
        device = self.emulated.robots[robot]
        ways = [how for how in PULLS if how != "bus-off" or hasattr(device.controller, "bus_off")]
        how = self.random.choice(ways)
        self.run(self.random.uniform(0.1, 0.6))
        start = device.wheels.left.angle_rad, device.wheels.right.angle_rad
        self._pulled.add(robot)
        self._split = False
        for kind in PULLS[how]:
            self.emulated.fault(robot, kind)
        held_s = 0.0
        for _ in range(60):
            self.run(0.01)
            if any(wheel.powered and wheel.supplied for wheel in device.wheels):
                held_s += 0.01
        self.run(TO_NOTICE_S - 0.5 + 1.0)
        report = decode(RobotReport, self._reports[robot])
        radius_m = self.world.arena.platform.wheel_radius_m
        rolled_m = max(abs(wheel.angle_rad - at) for wheel, at in zip(device.wheels, start, strict=True)) * radius_m
        rest = device.wheels.left.angle_rad, device.wheels.right.angle_rad
        for kind in PULLS[how]:
            self.emulated.repair(robot, kind)
        self.run(0.3)
        moved = any(abs(wheel.angle_rad - at) > 0.05 for wheel, at in zip(device.wheels, rest, strict=True))
        for order in ("disarm", "arm", "run"):
            self.order(robot, order)  # type: ignore[arg-type]
            self.run(0.35 if order == "disarm" else 0.2)
        again = self.world.agents[robot].run_state == "running"
        return Pull(robot, how, held_s, rolled_m, report.reason, self._split, moved, again)


def judge(pull: Pull, max_speed_mps: float = 0.8) -> None:
    """Every promise about a pulled plug."""
    assert pull.held_s <= WATCHDOG_S + 0.011, pull
    assert pull.rolled_m <= max_speed_mps * WATCHDOG_S + max_speed_mps**2 / (2 * COAST_MPS2) + 0.03, pull
    assert CAUSES[pull.how] in pull.reason, pull
    assert f"of {pull.robot} on " in pull.reason, pull
    assert not pull.split, pull
    assert not pull.moved_before_arming, pull
    assert pull.runs_again, pull
