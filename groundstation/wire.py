"""The way of a lockstep mission over real bytes, in virtual time. Pure.

body -> NatNet datagram -> decoder, checks, frames -> JSON -> agent -> gate -> driver's bytes -> emulated controller
-> motor -> body, and telemetry back: the modules of a real mission, without their sockets, ptys and clocks.
"""

from collections import Counter
from collections.abc import Callable, Mapping

from contract.arena import Arena
from contract.codec import WireError, encode
from contract.keys import Keys
from contract.messages import Message
from drivers.base import WheelSpeeds
from drivers.lifecycle import Wheels
from drivers.mock.host import EmulatedWheels
from drivers.mock.wire import VirtualClock
from drivers.registry import open_robot
from groundstation.plant import Plant
from mocap_bridge.mock.bodies import BodyState, settings_of
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.natnet import version
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.natnet_receiver import NatNetReceiver
from onboard.agent import Agent, Drive
from onboard.inbox import read
from onboard.odometry import Pose

DATAGRAM_NS = 100_000
"""A datagram's way, either direction."""
CLIENT = ("127.0.0.1", 40000)
HANDSHAKE_NS = 600_000_000
TURN_NS = 10_000_000

NO_SKEW: Mapping[str, int] = {}

Damage = Callable[[bytes], bytes]


def sound(data: bytes) -> bytes:
    """No damage."""
    return data


class Wire:
    """:class:`groundstation.hops.Hops` by the very bytes of the robots, the network and motion capture."""

    way_ns = 2 * DATAGRAM_NS

    def __init__(
        self,
        arena: Arena,
        plants: Mapping[str, Plant],
        agents: Mapping[str, Agent],
        seed: int,
        skew_ns: Mapping[str, int] = NO_SKEW,
    ) -> None:
        """:param skew_ns: how far a robot's clock is ahead, looked up whenever it tells the time."""
        self._arena = arena
        self._skew_ns = skew_ns
        self.damage_datagram: Damage = sound
        self.damage_message: Damage = sound
        """What happens to bytes on their way; wheel lines are damaged by ``emulated.fault``."""
        self.emulated = EmulatedWheels(arena, seed=seed)
        self.server = EmulatedServer(settings_of(arena, seed=seed), [robot.body for robot in arena.robots.values()])
        self.receiver = NatNetReceiver("wire", version.parse(arena.mocap.version), bool(arena.mocap.multicast_group))
        self.pipeline = Pipeline(arena, 1)
        self._agents = agents
        self._keys = Keys(arena.arena.name)
        self._bodies = {name: robot.body for name, robot in arena.robots.items()}
        self._clocks = {name: VirtualClock() for name in agents}
        self._now_ns = 0
        self._wheels: dict[str, Wheels] = {}
        self._hung: set[str] = set()
        self._states: dict[str, str] = {}
        for name, agent in agents.items():
            self._set_up(name, plants[name], arena.platform.wheel_radius_m)
            self._wheels[name] = self._open(name, agent, 0)
        self.begin_ns = self._shake_hands()

    def free_ns(self, name: str) -> int:
        return self._clocks[name].now_ns

    def advance(self, now_ns: int) -> None:
        """A robot hears its motors when they have said something; that they are silent, it notices in its own turns."""
        if now_ns <= self._now_ns:
            return
        self._now_ns = now_ns
        robots, wheels, hung = self.emulated.robots, self._wheels, self._hung
        for name, clock in self._clocks.items():
            if clock.now_ns > now_ns:
                continue
            clock.now_ns = now_ns
            robot = robots[name]
            robot.advance(now_ns)
            if robot.deliver() and name not in hung:
                wheels[name].listen(self._own_ns(name, now_ns))
                robot.roll()

    def pose(self, name: str) -> Pose:
        return Pose(*self.emulated.pose(name))

    def places(self) -> dict[str, tuple[float, float]]:
        return {name: self.emulated.pose(name)[:2] for name in self._agents}

    def place(self, name: str, pose: Pose) -> None:
        self.emulated.robots[name].body.place(*pose)

    def frame(self, now_ns: int, seen: Mapping[str, Pose]) -> bytes | None:
        published = None
        truth = [BodyState(self._bodies[name], *pose) for name, pose in seen.items()]
        for datagram in self.server.stream(now_ns, truth):
            arrival_ns = now_ns + DATAGRAM_NS
            frame = self.receiver.receive(self.damage_datagram(datagram.data), arrival_ns)
            if frame is not None:
                published = encode(self.pipeline.frame(frame, arrival_ns))
        self._converse(now_ns + DATAGRAM_NS)
        return None if published is None else self.damage_message(published)

    def pack(self, key: str, message: Message) -> bytes:
        return self.damage_message(encode(message))

    def deliver(self, name: str, key: str, parcel: bytes, now_ns: int) -> bool:
        try:
            message = read(self._keys, key, parcel)
        except WireError as error:
            self._agents[name].refuse(f"refused_{error.kind}")
            return False
        return self._agents[name].receive(message, self._own_ns(name, now_ns))

    def sense(self, name: str, now_ns: int) -> None:
        clock = self._clocks[name]
        clock.now_ns = max(clock.now_ns, now_ns)
        self._wheels[name].listen(self._own_ns(name, clock.now_ns))

    def drive(self, name: str, drive: Drive, now_ns: int) -> bool:
        wheels, clock = self._wheels[name], self._clocks[name]
        clock.now_ns = max(clock.now_ns, now_ns)
        state = self._agents[name].run_state
        if state == "disarmed":
            wheels.open(self._own_ns(name, clock.now_ns), again=self._states.get(name, state) != state)
        self._states[name] = state
        speeds = WheelSpeeds(drive.left_radps, drive.right_radps)
        wrote = wheels.drive(drive.enable, speeds, self._own_ns(name, clock.now_ns))
        wheels.ask(self._own_ns(name, clock.now_ns))
        wheels.listen(self._own_ns(name, clock.now_ns))
        self.emulated.robots[name].roll()
        return wrote

    def hang(self, name: str, on: bool) -> None:
        (self._hung.add if on else self._hung.discard)(name)

    def replace(self, name: str, now_ns: int) -> None:
        self._clocks[name].now_ns = max(self._clocks[name].now_ns, now_ns)
        self._wheels[name] = self._open(name, self._agents[name], self._own_ns(name, now_ns))

    def counters(self) -> dict[str, Counter[str]]:
        """What every hop refused: ``udp``, ``message`` and each robot's wheel line, both ends."""
        udp = Counter(dict(self.receiver.status().counters))
        for track in self.pipeline.checker.tracks:
            udp += Counter({f"pose_{reason}": count for reason, count in track.faults.items()})
        message: Counter[str] = Counter()
        for agent in self._agents.values():
            message += Counter({name: n for name, n in agent.counters.items() if name.startswith("refused_")})
        hops = {"udp": udp, "message": message}
        for name, wheels in self._wheels.items():
            robot = self.emulated.robots[name]
            hops[name] = Counter(dict(wheels.driver.counters)) + robot.controller.counters
        return hops

    def _own_ns(self, name: str, now_ns: int) -> int:
        return now_ns + self._skew_ns.get(name, 0)

    def _open(self, name: str, agent: Agent, now_ns: int) -> Wheels:
        wheels = Wheels(open_robot(self._arena, name, port=self.emulated.wire(name, self._clocks[name])), agent)
        wheels.open(now_ns)
        return wheels

    def _set_up(self, name: str, plant: Plant, wheel_radius_m: float) -> None:
        robot = self.emulated.robots[name]
        robot.body.place(*plant.pose)
        for wheel in robot.wheels:
            acceleration = plant.brake.deceleration_mps2 / wheel_radius_m
            wheel.limits = wheel.limits._replace(lag_s=plant.brake.lag_s, acceleration_radps2=acceleration)
            wheel.acceleration_radps2 = acceleration

    def _shake_hands(self) -> int:
        """Connect client and server; when that, and opening the wheels, is done."""
        for now_ns in range(0, HANDSHAKE_NS, TURN_NS):
            self._converse(now_ns)
        return max(HANDSHAKE_NS, *(clock.now_ns for clock in self._clocks.values()))

    def _converse(self, now_ns: int) -> None:
        """Whatever client and server have to tell each other apart from frames."""
        for question in self.receiver.outbox(now_ns):
            for answer in self.server.receive(question, CLIENT, now_ns + DATAGRAM_NS):
                self.receiver.receive(self.damage_datagram(answer.data), now_ns + 2 * DATAGRAM_NS)
