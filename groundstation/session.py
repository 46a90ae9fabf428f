"""The station's mind: what arrives and what operators order goes in, heartbeats and status come out. Pure.

The orders are the heartbeat's; a robot obeys each ``order_id`` once, so every change of mind is a
new id. Whatever ends a mission, the heartbeat goes on: it is what keeps a STOP repeated.
"""

from collections.abc import Mapping
from typing import Literal

from contract.arena import Arena
from contract.messages import (
    Message,
    OrderRequest,
    Request,
    RobotReport,
    RunStatus,
    StationHeartbeat,
    StopRequest,
    TargetCloud,
)
from groundstation.course import ENDED, Course, Phase, Plan
from groundstation.failsafes import Facts
from groundstation.knowledge import Knowledge
from groundstation.sighting import misplaced


class Session:
    """Feed it what arrives and the time; it answers with what to publish."""

    def __init__(self, arena: Arena, cloud: TargetCloud, boot: int, plan: Plan, now_ns: int) -> None:
        self._known = Knowledge(arena, cloud, boot, plan.overrides, now_ns)
        self._course = Course(self._known, plan, now_ns)
        self._requests: set[int] = set()

    # --- in ---------------------------------------------------------------------------------------

    def receive(self, message: Message, now_ns: int) -> None:
        """Any message of the site."""
        if isinstance(message, StopRequest):
            self._course.end("stopped", f"stop requested by {message.source}", "stop", now_ns)
        elif isinstance(message, OrderRequest):
            if message.number not in self._requests:
                self._requests.add(message.number)
                self.order(message.order, now_ns, message.robots)
        elif isinstance(message, TargetCloud):
            self.seed(message)
        else:
            self._known.note(message, now_ns)

    def seed(self, cloud: TargetCloud) -> None:
        """Take an operator's targets, before the swarm is armed and not after."""
        course = self._course
        if cloud == self.cloud:
            return
        if course.phase in ("waiting", "ready") and self._known.will.order == "disarm":
            self._known.tally.replace(cloud)
            course.phase, course.detail = "waiting", "new targets"
        else:
            course.detail = f"new targets refused while {course.phase}"

    def go_on(self, cloud: TargetCloud, started_ns: int) -> None:
        """Take over the mission of the session before this one; the robots say what is occupied.

        :param started_ns: site time of its start; 0: it was not under way.
        """
        self._known.tally.cloud, self._known.tally.started_ns = cloud, started_ns

    def order(self, order: Request | Literal["stop"], now_ns: int, robots: tuple[str, ...] = ()) -> None:
        """An operator's order. ``disarm`` also releases a stop and makes an ended session ready anew.

        ``repeat``: the same targets as a new mission, in which none is occupied. ``home``: arm every robot, drive
        it to its start, disarm. Both only while disarmed.

        With ``robots``, it is for these alone: the others stay as they are, and one of the others that is
        found with power on its wheels is a stop for all.

        ``exclude`` and ``readmit`` change who belongs to the network, in any phase, and no other order.
        """
        if order == "exclude" or order == "readmit":
            self._redraw(order, robots)
            return
        known, course, crew = self._known, self._course, self._known.crew
        resting = known.will.order == "disarm"
        crew.joining = ""
        if order == "disarm" or (order == "arm" and course.phase == "ready"):
            crew.addressees = robots
        if order == "stop":
            course.end("stopped", "stop ordered", "stop", now_ns)
        elif order == "disarm":
            known.give("disarm", now_ns)
            course.wait("disarmed by order")
        elif order == "repeat" and resting:
            known.tally.repeat()
            course.wait("the same targets again")
        elif order == "home" and resting:
            course.set_out(now_ns)
        elif order == "arm" and course.phase == "ready":
            known.give("arm", now_ns)
        elif order == "run" and course.phase in ("armed", "running"):
            course.start(now_ns)
        elif order == "hold" and course.phase == "running":
            known.give("hold", now_ns)
        else:
            why = f": {course.ending}" if course.phase in ENDED else ""
            course.detail = f"{order} refused while {course.phase}{why}"[:400]

    def _redraw(self, order: Literal["exclude", "readmit"], robots: tuple[str, ...]) -> None:
        crew, sighting, course = self._known.crew, self._known.sighting, self._course
        if order == "readmit":
            back = crew.readmit(robots, self.reports, course.phase == "running")
            course.detail = f"back in the network: {', '.join(sorted(back)) or 'nobody'}"
        elif crew.exclude(robots):
            course.detail = f"without {', '.join(sorted(crew.excluded))}; {sighting.left_behind(crew.names)}"[:400]
        else:
            course.detail = "exclude refused: name robots of the arena, not all of them"

    def advance(self, now_ns: int) -> None:
        """Move on where the facts allow it. Call at 20 Hz or so."""
        self._course.advance(now_ns)

    @property
    def disk_free_mb(self) -> float | None:
        """Where the recording is written, as somebody last saw it."""
        return self._known.disk_free_mb

    @disk_free_mb.setter
    def disk_free_mb(self, free_mb: float | None) -> None:
        self._known.disk_free_mb = free_mb

    # --- out --------------------------------------------------------------------------------------

    @property
    def phase(self) -> Phase:
        return self._course.phase

    @property
    def detail(self) -> str:
        """What is being waited for, or why it ended."""
        return self._course.detail

    @property
    def reports(self) -> Mapping[str, RobotReport]:
        """Every robot's newest."""
        return self._known.reports

    @property
    def cloud(self) -> TargetCloud:
        return self._known.tally.cloud

    @cloud.setter
    def cloud(self, cloud: TargetCloud) -> None:
        self._known.tally.cloud = cloud

    @property
    def started_ns(self) -> int:
        """Site time of the mission's start; 0 before it."""
        return self._known.tally.started_ns

    @property
    def occupied(self) -> tuple[int, ...]:
        """Targets in the order in which the station heard of them."""
        return self._known.tally.occupied

    @property
    def excluded(self) -> frozenset[str]:
        """Robots taken out of the network by the operator."""
        return self._known.crew.excluded

    @property
    def missing(self) -> tuple[str, ...]:
        """Robots of the arena that this mission does without."""
        return self._known.crew.missing

    @property
    def overrides(self) -> tuple[str, ...]:
        """Checks that the operator has taken on."""
        return self._known.overrides

    @property
    def at_rest(self) -> bool:
        """Every robot has reported itself stopped."""
        return all(report.stopped for report in self.reports.values())

    def lacking(self, now_ns: int, connected: bool = True) -> list[str]:
        """What still stands between this arena and an armed swarm, in words; ``connected``: also to a mission."""
        return self._known.lacking(now_ns, connected)

    def misplaced(self) -> list[str]:
        """Where each robot that motion capture sees away from its start belongs, in words."""
        return misplaced(self._known.arena, self._known.sighting.places)

    def facts(self, now_ns: int) -> Facts:
        """What the station's failsafes look at."""
        return self._known.facts(now_ns)

    def elapsed_s(self, now_ns: int) -> float:
        """Of the mission so far, or until it ended."""
        return self._known.tally.elapsed_s(now_ns)

    def heartbeat(self, now_ns: int) -> StationHeartbeat:
        """The next; due at 20 Hz."""
        home = self._course.homeward if self.phase == "homing" and self._known.will.order == "run" else None
        return self._known.will.heartbeat(
            self._known.crew, self._known.tally.cloud.mission, None if home is None else home.aside, now_ns
        )

    def status(self, now_ns: int) -> RunStatus:
        sighting = self._known.sighting
        return RunStatus(
            stamp_ns=now_ns,
            mission=self.cloud.mission,
            phase=self.phase,
            detail=self.detail,
            elapsed_s=round(self.elapsed_s(now_ns), 3),
            targets=len(self.cloud.targets),
            occupied=self.occupied,
            lambda2=round(sighting.lambda2, 6),
            components=sighting.components,
            min_distance_m=round(sighting.nearest_m, 5),
            excluded=tuple(sorted(self.excluded)),
        )
