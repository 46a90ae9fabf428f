"""One mission as the station runs it: wait, arm, start, watch, end. Pure.

Phases: ``waiting`` until every robot has reported, agrees on schema and arena file, is seen by the
motion capture, and the swarm is one piece; ``ready``; ``armed``; ``running``; then ``completed``,
``stopped`` (latched, somebody asked for it) or ``failed`` (a fault, or no time left).

The orders are the heartbeat's; a robot obeys each ``order_id`` once, so every change of mind is a
new id. Whatever ends a mission, the heartbeat goes on: it is what keeps a STOP repeated.
"""

import math
from typing import Literal, NamedTuple

from contract.arena import Arena, digest
from contract.messages import (
    SCHEMA_VERSION,
    Message,
    MocapFrame,
    NeighbourState,
    Order,
    OrderRequest,
    RobotReport,
    RunStatus,
    StationHeartbeat,
    StopRequest,
    TargetCloud,
)
from groundstation.connectivity import summary

REPORT_FRESH_NS = 1_000_000_000
ARM_TIMEOUT_NS = 5_000_000_000

Phase = Literal["waiting", "ready", "armed", "running", "completed", "stopped", "failed"]
ENDED: frozenset[Phase] = frozenset({"completed", "stopped", "failed"})


class Plan(NamedTuple):
    """What one session is to do by itself."""

    automatic: bool = False
    """Arm and start as soon as everything is ready."""
    timeout_s: float = math.inf
    """Of the mission, from start."""
    ready_timeout_s: float = math.inf
    """For the robots to become ready."""


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
        self._seq = 0
        self._requests: set[int] = set()
        self._points: list[tuple[float, float]] = []
        self._lambda2, self._components = 0.0, 0

    # --- in ---------------------------------------------------------------------------------------

    def receive(self, message: Message, now_ns: int) -> None:
        """Any message of the site."""
        if isinstance(message, RobotReport):
            self.reports[message.robot] = message
            self._heard_ns[message.robot] = now_ns
        elif isinstance(message, NeighbourState):
            self._note_occupied(message.occupied)
        elif isinstance(message, MocapFrame):
            self._look(message)
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
        elif cloud != self.cloud:
            self.detail = f"new targets refused while {self.phase}"

    def order(self, order: Order, now_ns: int, robots: tuple[str, ...] = ()) -> None:
        """An operator's order. ``disarm`` also releases a stop and makes an ended session ready anew.

        With ``robots``, it is for these alone: the others stay as they are, and one of the others that is
        found with power on its wheels is a stop for all.
        """
        if order == "disarm" or (order == "arm" and self.phase == "ready"):
            self._addressees = robots
        if order == "stop":
            self._end("stopped", "stop ordered", "stop", now_ns)
        elif order == "disarm":
            self._give("disarm", now_ns)
            self.phase, self.detail = "waiting", "disarmed by order"
            self._occupied.clear()
            self._started_ns = self._ended_ns = 0
            self._plan = self._plan._replace(automatic=False)
        elif order == "arm" and self.phase == "ready":
            self._give("arm", now_ns)
        elif order == "run" and self.phase in ("armed", "running"):
            self._start(now_ns)
        elif order == "hold" and self.phase == "running":
            self._give("hold", now_ns)
        else:
            self.detail = f"{order} refused while {self.phase}"

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
        faulty = [report for report in self.reports.values() if report.run == "fault"]
        if faulty and self.phase != "waiting":
            self._end("failed", "; ".join(f"{r.robot}: {r.reason}" for r in faulty)[:400], "stop", now_ns)
            return
        stopped = [report.robot for report in self.reports.values() if report.run == "stopped"]
        if stopped and self.phase in ("armed", "running"):
            reason = self.reports[stopped[0]].reason
            self._end("stopped", f"{', '.join(stopped)} stopped: {reason}"[:400], "stop", now_ns)
            return
        if self.phase in ("waiting", "ready"):
            self._prepare(now_ns)
        elif self.phase == "armed":
            if self._plan.automatic:
                self._start(now_ns)
        elif self.phase == "running":
            self._judge(now_ns)

    def _prepare(self, now_ns: int) -> None:
        lacking = self.lacking(now_ns)
        if lacking:
            self.phase, self.detail = "waiting", "; ".join(lacking)[:400]
            if now_ns - self._began_ns > self._plan.ready_timeout_s * 1e9:
                self._end("failed", f"not ready in {self._plan.ready_timeout_s:g} s: {self.detail}", "disarm", now_ns)
            return
        if self.phase == "waiting":
            self.phase, self.detail = "ready", "all robots ready; arm to go on"
            if self._plan.automatic:
                self._give("arm", now_ns)
        if self._order != "arm":
            return
        waiting = [name for name in self._arena.robots if self.reports[name].run != "armed"]
        if not waiting:
            self.phase, self.detail = "armed", "all robots armed; run to start"
        elif now_ns - self._ordered_ns > ARM_TIMEOUT_NS:
            reasons = "; ".join(f"{name}: {self.reports[name].reason or self.reports[name].run}" for name in waiting)
            self._end("failed", f"not armed: {reasons}"[:400], "disarm", now_ns)

    def lacking(self, now_ns: int) -> list[str]:
        """What still stands between this arena and an armed swarm, in words."""
        missing = []
        for name in self._arena.robots:
            report = self.reports.get(name)
            if report is None or now_ns - self._heard_ns[name] > REPORT_FRESH_NS:
                missing.append(f"{name} does not report")
            elif report.schema_version != SCHEMA_VERSION:
                missing.append(f"{name} speaks schema {report.schema_version}, station {SCHEMA_VERSION}")
            elif report.arena_hash != self._hash:
                missing.append(f"{name} has another arena file ({report.arena_hash}, station {self._hash})")
            elif not report.pose_valid:
                missing.append(f"{name} has no valid pose")
            elif (self._order_id == 1 or self._addressees) and report.run != "disarmed":
                missing.append(f"{name} is {report.run}; release it (disarm)")
            elif report.run == "disarmed" and report.reason and self._order != "arm":
                missing.append(f"{name}: {report.reason}")
        if not missing and len(self._points) < len(self._arena.robots):
            missing.append(f"motion capture sees {len(self._points)} of {len(self._arena.robots)} robots")
        if not missing and self._components > 1:
            radius = self._arena.control.sensing_radius_m
            missing.append(f"the swarm is in {self._components} pieces; place robots within {radius:g} m of others")
        return missing

    def _judge(self, now_ns: int) -> None:
        total = len(self.cloud.targets)
        silent = [name for name in self._arena.robots if now_ns - self._heard_ns[name] > REPORT_FRESH_NS]
        self.detail = f"silent: {', '.join(silent)}" if silent else ""
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
            self.phase, self.detail = phase, detail
        if self._order != order:
            self._give(order, now_ns)

    def _give(self, order: Order, now_ns: int) -> None:
        self._order, self._ordered_ns = order, now_ns
        self._order_id += 1

    # --- out --------------------------------------------------------------------------------------

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
            robots=self._addressees if self._order != "stop" else (),
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
        self._points = [(b.x_m, b.y_m) for b in frame.bodies if b.valid and b.robot in self._arena.robots]
        self._lambda2, self._components = summary(self._points, self._arena.control.sensing_radius_m)
        if self.phase == "running" and len(self._points) == len(self._arena.robots):
            self.min_lambda2 = min(self.min_lambda2, self._lambda2)
            self.split_frames += self._components > 1

    def _nearest(self) -> float:
        points = self._points
        gaps = [math.dist(a, b) for i, a in enumerate(points) for b in points[i + 1 :]]
        return min(gaps, default=0.0)
