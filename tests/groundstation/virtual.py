"""A station's session and the robots' very agents in virtual time, without bytes: what orders make of a swarm."""

from collections.abc import Callable, Iterable
from typing import Any

from contract.arena import Arena
from contract.keys import Keys
from contract.messages import Message, NeighbourState, OrderRequest, Request, RobotReport, TargetCloud
from groundstation.course import Plan
from groundstation.hops import Hops, Plant, ShortCut
from groundstation.session import Session
from groundstation.wire import Wire
from onboard.agent import Agent
from onboard.ahdc.stopping import Brake
from onboard.inbox import read
from onboard.odometry import Pose

MS = 1_000_000
PERIOD_NS = 10 * MS
BRAKE = Brake(1.8, 0.1)


class Virtual:
    """Frames and control steps every 10 ms, the station every 50 ms; every message arrives at once."""

    def __init__(
        self, arena: Arena, cloud: TargetCloud, poses: Iterable[Pose], plan: Plan | None = None, wired: bool = False
    ) -> None:
        """:param wired: the wheels' and motion capture's very bytes."""
        self.arena = arena
        self.keys = Keys(arena.arena.name)
        self.agents = {name: Agent(arena, name, boot=1) for name in arena.robots}
        plants = self.plants = {name: Plant(pose, BRAKE) for name, pose in zip(arena.robots, poses, strict=True)}
        self.hops: Hops[Any] = (
            Wire(arena, plants, self.agents, seed=1) if wired else ShortCut(arena, plants, self.agents)
        )
        self.session = Session(arena, cloud, 1, plan or Plan(), 0)
        self.now_ns = PERIOD_NS * (self.hops.begin_ns // PERIOD_NS + 1) if isinstance(self.hops, Wire) else 0
        self.said: list[Message] = []
        """Of the last period."""
        self.least_m = float("inf")
        self.silence = False
        """The station says nothing: it has ended."""
        self._requests = 0

    def pose(self, name: str) -> Pose:
        return self.hops.pose(name)

    def order(self, order: Request, robots: tuple[str, ...] = ()) -> None:
        self._requests += 1
        request = OrderRequest(stamp_ns=self.now_ns, source="test", number=self._requests, order=order, robots=robots)
        self.session.receive(request, self.now_ns)

    def turn(self) -> None:
        """One period."""
        self.now_ns += PERIOD_NS
        self.hops.advance(self.now_ns)
        frame = self.hops.frame(self.now_ns, {name: self.pose(name) for name in self.agents})
        if frame is not None:
            seen = read(self.keys, self.keys.mocap_frame, frame) if isinstance(frame, bytes) else frame
            self.session.receive(seen, self.now_ns)
        if self.now_ns % (5 * PERIOD_NS) == 0 and not self.silence:
            self.session.advance(self.now_ns)
            for message in (self.session.cloud, self.session.heartbeat(self.now_ns)):
                self._deliver("", message)
        self.said = []
        for name, agent in self.agents.items():
            due = frame is not None and self.hops.deliver(name, self.keys.mocap_frame, frame, self.now_ns)
            self.hops.sense(name, self.now_ns)
            self.hops.drive(name, agent.step(self.now_ns) if due else agent.tick(self.now_ns), self.now_ns)
            for _, message in agent.outbox(self.now_ns):
                self.said.append(message)
                if isinstance(message, NeighbourState | RobotReport):
                    self.session.receive(message, self.now_ns)
                if isinstance(message, NeighbourState):
                    self._deliver(name, message)
        places = [self.pose(name) for name in self.agents]
        for i, a in enumerate(places):
            for b in places[i + 1 :]:
                self.least_m = min(self.least_m, ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5)

    def _deliver(self, sender: str, message: Message) -> None:
        for name, agent in self.agents.items():
            if name != sender:
                agent.receive(message, self.now_ns)

    def until(self, done: Callable[[], bool], within_s: float) -> None:
        """Play until ``done``; AssertionError naming the session's state when it does not come true."""
        end_ns = self.now_ns + int(within_s * 1e9)
        while not done():
            words = f"{self.session.phase}: {self.session.detail}"
            assert self.now_ns < end_ns, f"not within {within_s:g} s; {words}"
            self.turn()

    def phase(self, phase: str, within_s: float) -> None:
        self.until(lambda: self.session.phase == phase, within_s)
