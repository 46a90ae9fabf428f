"""A whole mission in virtual time: the very Agents of the robots, a plant, a radio, one seeded generator.

No threads, no clock, no sleep. Same arena, conditions and seed: the same run, bit for bit.
"""

import heapq
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from contract.arena import Arena, digest
from contract.codec import encode
from contract.keys import Keys
from contract.messages import (
    SCHEMA_VERSION,
    Message,
    MocapFrame,
    NeighbourState,
    Order,
    StationHeartbeat,
    StepBatch,
    StopRequest,
    Target,
    TargetCloud,
)
from groundstation.conditions import Conditions
from groundstation.hops import Hops, ShortCut
from groundstation.plant import Plant
from groundstation.referee import Referee
from groundstation.result import Result, TimeBook
from groundstation.scoring import MISSION, Phase, Score, truth
from groundstation.targets import Scenario
from groundstation.vicinity import CROWD, Vicinity
from onboard.agent import Agent
from onboard.ahdc.stopping import Brake
from onboard.journal import JournalledAgent
from onboard.odometry import Pose
from onboard.sensing import FORGET_NS

SUBSTEP_NS = 2_000_000
"""Motion is integrated and the network and distances are checked this often."""
HEARTBEAT_NS = 50_000_000
TICK_NS = 18_000_000
"""A robot's loop runs this long after its last turn although nothing has arrived."""
ARM_NS = 200_000_000
RUN_NS = 400_000_000
LAST_WORDS_NS = 1_000_000_000
"""What is still unsaid this long after the end stays so."""
TRUTH_NS = 20_000_000
"""How often a tap hears where the bodies really are."""


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
        self._order_seq = 0
        self.referee = Referee(self.arena.control.sensing_radius_m, self.arena.platform.diameter_m)
        self._score = Score(self.arena, self.scenario, self.seed, self.referee)
        self.keys = Keys(self.arena.arena.name)
        self._frame_key = self.keys.mocap_frame
        self._handlers: dict[str, Callable[[str, Any], None]] = {
            "frame": self._on_frame,
            "arrival": self._on_arrival,
            "message": self._on_message,
            "tick": self._on_tick,
            "heartbeat": self._on_heartbeat,
            "check": self._on_check,
            "act": lambda _, act: act(),
        }
        self._known_occupied = 0
        self._vicinity = Vicinity(self.radius_m, self.arena.control.max_speed_mps * FORGET_NS * 1e-9)
        self._phase_ns: dict[str, float] = {}
        self._ran_ns: dict[str, int] = {}
        self._hung: set[str] = set()
        self.offline: set[str] = set()
        """Robots that the network does not reach; what they say is lost, too."""
        self.skew_ns: dict[str, int] = {}
        """How far a robot's clock is ahead of the site's."""
        self.late_ns: dict[str, int] = {}
        """How much longer everything takes to a robot."""
        self.hidden: set[str] = set()
        """Robots that motion capture does not see."""
        self.excluded: set[str] = set()
        """Robots that the station has taken out of the network; the referee looks at the others."""
        self.station_beats = True
        rng, conditions = self._rng, self.conditions
        plants: dict[str, Plant] = {}
        for name, start in zip(self.arena.robots, self.scenario.starts, strict=True):
            heading = rng.uniform(-math.pi, math.pi)
            brake = Brake(rng.uniform(*conditions.deceleration_mps2), rng.uniform(*conditions.lag_s))
            plants[name] = Plant(Pose(start[0], start[1], heading), brake)
            self.agents[name] = self._agent(name, 1)
            self._phase_ns[name] = rng.uniform(*conditions.pose_age_s) * 1e9
        self.hops = self._way(plants)
        self.now_ns = self._begin_ns = self.hops.begin_ns
        self.cloud = TargetCloud(
            mission=MISSION,
            seed=self.seed,
            start_direction_rad=round(self.scenario.start_direction_rad, 5),
            targets=tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(self.scenario.targets)),
        )
        self._publish(self.keys.targets, self.cloud)
        self.orders: list[tuple[int, Order, tuple[str, ...]]] = [
            (self._begin_ns, "disarm", ()),
            (self._begin_ns + ARM_NS, "arm", ()),
            (self._begin_ns + RUN_NS, "run", ()),
        ]
        """When the station orders what, and whom; in the order of time."""
        for kind in ("frame", "heartbeat", "check"):
            self._at(self.now_ns, kind, "", None)
        for name in self.agents:
            self._ran_ns[name] = self.now_ns
            self._at(self.now_ns + TICK_NS, "tick", name, None)

    def _agent(self, name: str, boot: int) -> Agent:
        return (Agent if self.tap is None else JournalledAgent)(self.arena, name, boot)

    def _way(self, plants: Mapping[str, Plant]) -> Hops:
        if not self.wired:
            return ShortCut(self.arena, plants, self.agents)
        from groundstation.wire import Wire

        return Wire(self.arena, plants, self.agents, self.seed, self.skew_ns)

    def _own_ns(self, name: str) -> int:
        """What time it is by the robot's own clock."""
        return self.now_ns + self.skew_ns.get(name, 0)

    def run(self) -> Result:
        """Play until every target is occupied or the time is up."""
        return self.result(self.until(self.limit_s))

    def until(self, mission_s: float) -> bool:
        """Play to that time after the start, which may be negative; True once every target is occupied.

        What arrives while a robot waits for its motors reaches it afterwards, but for frames: newer ones follow.
        """
        limit_ns = self._begin_ns + RUN_NS + int(mission_s * 1e9)
        total = len(self.scenario.targets)
        while self._play(limit_ns):
            if self._running and self._known_occupied.bit_count() >= total and self._occupied() == total:
                return True
        return False

    def _play(self, limit_ns: int) -> bool:
        """Let things happen until a frame has arrived somewhere, then True, or until that time."""
        queue, handlers, hung, offline = self._queue, self._handlers, self._hung, self.offline
        pop, free_of = heapq.heappop, self.hops.free_ns if self.wired else None
        while self.now_ns < limit_ns:
            self.now_ns, _, kind, name, what = pop(queue)
            if name:
                if kind != "tick" and (name in hung or name in offline):
                    continue
                if free_of is not None and (free_ns := free_of(name)) > self.now_ns:
                    if kind != "arrival":
                        self._at(free_ns, kind, name, what)
                    continue
            handlers[kind](name, what)
            if kind == "arrival":
                return True
        return False

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
            if name in self._hung or name in self.offline:
                continue
            if late_ns := self.late_ns.get(name, 0):
                self._at(self.now_ns + late_ns, "message", name, (key, parcel))
            elif (free_ns := self.hops.free_ns(name)) > self.now_ns:
                self._at(free_ns, "message", name, (key, parcel))
            else:
                self.hops.deliver(name, key, parcel, self.now_ns)

    def _tell(self, key: str, parcel: Any) -> None:
        if self.tap is not None:
            self.tap(key, parcel if isinstance(parcel, bytes) else encode(parcel), self.now_ns)

    def _tell_status(self, phase: Phase, detail: str = "") -> None:
        if self.tap is not None:
            elapsed_s = (self.now_ns - self._start_ns) * 1e-9 if self._running else 0.0
            crew = [self.hops.pose(name)[:2] for name in self.agents if name not in self.excluded]
            status = self._score.status(self.now_ns, phase, detail, elapsed_s, crew, self.excluded)
            self._tell(self.keys.status, status)

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
            if name not in self.hidden:
                seen[name] = Pose(x, y, math.remainder(heading, math.tau))
        frame = self.hops.frame(self.now_ns, seen)
        if frame is not None:
            self._tell(self.keys.mocap_frame, frame)
            shown: dict[str, MocapFrame] = {}
            if len(self.agents) > CROWD and not self.wired:
                shown = self._vicinity.shown(frame, {name: self.hops.pose(name) for name in self.agents})
            for name in self.agents:
                age_ns = self._age_ns(name)
                if conditions.frame_loss == 0.0 or rng.random() >= conditions.frame_loss:
                    due_ns = self.now_ns + self.hops.way_ns + age_ns + self.late_ns.get(name, 0)
                    self._at(due_ns, "arrival", name, shown.get(name, frame))
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
        hops, now_ns = self.hops, self.now_ns
        if hops.deliver(name, self._frame_key, frame, now_ns):
            agent, own_ns = self.agents[name], self._own_ns(name)
            hops.sense(name, now_ns)
            self._ran_ns[name] = now_ns
            if hops.drive(name, agent.step(own_ns), now_ns):
                agent.wrote(own_ns)
            for key, message in agent.outbox(own_ns):
                self._send(name, key, message)
            self._known_occupied |= agent.controller.tasking.memory.occupied

    def hang(self, name: str, on: bool = True) -> None:
        """Freeze a robot's process, or let it go on; what reaches it meanwhile is lost."""
        self.hops.advance(self.now_ns)
        self.hops.hang(name, on)
        (self._hung.add if on else self._hung.discard)(name)

    def later(self, after_s: float, act: Callable[[], None]) -> None:
        """Do something to this world when that time has passed."""
        self._at(self.now_ns + int(after_s * 1e9), "act", "", act)

    def restart(self, name: str, boot: int = 2, after_s: float = 0.5) -> None:
        """Kill a robot's process; a new one, which has forgotten everything, has come up after that time."""
        self.hang(name)
        self.later(after_s, lambda: self._come_up(name, boot))

    def _come_up(self, name: str, boot: int) -> None:
        self.agents[name] = self._agent(name, boot)
        self.hang(name, False)
        self.hops.replace(name, self.now_ns)

    def _on_tick(self, name: str, _: Any) -> None:
        if name not in self._hung and self.now_ns - self._ran_ns[name] >= TICK_NS:
            self._ran_ns[name] = self.now_ns
            self.hops.drive(name, self.agents[name].tick(self._own_ns(name)), self.now_ns)
        self._at(max(self._ran_ns[name], self.now_ns - TICK_NS + SUBSTEP_NS) + TICK_NS, "tick", name, None)

    def _on_message(self, name: str, what: tuple[str, Any]) -> None:
        self.hops.deliver(name, *what, self.now_ns)

    @property
    def radius_m(self) -> float:
        """r_c"""
        return self.arena.control.sensing_radius_m

    def stop(self, stop_id: int = 1) -> None:
        """A StopRequest to all; robots obey between two frames."""
        self._publish(self.keys.stop, StopRequest(stamp_ns=self.now_ns, source="lockstep", stop_id=stop_id))
        for name, agent in self.agents.items():
            if name not in self._hung and name not in self.offline:
                self.hops.drive(name, agent.tick(self._own_ns(name)), self.now_ns)

    def whisper(self, name: str, key: str, message: Message) -> None:
        """Something that only one robot is told."""
        self.hops.deliver(name, key, self.hops.pack(key, message), self.now_ns)

    def _send(self, sender: str, key: str, message: Message) -> None:
        if sender in self.offline:
            return
        parcel = self.hops.pack(key, message) if self.tap is not None or isinstance(message, NeighbourState) else None
        self._tell(key, parcel)
        if isinstance(message, NeighbourState):
            self._score.told_occupied |= int(message.occupied or "0", 16)
            low, high = self.conditions.message_age_s
            for name in self._vicinity.hearers(sender, self.agents, self.hops.pose):
                if name != sender and (self.conditions.loss == 0.0 or self._rng.random() >= self.conditions.loss):
                    delay_ns = int(self._rng.uniform(low, high) * 1e9) if high > 0 else 0
                    delay_ns += self.late_ns.get(name, 0)
                    self._at(self.now_ns + delay_ns, "message", name, (key, parcel))
        elif isinstance(message, StepBatch) and self._score.book is not None:
            for step in message.steps:
                self._score.book.note(step)

    def _on_heartbeat(self, _: str, __: Any) -> None:
        self._order_seq += 1
        order_id = sum(entry[0] <= self.now_ns for entry in self.orders)
        order, robots = self.orders[order_id - 1][1:]
        if order == "run" and not self._running:
            self._running, self._start_ns, self._score.book = True, self.now_ns, TimeBook(self.now_ns)
        heartbeat = StationHeartbeat(
            schema_version=SCHEMA_VERSION,
            boot=1,
            seq=self._order_seq,
            stamp_ns=self.now_ns,
            order=order,
            order_id=order_id,
            robots=robots,
            excluded=tuple(sorted(self.excluded)),
            mission=MISSION,
            arena_hash=self._digest,
        )
        if self.station_beats:
            self._publish(self.keys.heartbeat, heartbeat)
        if self.tap is not None:
            self._tell_status("running" if self._running else "armed" if order == "arm" else "ready")
        self._at(self.now_ns + HEARTBEAT_NS, "heartbeat", "", None)

    def _on_check(self, _: str, __: Any) -> None:
        self.hops.advance(self.now_ns)
        places = self.hops.places()
        for name in self.excluded:
            places.pop(name, None)
        self.referee.look(places)
        if self.tap is not None and (self.now_ns - self._begin_ns) % TRUTH_NS == 0:
            for name in self.agents:
                self._tell(self.keys.motor(name), truth(name, self.now_ns, self.hops.pose(name)))
        self._at(self.now_ns + SUBSTEP_NS, "check", "", None)

    def result(self, completed: bool) -> Result:
        """What became of it, at this moment. A tap also hears the end, once all that was reached has been told."""
        mission_s = (self.now_ns - self._start_ns) * 1e-9
        period_s = next(iter(self.agents.values())).pacing.period_s
        found = self._score.result(completed, self.now_ns, mission_s, self._occupied(), period_s, self._why())
        if self.tap is not None and self._running:
            late_ns = self.now_ns + LAST_WORDS_NS
            whole = (1 << len(self.scenario.targets)) - 1
            while completed and self._score.told_occupied != whole and self._play(late_ns):
                pass
            self._tell_status("completed" if completed else "failed", "" if completed else "time up")
        return found

    def _why(self) -> str:
        parts = []
        for name, agent in self.agents.items():
            tasking = agent.controller.tasking
            parts.append(f"{name} {agent.run_state}/{tasking.task.value}:{tasking.target}")
        return ", ".join(parts)
