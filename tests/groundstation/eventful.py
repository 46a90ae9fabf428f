"""Lockstep missions in which robots come late, crash, reboot, are carried off, lost from sight, taken out. Pure."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from groundstation.hops import ShortCut
from groundstation.lockstep import ARM_NS, RUN_NS, SUBSTEP_NS, World
from onboard.agent import Agent
from onboard.odometry import Pose

Befalls = Literal["late", "crash", "reboot", "occlude", "carry", "exclude"]


class Event(NamedTuple):
    """One thing that happens to one robot, ``at_s`` after the start of the mission.

    ``late``: its process starts only now; it stands there before. ``crash``: its process ends, and the motors'
    watchdog lets go. ``reboot``: it comes back without memory; the station arms and starts it again. ``occlude``:
    motion capture loses it for ``seconds``. ``carry``: a hand moves it to ``to`` within ``seconds``. ``exclude``: the
    operator takes it out of the network.
    """

    at_s: float
    what: Befalls
    robot: str
    seconds: float = 0.0
    to: tuple[float, float] = (0.0, 0.0)


@dataclass
class EventfulWorld(World):
    """A mission with a script. Not over real bytes: there a process's end is more than silence."""

    script: tuple[Event, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.hops, ShortCut):
            raise ValueError("a script needs a mission that is not wired")
        self._handlers["event"] = self._on_event
        for event in self.script:
            self._at(self._begin_ns + RUN_NS + round(event.at_s * 1e9), "event", "", event)
            if event.what == "late":
                self.hang(event.robot)

    def _on_event(self, _: str, event: Any) -> None:
        name = event.robot
        match event.what:
            case "late":
                self._start(name)
            case "crash":
                self.hang(name)
            case "reboot":
                self.hang(name)
                self._start(name)
            case "occlude":
                self.hidden.add(name)
                self._at(self.now_ns + round(event.seconds * 1e9), "event", "", event._replace(what="seen"))
            case "seen":
                self.hidden.discard(name)
            case "carry":
                self._carry(event)
            case "exclude":
                self.excluded.add(name)

    def _start(self, name: str) -> None:
        """A new process for the robot: it knows nothing, hears the cloud, and is armed and started."""
        boot = self.agents[name].boot + 1
        self.agents[name] = Agent(self.arena, name, boot)
        self.hang(name, False)
        self.whisper(name, self.keys.targets, self.cloud)
        self.orders += [(self.now_ns + ARM_NS, "arm", (name,)), (self.now_ns + RUN_NS, "run", (name,))]

    def _carry(self, event: Event) -> None:
        """One substep of the way; what the wheels do meanwhile, they do in the air."""
        x, y, heading = self.hops.pose(event.robot)
        left = max(1, round(event.seconds * 1e9 / SUBSTEP_NS))
        to_x, to_y = event.to
        self.hops.place(event.robot, Pose(x + (to_x - x) / left, y + (to_y - y) / left, heading))
        if left > 1:
            after = event._replace(seconds=event.seconds - SUBSTEP_NS * 1e-9)
            self._at(self.now_ns + SUBSTEP_NS, "event", "", after)
