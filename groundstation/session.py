"""One mission as the station runs it: wait, arm, start, watch, end. Pure.

Phases: ``waiting`` until every robot has reported, agrees on schema and arena file, is seen by the
motion capture, and the swarm is one piece; ``ready``; ``armed``; ``running``; then ``completed``,
``stopped`` (latched, somebody asked for it) or ``failed`` (a fault, or no time left).

The orders are the heartbeat's; a robot obeys each ``order_id`` once, so every change of mind is a
new id. Whatever ends a mission, the heartbeat goes on: it is what keeps a STOP repeated.
"""

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

from msgspec.structs import replace

from contract.arena import Arena, digest
from contract.messages import (
    SCHEMA_VERSION,
    TOOK_OVER,
    Message,
    MocapFrame,
    MocapHealth,
    NeighbourState,
    Order,
    OrderRequest,
    Request,
    RobotReport,
    RunStatus,
    StationHeartbeat,
    StopRequest,
    TargetCloud,
)
from groundstation.connectivity import components, disk_graph, summary
from groundstation.failsafes import Facts, differs, refusals, stops, warnings
from groundstation.preflight import Fleet, unfit

QUORUM_PATIENCE_NS = 5_000_000_000
"""A quorum waits this long for the rest."""
ARM_TIMEOUT_NS = 5_000_000_000
HOME_TIMEOUT_NS = 180_000_000_000
MISPLACED_M = 0.10
"""Farther from its start than this, a robot is said to be elsewhere."""

Phase = Literal["waiting", "ready", "armed", "running", "homing", "completed", "stopped", "failed"]
ENDED: frozenset[Phase] = frozenset({"completed", "stopped", "failed"})


def next_mission(name: str) -> str:
    """A mission's name for its next run: lab, lab.2, lab.3."""
    stem, dot, number = name.rpartition(".")
    again = bool(dot) and number.isdecimal() and number.isascii()
    return f"{(stem if again else name)[:56]}.{int(number) + 1 if again else 2}"


def misplaced(arena: Arena, places: Mapping[str, tuple[float, float]]) -> list[str]:
    """Where each robot seen away from its start belongs, in words."""
    words = []
    for name, robot in arena.robots.items():
        place = places.get(name)
        if place is not None and (away_m := math.dist(place, robot.start)) > MISPLACED_M:
            words.append(f"{name} belongs at x {robot.start[0]:.2f}, y {robot.start[1]:.2f}, {away_m:.2f} m away")
    return words


class Plan(NamedTuple):
    """What one session is to do by itself."""

    automatic: bool = False
    """Arm and start as soon as everything is ready."""
    timeout_s: float = math.inf
    """Of the mission, from start."""
    ready_timeout_s: float = math.inf
    """For the robots to become ready."""
    quorum: int = 0
    """Robots that suffice to start once the others have had their time; 0: all are needed."""
    overrides: tuple[str, ...] = ()
    """Checks (:data:`groundstation.failsafes.OVERRIDABLE`) that do not refuse the start."""


class Session:
    """The station's mind. Feed it what arrives and the time; it answers with what to publish."""

    def __init__(self, arena: Arena, cloud: TargetCloud, boot: int, plan: Plan, now_ns: int) -> None:
        self.phase: Phase = "waiting"
        self.detail = ""
        self.reports: dict[str, RobotReport] = {}
        self.min_lambda2 = math.inf
        self.split_frames = 0
        self._arena = arena
        self.cloud = cloud
        self._addressees: tuple[str, ...] = ()
        self._boot = boot
        self._plan = plan
        self._hash = digest(arena)
        self._heard_ns: dict[str, int] = {}
        self._occupied: list[int] = []
        self._order: Order = "disarm"
        self._order_id = 1
        self._ordered_ns = now_ns
        self._began_ns = now_ns
        self._started_ns = 0
        self._ended_ns = 0
        self._ending = ""
        self._seq = 0
        self._requests: set[int] = set()
        self._missions: dict[str, str] = {}
        """Robot -> the mission whose targets it knows."""
        self._crew = tuple(arena.robots)
        self.excluded: frozenset[str] = frozenset()
        """Taken out of the network by the operator: they stand still, and nobody waits for them."""
        self._joining = ""
        """A late robot that is being armed while the others run."""
        self._boots: dict[str, int] = {}
        self._frame_ns = 0
        self.disk_free_mb: float | None = None
        """Where the recording is written, as somebody last saw it."""
        self._places: dict[str, tuple[float, float]] = {}
        self._health: MocapHealth | None = None
        self._points: list[tuple[float, float]] = []
        self._seen: set[str] = set()
        self._lambda2, self._components = 0.0, 0

    # --- in ---------------------------------------------------------------------------------------

    def receive(self, message: Message, now_ns: int) -> None:
        """Any message of the site."""
        if isinstance(message, RobotReport):
            self.reports[message.robot] = message
            self._heard_ns[message.robot] = now_ns
        elif isinstance(message, NeighbourState):
            self._missions[message.robot] = message.mission
            if message.mission == self.cloud.mission:
                self._note_occupied(message.occupied)
        elif isinstance(message, MocapFrame):
            self._frame_ns = now_ns
            self._look(message)
        elif isinstance(message, MocapHealth):
            self._health = message
        elif isinstance(message, StopRequest):
            self._end("stopped", f"stop requested by {message.source}", "stop", now_ns)
        elif isinstance(message, OrderRequest) and message.number not in self._requests:
            self._requests.add(message.number)
            self.order(message.order, now_ns, message.robots)
        elif isinstance(message, TargetCloud):
            self.seed(message)

    def seed(self, cloud: TargetCloud) -> None:
        """Take an operator's targets, before the swarm is armed and not after."""
        if self.phase in ("waiting", "ready") and self._order == "disarm":
            if cloud != self.cloud:
                self.cloud = cloud
                self._occupied.clear()
                self._started_ns = 0
                self.phase, self.detail = "waiting", "new targets"
        elif cloud != self.cloud:
            self.detail = f"new targets refused while {self.phase}"

    def go_on(self, cloud: TargetCloud, started_ns: int) -> None:
        """Take over the mission of the session before this one; the robots say what is occupied.

        :param started_ns: site time of its start; 0: it was not under way.
        """
        self.cloud, self._started_ns = cloud, started_ns

    @property
    def started_ns(self) -> int:
        """Site time of the start; 0 before it."""
        return self._started_ns

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
        self._joining = ""
        if order == "disarm" or (order == "arm" and self.phase == "ready"):
            self._addressees = robots
        if order == "stop":
            self._end("stopped", "stop ordered", "stop", now_ns)
        elif order == "disarm":
            self._give("disarm", now_ns)
            self._wait("disarmed by order")
        elif order == "repeat" and self._order == "disarm":
            self.cloud = replace(self.cloud, mission=next_mission(self.cloud.mission))
            self._wait("the same targets again")
        elif order == "home" and self._order == "disarm":
            if lacking := self.lacking(now_ns, connected=False):
                self.detail = f"home refused: {'; '.join(lacking)}"[:400]
                return
            self._wait("arming")
            self.phase = "homing"
            self._give("arm", now_ns)
        elif order == "arm" and self.phase == "ready":
            self._give("arm", now_ns)
        elif order == "run" and self.phase in ("armed", "running"):
            self._start(now_ns)
        elif order == "hold" and self.phase == "running":
            self._give("hold", now_ns)
        else:
            why = f": {self._ending}" if self.phase in ENDED else ""
            self.detail = f"{order} refused while {self.phase}{why}"[:400]

    def _redraw(self, order: Literal["exclude", "readmit"], robots: tuple[str, ...]) -> None:
        named = frozenset(robots) & frozenset(self._arena.robots)
        if order == "exclude":
            if not named or named | self.excluded >= frozenset(self._arena.robots):
                self.detail = "exclude refused: name robots of the arena, not all of them"
                return
            self.excluded |= named
            self._crew = tuple(name for name in self._crew if name not in named)
            self._joining = "" if self._joining in named else self._joining
            self.detail = f"without {', '.join(sorted(self.excluded))}; {self._left_behind()}"[:400]
            return
        self.excluded -= named
        back = {r.robot for r in self.reports.values() if r.robot in named and r.run in ("armed", "running", "holding")}
        crew = set(self._crew) | (named if self.phase != "running" else back)
        self._crew = tuple(name for name in self._arena.robots if name in crew)
        self.detail = f"back in the network: {', '.join(sorted(named)) or 'nobody'}"

    def _left_behind(self) -> str:
        """The pieces of the swarm that remain where they are last seen, in words."""
        radius_m = self._arena.control.sensing_radius_m
        names = [name for name in self._crew if name in self._places]
        pieces = components(len(names), disk_graph([self._places[name] for name in names], radius_m))
        if len(pieces) < 2:
            return "the others are one piece"
        return "they part into " + " and ".join(", ".join(names[k] for k in piece) for piece in pieces)

    # --- time -------------------------------------------------------------------------------------

    def advance(self, now_ns: int) -> None:
        """Move on where the facts allow it. Call at 20 Hz or so."""
        if self.phase in ENDED:
            return
        left_out = [r.robot for r in self.reports.values() if self._addressees and r.robot not in self._addressees]
        powered = [name for name in left_out if self.reports[name].run in ("armed", "running", "holding")]
        if powered:
            self._end("stopped", f"{', '.join(powered)} not released, but with power on", "stop", now_ns)
            return
        faulty = [r for r in self.reports.values() if r.run == "fault" and r.robot not in self.excluded]
        if faulty and self.phase != "waiting":
            self._end("failed", "; ".join(f"{r.robot}: {r.reason}" for r in faulty)[:400], "stop", now_ns)
            return
        stopped = [r.robot for r in self.reports.values() if r.run == "stopped" and r.robot not in self.excluded]
        if stopped and self.phase in ("armed", "running", "homing"):
            reason = self.reports[stopped[0]].reason
            self._end("stopped", f"{', '.join(stopped)} stopped: {reason}"[:400], "stop", now_ns)
            return
        if self.phase not in ("waiting", "ready") and (words := stops(self.facts(now_ns))):
            self._end("failed", words[:400], "stop", now_ns)
            return
        if self.phase in ("waiting", "ready"):
            self._prepare(now_ns)
        elif self.phase == "armed":
            if self._plan.automatic:
                self._start(now_ns)
        elif self.phase == "running":
            self._judge(now_ns)
        elif self.phase == "homing":
            self._bring_home(now_ns)

    def _wait(self, detail: str) -> None:
        """From the beginning, targets and mission aside; nothing more by itself."""
        self.phase, self.detail = "waiting", detail
        self._occupied.clear()
        self._started_ns = self._ended_ns = 0
        self._plan = self._plan._replace(automatic=False)

    def _bring_home(self, now_ns: int) -> None:
        waited_ns = now_ns - self._ordered_ns
        if self._order == "arm":
            waiting = [name for name in self._crew if self.reports[name].run != "armed"]
            if not waiting:
                self._give("run", now_ns)
            elif waited_ns > ARM_TIMEOUT_NS:
                self._end("failed", f"not armed: {self._words_of(waiting)}"[:400], "disarm", now_ns)
            return
        away = [name for name in self._crew if self.reports[name].task != "home"]
        self.detail = f"on the way: {', '.join(away)}" if away else "all robots at home"
        if not away:
            self._give("disarm", now_ns)
            self._wait("all robots at home")
        elif waited_ns > HOME_TIMEOUT_NS:
            self._end("failed", f"not home: {'; '.join(self.misplaced()) or ', '.join(away)}"[:400], "disarm", now_ns)

    def _words_of(self, names: list[str]) -> str:
        return "; ".join(f"{name}: {self.reports[name].reason or self.reports[name].run}" for name in names)

    def misplaced(self) -> list[str]:
        """Where each robot that motion capture sees away from its start belongs, in words."""
        return misplaced(self._arena, self._places)

    def facts(self, now_ns: int) -> Facts:
        """What the station's failsafes look at."""
        return Facts(
            now_ns=now_ns,
            arena=self._arena,
            arena_hash=self._hash,
            crew=self._crew,
            reports=self.reports,
            heard_ns=self._heard_ns,
            boots=self._boots,
            seen=len(self._points),
            frame_ns=self._frame_ns,
            components=self._components,
            disk_free_mb=self.disk_free_mb,
        )

    @property
    def missing(self) -> tuple[str, ...]:
        """Robots of the arena that this mission does without."""
        return tuple(name for name in self._arena.robots if name not in self._crew)

    def _muster(self, now_ns: int) -> None:
        """Who takes part: all, or a quorum once the others have had their time."""
        self._crew = tuple(name for name in self._arena.robots if name not in self.excluded)
        if 0 < self._plan.quorum < len(self._crew) and now_ns - self._began_ns > QUORUM_PATIENCE_NS:
            fit = tuple(name for name in self._crew if not self._lack_of(name, now_ns))
            if len(fit) >= self._plan.quorum:
                self._crew = fit

    def _admit(self, now_ns: int) -> None:
        """Arm one late robot while the others run on, then order all to run."""
        if self._joining:
            report = self.reports[self._joining]
            armed = report.run == "armed"
            if armed or now_ns - self._ordered_ns > ARM_TIMEOUT_NS:
                if armed:
                    self._crew = (*self._crew, self._joining)
                    self._boots[self._joining] = report.boot
                self._joining = ""
                self._give("run", now_ns)
            return
        missing = (name for name in self.missing if name in self.reports and name not in self.excluded)
        late = [name for name in missing if not self._lack_of(name, now_ns)]
        if late and self._order == "run" and not self._addressees:
            self._joining = late[0]
            self._give("arm", now_ns)

    def _prepare(self, now_ns: int) -> None:
        if self._order == "disarm":
            self._muster(now_ns)
        lacking = self.lacking(now_ns)
        if lacking:
            self.phase, self.detail = "waiting", "; ".join(lacking)[:400]
            if now_ns - self._began_ns > self._plan.ready_timeout_s * 1e9:
                self._end("failed", f"not ready in {self._plan.ready_timeout_s:g} s: {self.detail}", "disarm", now_ns)
            return
        if self.phase == "waiting":
            words = f"ready without {', '.join(self.missing)}" if self.missing else "all robots ready"
            taken_on = f"; overridden: {', '.join(self._plan.overrides)}" if self._plan.overrides else ""
            self.phase, self.detail = "ready", f"{words}; arm to go on{taken_on}"
            if self._plan.automatic:
                self._give("arm", now_ns)
        if self._order != "arm":
            return
        waiting = [name for name in self._crew if self.reports[name].run != "armed"]
        if not waiting:
            words = f"armed without {', '.join(self.missing)}" if self.missing else "all robots armed"
            self.phase, self.detail = "armed", f"{words}; run to start"
        elif now_ns - self._ordered_ns > ARM_TIMEOUT_NS:
            self._end("failed", f"not armed: {self._words_of(waiting)}"[:400], "disarm", now_ns)

    def lacking(self, now_ns: int, connected: bool = True) -> list[str]:
        """What still stands between this arena and an armed swarm, in words; ``connected``: also to a mission."""
        missing = [words for name in self._crew if (words := self._lack_of(name, now_ns))]
        said = {"robot_differs", "robot_silent", "swarm_split"}
        missing += refusals(self.facts(now_ns), said, self._plan.overrides)
        if not missing:
            places = {name: self._places[name] for name in self._seen}
            fleet = Fleet(self.facts(now_ns), places, self._health, now_ns)
            missing += unfit(fleet, self._crew, self._plan.overrides)
        if not missing and not set(self._crew) <= self._seen:
            missing.append(f"motion capture sees {len(self._points)} of {len(self._crew)} robots")
        if not connected:
            return missing
        mission = self.cloud.mission
        late = [name for name in self._crew if self._missions.get(name, mission) != mission]
        if not missing and late:
            missing.append(f"{', '.join(late)}: targets of {mission} not there yet")
        if not missing and self._components > 1 and "swarm_split" not in self._plan.overrides:
            radius = self._arena.control.sensing_radius_m
            missing.append(f"the swarm is in {self._components} pieces; place robots within {radius:g} m of others")
            missing += self.misplaced()
        return missing

    def _lack_of(self, name: str, now_ns: int) -> str:
        """Why one robot is not fit to be armed, in words; empty: it is."""
        report = self.reports.get(name)
        silence_ns = self._arena.safety.report_silence_s * 1e9
        if report is None or now_ns - self._heard_ns[name] > silence_ns:
            return f"{name} does not report"
        if words := differs(report, self._hash):
            return words
        if not report.pose_valid:
            return f"{name} has no valid pose"
        if (self._order == "disarm" or self._addressees or name not in self._crew) and report.run != "disarmed":
            return f"{name} is {report.run}; release it (disarm)"
        if report.run == "disarmed" and report.reason not in ("", TOOK_OVER) and self._order != "arm":
            return f"{name}: {report.reason}"
        return ""

    def _judge(self, now_ns: int) -> None:
        total = len(self.cloud.targets)
        without = f"without {', '.join(self.missing)}" if self.missing else ""
        self.detail = "; ".join(filter(None, (without, warnings(self.facts(now_ns)))))[:400]
        self._admit(now_ns)
        if len(self._occupied) == total:
            self._end("completed", f"all {total} targets occupied", "disarm", now_ns)
        elif now_ns - self._started_ns > self._plan.timeout_s * 1e9:
            left = total - len(self._occupied)
            text = f"{left} of {total} targets left after {self._plan.timeout_s:g} s"
            self._end("failed", text, "stop", now_ns)

    def _start(self, now_ns: int) -> None:
        self._give("run", now_ns)
        self.phase, self.detail = "running", ""
        self._started_ns = self._started_ns or now_ns

    def _end(self, phase: Phase, detail: str, order: Order, now_ns: int) -> None:
        if self.phase in ENDED and order != "stop":
            return
        if self.phase not in ENDED:
            self._ended_ns = now_ns
        if self.phase not in ("stopped", "failed"):
            self.phase, self.detail, self._ending = phase, detail, detail
        if self._order != order:
            self._give(order, now_ns)

    def _give(self, order: Order, now_ns: int) -> None:
        if order == "disarm":
            self._boots.clear()
        elif order == "arm" and not self._joining:
            self._boots = {name: report.boot for name, report in self.reports.items() if name in self._crew}
        self._order, self._ordered_ns = order, now_ns
        self._order_id += 1

    # --- out --------------------------------------------------------------------------------------

    @property
    def overrides(self) -> tuple[str, ...]:
        """Checks that the operator has taken on."""
        return self._plan.overrides

    @property
    def at_rest(self) -> bool:
        """Every robot has reported itself stopped."""
        return all(report.stopped for report in self.reports.values())

    @property
    def occupied(self) -> tuple[int, ...]:
        return tuple(self._occupied)

    def elapsed_s(self, now_ns: int) -> float:
        """Of the mission so far, or until it ended."""
        return ((self._ended_ns or now_ns) - self._started_ns) / 1e9 if self._started_ns else 0.0

    def heartbeat(self, now_ns: int) -> StationHeartbeat:
        self._seq += 1
        return StationHeartbeat(
            schema_version=SCHEMA_VERSION,
            boot=self._boot,
            seq=self._seq,
            stamp_ns=now_ns,
            order=self._order,
            order_id=self._order_id,
            robots=() if self._order == "stop" else (self._joining,) if self._joining else self._addressees,
            home=self.phase == "homing" and self._order == "run",
            excluded=tuple(sorted(self.excluded)),
            mission=self.cloud.mission,
            arena_hash=self._hash,
        )

    def status(self, now_ns: int) -> RunStatus:
        return RunStatus(
            stamp_ns=now_ns,
            mission=self.cloud.mission,
            phase=self.phase,
            detail=self.detail,
            elapsed_s=round(self.elapsed_s(now_ns), 3),
            targets=len(self.cloud.targets),
            occupied=self.occupied,
            lambda2=round(self._lambda2, 6),
            components=self._components,
            min_distance_m=round(self._nearest(), 5),
            excluded=tuple(sorted(self.excluded)),
        )

    # --- looking ----------------------------------------------------------------------------------

    def _note_occupied(self, bitmap: str) -> None:
        try:
            bits = int(bitmap or "0", 16)
        except ValueError:
            return
        for index in (target.index for target in self.cloud.targets):
            if bits >> index & 1 and index not in self._occupied:
                self._occupied.append(index)

    def _look(self, frame: MocapFrame) -> None:
        seen = {b.robot: (b.x_m, b.y_m) for b in frame.bodies if b.valid and b.robot in self._arena.robots}
        self._places |= seen
        self._seen = set(seen)
        self._points = [place for name, place in seen.items() if name in self._crew]
        self._lambda2, self._components = summary(self._points, self._arena.control.sensing_radius_m)
        if self.phase == "running" and len(self._points) == len(self._crew):
            self.min_lambda2 = min(self.min_lambda2, self._lambda2)
            self.split_frames += self._components > 1

    def _nearest(self) -> float:
        points = self._points
        gaps = [math.dist(a, b) for i, a in enumerate(points) for b in points[i + 1 :]]
        return min(gaps, default=0.0)
