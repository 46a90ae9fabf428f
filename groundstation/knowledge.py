"""What the station knows of its site at one moment. Pure."""

from contract.arena import Arena
from contract.messages import (
    Message,
    MocapFrame,
    MocapHealth,
    NeighbourState,
    Order,
    RobotReport,
    TargetCloud,
)
from groundstation.crew import Crew
from groundstation.failsafes import Facts
from groundstation.readiness import Readiness
from groundstation.sighting import Sighting
from groundstation.tally import Tally
from groundstation.will import Will


class Knowledge:
    """Feed it what arrives; others read it."""

    def __init__(self, arena: Arena, cloud: TargetCloud, boot: int, overrides: tuple[str, ...], now_ns: int) -> None:
        self.arena = arena
        self.overrides = overrides
        self.crew = Crew(arena)
        self.sighting = Sighting(arena)
        self.tally = Tally(cloud)
        self.will = Will(arena, boot, now_ns)
        self.reports: dict[str, RobotReport] = {}
        self.disk_free_mb: float | None = None
        """Where the recording is written, as somebody last saw it."""
        self._heard_ns: dict[str, int] = {}
        self._boots: dict[str, int] = {}
        """Of each robot of the crew when it was armed."""
        self._health: MocapHealth | None = None

    def note(self, message: Message, now_ns: int) -> None:
        """Any message of the site; those that are no news are passed over."""
        if isinstance(message, RobotReport):
            self.reports[message.robot] = message
            self._heard_ns[message.robot] = now_ns
        elif isinstance(message, NeighbourState):
            self.tally.hear(message)
        elif isinstance(message, MocapFrame):
            self.sighting.look(message, self.crew.names, now_ns)
        elif isinstance(message, MocapHealth):
            self._health = message

    def give(self, order: Order, now_ns: int) -> None:
        """A new order; with the order to arm, robots' boots are remembered."""
        if order == "disarm":
            self._boots.clear()
        elif order == "arm" and not self.crew.joining:
            self._boots = {name: report.boot for name, report in self.reports.items() if name in self.crew.names}
        self.will.give(order, now_ns)

    def join(self) -> None:
        """The late robot that is armed now is one of the crew."""
        name = self.crew.joining
        self.crew.join()
        self._boots[name] = self.reports[name].boot

    def unarmed(self) -> list[str]:
        """Robots of the crew that are not armed."""
        return [name for name in self.crew.names if self.reports[name].run != "armed"]

    def found(self, run: str) -> list[RobotReport]:
        """Reports of robots in a run state, of those that belong to the network."""
        return [r for r in self.reports.values() if r.run == run and r.robot not in self.crew.excluded]

    def facts(self, now_ns: int) -> Facts:
        """What the station's failsafes look at."""
        return Facts(
            now_ns=now_ns,
            arena=self.arena,
            arena_hash=self.will.arena_hash,
            crew=self.crew.names,
            reports=self.reports,
            heard_ns=self._heard_ns,
            boots=self._boots,
            seen=len(self.sighting.points),
            frame_ns=self.sighting.frame_ns,
            components=self.sighting.components,
            disk_free_mb=self.disk_free_mb,
        )

    def readiness(self, now_ns: int) -> Readiness:
        """What is to be looked at before wheels get power."""
        order, overrides = self.will.order, self.overrides
        return Readiness(self.facts(now_ns), self.crew, self.sighting, self._health, order, overrides)

    def lacking(self, now_ns: int, connected: bool = True) -> list[str]:
        """What still stands between this arena and an armed swarm, in words; ``connected``: also to a mission."""
        readiness = self.readiness(now_ns)
        return readiness.lacking() or (readiness.apart(self.tally) if connected else [])
