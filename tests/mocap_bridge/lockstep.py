"""Server, network, receiver and pipeline in virtual time: one call, one story, bit-identical reruns."""

import math
from collections.abc import Callable, Iterable

import msgspec

from contract import arena as arenas
from contract.messages import MocapFrame, MocapHealth
from mocap_bridge.mock import script
from mocap_bridge.mock.bodies import BodyState, settings_of
from mocap_bridge.mock.server import EmulatedServer, Outgoing
from mocap_bridge.natnet import version
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.sources.natnet_receiver import NatNetReceiver
from mocap_bridge.sources.tape import Entry

START_NS = 5_000_000_000
TICK_NS = 1_000_000
WAY_NS = 100_000
CLIENT = ("10.0.0.2", 40000)
STARTS = {"r06": (1.0, 1.0), "r08": (2.0, 1.0), "r09": (3.0, 3.0)}

Poses = Callable[[float], Iterable[BodyState]]


def arena(starts: dict[str, tuple[float, float]] = STARTS, **mocap: object) -> arenas.Arena:
    robots = {name: {"body": name, "start": list(at), "wheels": {"kind": "odrive"}} for name, at in starts.items()}
    return arenas.parse(
        {"arena": {"name": "lab", "size_m": [4.0, 5.0]}, "mocap": mocap, "robots": robots}, "test arena"
    )


def circling(starts: dict[str, tuple[float, float]] = STARTS, radius_m: float = 0.2, speed_mps: float = 0.3) -> Poses:
    def poses(elapsed_s: float) -> list[BodyState]:
        angle = speed_mps / radius_m * elapsed_s
        heading = math.remainder(angle + math.pi / 2, math.tau)
        dx, dy = radius_m * (math.cos(angle) - 1.0), radius_m * math.sin(angle)
        return [BodyState(name, x + dx, y + dy, heading) for name, (x, y) in starts.items()]

    return poses


class Story:
    """One run: every frame and health message published, with the virtual time of each."""

    def __init__(
        self,
        faults: str = "",
        site: arenas.Arena | None = None,
        poses: Poses | None = None,
        server_version: str | None = None,
        seed: int = 1,
    ) -> None:
        self.arena = site or arena()
        mocap = self.arena.mocap
        settings = settings_of(self.arena, script.parse(faults), seed)
        if server_version:
            settings = settings._replace(mocap=msgspec.structs.replace(mocap, version=server_version))
        self.server = EmulatedServer(settings, [robot.body for robot in self.arena.robots.values()])
        self.receiver = NatNetReceiver("test", version.parse(mocap.version), bool(mocap.multicast_group))
        self.pipeline = Pipeline(self.arena, 1000)
        self.poses = poses or circling({name: robot.start for name, robot in self.arena.robots.items()})
        self.frames: list[MocapFrame] = []
        self.health: list[MocapHealth] = []
        self.source_frames: list[SourceFrame] = []
        self.tape: list[Entry] = []
        self.now_ns = START_NS
        self._streaming_since_ns: int | None = None

    @property
    def elapsed_s(self) -> float:
        """Script time: since the first frame."""
        return self.server.elapsed_s(self.now_ns)

    def until(self, elapsed_s: float) -> "Story":
        """Run to that script time; the handshake comes before it."""
        while self._streaming_since_ns is None or self.elapsed_s < elapsed_s:
            self._step()
        return self

    def _step(self) -> None:
        now_ns = self.now_ns
        for datagram in self.receiver.outbox(now_ns):
            self.tape.append(Entry("sent", now_ns, datagram))
            self._deliver(self.server.receive(datagram, CLIENT, now_ns + WAY_NS), now_ns + 2 * WAY_NS)
        if self._streaming_since_ns is None and self.receiver.client.state == "streaming":
            self._streaming_since_ns = now_ns
        if self._streaming_since_ns is not None and now_ns >= self.server.next_due_ns:
            elapsed_s = self.server.elapsed_s(now_ns)
            self._deliver(self.server.stream(now_ns, self.poses(elapsed_s)), now_ns + WAY_NS)
        if (now_ns - START_NS) % 50_000_000 == 0:
            self.health.append(self.pipeline.report(self.receiver.status(), now_ns))
        self.now_ns += TICK_NS

    def _deliver(self, datagrams: list[Outgoing], now_ns: int) -> None:
        for datagram in datagrams:
            self.tape.append(Entry("received", now_ns, datagram.data))
            frame = self.receiver.receive(datagram.data, now_ns)
            if frame is not None:
                self.source_frames.append(frame)
                self.frames.append(self.pipeline.frame(frame, now_ns + 50_000))

    def reasons(self, robot: str) -> list[str]:
        """Distinct reasons of a robot's body, in order of appearance ('' for valid)."""
        out: list[str] = []
        for frame in self.frames:
            for body in frame.bodies:
                if body.robot == robot and (not out or out[-1] != body.reason):
                    out.append(body.reason)
        return out

    def script_s(self, frame: MocapFrame) -> float:
        """Script time of a frame's exposure."""
        return self.server.elapsed_s(frame.exposure_ns)
