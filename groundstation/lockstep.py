"""A whole mission in virtual time: the very Agents of the robots, a plant, a radio, one seeded generator.

No threads, no clock, no sleep. Same arena, conditions and seed: the same run, bit for bit.
"""

import heapq
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from contract.arena import Arena, digest
from contract.codec import encode
from contract.keys import Keys
from contract.messages import (
    SCHEMA_VERSION,
    Message,
    NeighbourState,
    Order,
    RobotStep,
    StationHeartbeat,
    StepBatch,
    Target,
    TargetCloud,
)
from groundstation.hops import Hops, Plant, ShortCut
from groundstation.targets import Scenario, lower_bound_s
from groundstation.wire import Wire
from onboard.agent import Agent
from onboard.ahdc.stopping import Brake
from onboard.journal import JournalledAgent
from onboard.odometry import Pose

SUBSTEP_NS = 2_000_000
"""Motion is integrated and the network and distances are checked this often."""
HEARTBEAT_NS = 50_000_000
TICK_NS = 18_000_000
"""A robot's loop runs this long after its last turn although nothing has arrived."""
COLLISION_SHARE = 1.0
"""Of the platform's diameter."""
ARM_NS = 200_000_000
RUN_NS = 400_000_000
WAITS = ("", "link", "separation", "fence", "brake", "hold", "help", "free", "indicator", "start", "joining")


class Conditions(NamedTuple):
    """What the world does to robots. Intervals are (low, high), drawn per robot or per message."""

    pose_age_s: tuple[float, float] = (0.0, 0.0)
    """Exposure to arrival at the agent, of frames and of neighbours' messages."""
    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    loss: float = 0.0
    """Share of neighbour messages lost."""
    lag_s: tuple[float, float] = (0.0, 0.0)
    deceleration_mps2: tuple[float, float] = (1e6, 1e6)
    """Of the wheel rims, acceleration alike."""
    synchronous: bool = True
    """All loops run in phase."""


IDEAL = Conditions()
FIELD = Conditions(
    pose_age_s=(0.020, 0.080),
    position_noise_m=0.0025,
    heading_noise_rad=0.015,
    loss=0.10,
    lag_s=(0.060, 0.150),
    deceleration_mps2=(1.6, 2.4),
    synchronous=False,
)


class Result(msgspec.Struct):
    """What became of one run."""

    seed: int
    robots: int
    targets: int
    completed: bool
    occupied: int
    mission_s: float
    disconnected_steps: int
    collisions: int
    min_distance_m: float
    lower_bound_s: float
    ratio_to_lower_bound: float | None
    run_steps: int
    why: str = ""
    waits_s: dict[str, float] = {}
    """Robot-seconds by what bounded the motion."""


@dataclass
class World:
    """One mission; :meth:`run` plays it to the end."""

    arena: Arena
    scenario: Scenario
    conditions: Conditions
    seed: int
    limit_s: float = 180.0
    now_ns: int = 0
    wired: bool = False
    """Over real bytes."""
    agents: dict[str, Agent] = field(default_factory=dict)
    disconnected_steps: int = 0
    collisions: int = 0
    min_distance_m: float = math.inf
    tap: Callable[[str, bytes, int], None] | None = None
    """Hears key, payload and time of whatever is published, as a recorder would."""

    def __post_init__(self) -> None:
        self._digest = digest(self.arena)
        self._rng = random.Random(self.seed * 7919 + 13)
        self._queue: list[tuple[int, int, str, str, Any]] = []
        self._count = 0
        self._frame = 0
        self._running = False
        self._start_ns = 0
        self._colliding: set[tuple[str, str]] = set()
        self._tree: list[tuple[str, str]] = []
        self._waits: dict[str, int] = {}
        self._order_seq = 0
        self._radius = self.arena.control.sensing_radius_m
        self._diameter = self.arena.platform.diameter_m * COLLISION_SHARE
        self._keys = Keys(self.arena.arena.name)
        self._phase_ns: dict[str, float] = {}
        self._ran_ns: dict[str, int] = {}
        rng, conditions = self._rng, self.conditions
        plants = {}
        for name, start in zip(self.arena.robots, self.scenario.starts, strict=True):
            heading = rng.uniform(-math.pi, math.pi)
            brake = Brake(rng.uniform(*conditions.deceleration_mps2), rng.uniform(*conditions.lag_s))
            plants[name] = Plant(Pose(start[0], start[1], heading), brake)
            self.agents[name] = (Agent if self.tap is None else JournalledAgent)(self.arena, name, boot=1)
            self._phase_ns[name] = rng.uniform(*conditions.pose_age_s) * 1e9
        self.hops: Hops = (
            Wire(self.arena, plants, self.agents, self.seed)
            if self.wired
            else ShortCut(self.arena, plants, self.agents)
        )
        self.now_ns = self._begin_ns = self.hops.begin_ns
        cloud = TargetCloud(
            mission="simulate",
            seed=self.seed,
            start_direction_rad=round(self.scenario.start_direction_rad, 5),
            targets=tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(self.scenario.targets)),
        )
        self._publish(self._keys.targets, cloud)
        for kind in ("frame", "heartbeat", "check"):
            self._at(self.now_ns, kind, "", None)
        for name in self.agents:
            self._ran_ns[name] = self.now_ns
            self._at(self.now_ns + TICK_NS, "tick", name, None)

    def run(self) -> Result:
        """Play until every target is occupied or the time is up."""
        return self._result(self.until(self.limit_s))

    def until(self, mission_s: float) -> bool:
        """Play to that time after the start, which may be negative; True once every target is occupied.

        What arrives while a robot waits for its motors reaches it afterwards, but for frames: newer ones follow.
        """
        limit_ns = self._begin_ns + RUN_NS + int(mission_s * 1e9)
        handlers: dict[str, Callable[[str, Any], None]] = {
            "frame": self._on_frame,
            "arrival": self._on_arrival,
            "message": self._on_message,
            "tick": self._on_tick,
            "heartbeat": self._on_heartbeat,
            "check": self._on_check,
        }
        done = False
        while not done and self.now_ns < limit_ns:
            self.now_ns, _, kind, name, what = heapq.heappop(self._queue)
            if name and (free_ns := self.hops.free_ns(name)) > self.now_ns:
                if kind != "arrival":
                    self._at(free_ns, kind, name, what)
                continue
            handlers[kind](name, what)
            done = self._running and kind == "arrival" and self._occupied() == len(self.scenario.targets)
        return done

    def _at(self, when_ns: int, kind: str, name: str, what: Any) -> None:
        self._count += 1
        heapq.heappush(self._queue, (when_ns, self._count, kind, name, what))

    def _occupied(self) -> int:
        bitmap = 0
        for agent in self.agents.values():
            bitmap |= agent.controller.tasking.memory.occupied
        return bitmap.bit_count()

    def _publish(self, key: str, message: Message) -> None:
        """Give all robots a message of the station's."""
        parcel = self.hops.pack(key, message)
        self._tell(key, parcel)
        for name in self.agents:
            if (free_ns := self.hops.free_ns(name)) > self.now_ns:
                self._at(free_ns, "message", name, (key, parcel))
            else:
                self.hops.deliver(name, key, parcel, self.now_ns)

    def _tell(self, key: str, parcel: Any) -> None:
        if self.tap is not None:
            self.tap(key, parcel if isinstance(parcel, bytes) else encode(parcel), self.now_ns)

    def _on_frame(self, _: str, __: Any) -> None:
        conditions, rng = self.conditions, self._rng
        self.hops.advance(self.now_ns)
        seen = {}
        for name in self.agents:
            x, y, heading = self.hops.pose(name)
            if conditions.position_noise_m > 0:
                x += rng.gauss(0.0, conditions.position_noise_m)
                y += rng.gauss(0.0, conditions.position_noise_m)
                heading += rng.gauss(0.0, conditions.heading_noise_rad)
            seen[name] = Pose(x, y, math.remainder(heading, math.tau))
        frame = self.hops.frame(self.now_ns, seen)
        if frame is not None:
            self._tell(self._keys.mocap_frame, frame)
            for name in self.agents:
                self._at(self.now_ns + self.hops.way_ns + self._age_ns(name), "arrival", name, frame)
        self._frame += 1
        due_ns = self._begin_ns + round(self._frame * 1e9 / self.arena.mocap.frame_rate_hz)
        self._at(due_ns, "frame", "", None)

    def _age_ns(self, name: str) -> int:
        """Base age of the robot plus jitter, clipped to the interval."""
        low, high = self.conditions.pose_age_s
        if high <= 0.0:
            return 0
        age = self._phase_ns[name] + self._rng.uniform(-0.25, 0.25) * (high - low) * 1e9
        return int(min(high * 1e9, max(low * 1e9, age)))

    def _on_arrival(self, name: str, frame: Any) -> None:
        if self.hops.deliver(name, self._keys.mocap_frame, frame, self.now_ns):
            agent, now_ns = self.agents[name], self.now_ns
            self.hops.sense(name, now_ns)
            self._ran_ns[name] = now_ns
            if self.hops.drive(name, agent.step(now_ns), now_ns):
                agent.wrote(now_ns)
            for key, message in agent.outbox(now_ns):
                self._send(name, key, message)

    def _on_tick(self, name: str, _: Any) -> None:
        if self.now_ns - self._ran_ns[name] >= TICK_NS:
            self._ran_ns[name] = self.now_ns
            self.hops.drive(name, self.agents[name].tick(self.now_ns), self.now_ns)
        self._at(self._ran_ns[name] + TICK_NS, "tick", name, None)

    def _on_message(self, name: str, what: tuple[str, Any]) -> None:
        self.hops.deliver(name, *what, self.now_ns)

    def _send(self, sender: str, key: str, message: Message) -> None:
        parcel = self.hops.pack(key, message) if self.tap is not None or isinstance(message, NeighbourState) else None
        self._tell(key, parcel)
        if isinstance(message, NeighbourState):
            low, high = self.conditions.pose_age_s
            for name in self.agents:
                if name != sender and (self.conditions.loss == 0.0 or self._rng.random() >= self.conditions.loss):
                    delay_ns = int(self._rng.uniform(low, high) * 1e9) if high > 0 else 0
                    self._at(self.now_ns + delay_ns, "message", name, (key, parcel))
        elif isinstance(message, StepBatch):
            for step in message.steps:
                self._note(step)

    def _note(self, step: RobotStep) -> None:
        if self._running:
            self._waits[step.waits] = self._waits.get(step.waits, 0) + 1

    def _on_heartbeat(self, _: str, __: Any) -> None:
        self._order_seq += 1
        order: Order = "disarm"
        order_id = 1
        if self.now_ns >= self._begin_ns + RUN_NS:
            order, order_id = "run", 3
            if not self._running:
                self._running, self._start_ns = True, self.now_ns
        elif self.now_ns >= self._begin_ns + ARM_NS:
            order, order_id = "arm", 2
        heartbeat = StationHeartbeat(
            schema_version=SCHEMA_VERSION,
            boot=1,
            seq=self._order_seq,
            stamp_ns=self.now_ns,
            order=order,
            order_id=order_id,
            mission="simulate",
            arena_hash=self._digest,
        )
        self._publish(self._keys.heartbeat, heartbeat)
        self._at(self.now_ns + HEARTBEAT_NS, "heartbeat", "", None)

    def _on_check(self, _: str, __: Any) -> None:
        self.hops.advance(self.now_ns)
        places = {name: self.hops.pose(name)[:2] for name in self.agents}
        names = list(places)
        for i, first in enumerate(names):
            x, y = places[first]
            for second in names[i + 1 :]:
                other = places[second]
                dx, dy = other[0] - x, other[1] - y
                if dx * dx + dy * dy < 0.25:
                    distance = math.sqrt(dx * dx + dy * dy)
                    self.min_distance_m = min(self.min_distance_m, distance)
                    pair = (first, second)
                    if distance < self._diameter:
                        if pair not in self._colliding:
                            self._colliding.add(pair)
                            self.collisions += 1
                    else:
                        self._colliding.discard(pair)
        if not self._connected(places):
            self.disconnected_steps += 1
        self._at(self.now_ns + SUBSTEP_NS, "check", "", None)

    def _connected(self, places: dict[str, tuple[float, float]]) -> bool:
        if len(self._tree) == len(places) - 1 and all(
            math.dist(places[a], places[b]) <= self._radius for a, b in self._tree
        ):
            return True
        names = list(places)
        inside, frontier, tree = {names[0]}, [names[0]], []
        while frontier:
            first = frontier.pop()
            for second in names:
                if second not in inside and math.dist(places[first], places[second]) <= self._radius:
                    inside.add(second)
                    frontier.append(second)
                    tree.append((first, second))
        self._tree = tree
        return len(inside) == len(names)

    def _result(self, completed: bool) -> Result:
        control = self.arena.control
        mission_s = (self.now_ns - self._start_ns) * 1e-9
        bound_s = lower_bound_s(
            self.scenario.starts,
            self.scenario.targets,
            control.max_speed_mps,
            control.occupying_time_s,
            control.reach_m,
        )
        period_s = next(iter(self.agents.values())).pacing.period_s
        return Result(
            seed=self.seed,
            robots=len(self.agents),
            targets=len(self.scenario.targets),
            completed=completed,
            occupied=self._occupied(),
            mission_s=round(mission_s, 4),
            disconnected_steps=self.disconnected_steps,
            collisions=self.collisions,
            min_distance_m=round(self.min_distance_m, 5) if math.isfinite(self.min_distance_m) else 0.0,
            lower_bound_s=round(bound_s, 4),
            ratio_to_lower_bound=round(mission_s / bound_s, 4) if completed and bound_s > 0 else None,
            run_steps=round(mission_s / period_s),
            why="" if completed else self._why(),
            waits_s={name: round(count * period_s, 3) for name, count in sorted(self._waits.items())},
        )

    def _why(self) -> str:
        parts = []
        for name, agent in self.agents.items():
            tasking = agent.controller.tasking
            parts.append(f"{name} {agent.run_state}/{tasking.task.value}:{tasking.target}")
        return ", ".join(parts)
