"""From the site's messages to what the arena page shows, as one plain view. Pure: times come from outside.

The server says the words, the browser draws them: so every word is tested without a browser. Robots are
counted in the order of the arena file; metres and radians in the arena frame; ``*_ms`` milliseconds.
"""

import math
from collections import deque
from typing import Any

from contract.arena import Arena
from contract.messages import (
    BodyPose,
    LogEntry,
    Message,
    MocapFrame,
    MocapHealth,
    RobotReport,
    RunStatus,
    StationHeartbeat,
    StopRequest,
    TargetCloud,
)
from groundstation.connectivity import tree_floor
from groundstation.page_bar import bar
from groundstation.page_health import health
from groundstation.page_links import Network, network
from groundstation.page_reasons import POWERED, SILENT_S, Complaint, Heard, complaint
from groundstation.page_rows import Sight, row
from groundstation.page_stop import StopLatch
from groundstation.page_targets import TargetBoard
from groundstation.scenes import clock, label
from groundstation.session import MISPLACED_M

CAUTION_AFTER_S = 1.0
"""A caution must last this long before it is shown: a single late step is no news."""
EVENTS = 200
SHOWN_EVENTS = 12
HISTORY_S = 0.25
SPEED_OVER_S = 0.2


class PageState:
    """Everything heard so far, and the view it makes."""

    def __init__(self, arena: Arena, now_ns: int) -> None:
        self.arena = arena
        self.latch = StopLatch(tuple(arena.robots))
        self.board = TargetBoard(arena.control.sensing_radius_m)
        self.status: RunStatus | None = None
        self.status_ns = 0
        self.heartbeat: StationHeartbeat | None = None
        self.mocap: MocapHealth | None = None
        self.recorder: LogEntry | None = None
        self.recorder_ns = 0
        self.events: deque[tuple[int, str, str, str]] = deque(maxlen=EVENTS)
        """(number, time, words, level)."""
        self.history: deque[tuple[float, float]] = deque(maxlen=4 * 3600)
        """(elapsed s, lambda_2) of the mission."""
        self.marks: list[tuple[float, str]] = []
        self.began_ns = now_ns
        self._names = list(arena.robots)
        self._labels = [label(name) for name in self._names]
        self._index = {name: i for i, name in enumerate(self._names)}
        self._reports: dict[str, tuple[RobotReport, int]] = {}
        self._bodies: dict[str, BodyPose] = {}
        self._poses: dict[str, tuple[float, float, float, int]] = {}
        self._tracks: dict[str, deque[tuple[int, float, float]]] = {name: deque(maxlen=64) for name in self._names}
        self._frame: MocapFrame | None = None
        self._frame_ns = 0
        self._holds: dict[str, int] = {}
        self._cautions: dict[str, tuple[str, int]] = {}
        self._numbers = 0

    # --- in ---------------------------------------------------------------------------------------

    def receive(self, message: Message, arrival_ns: int) -> None:
        match message:
            case MocapFrame():
                self._take_frame(message, arrival_ns)
            case RobotReport() if message.robot in self._index:
                self._take_report(message, arrival_ns)
            case RunStatus():
                self._take_status(message, arrival_ns)
            case TargetCloud():
                self.board.take(message)
            case StationHeartbeat():
                self.heartbeat = message
            case StopRequest():
                if self.latch.pressed is None:
                    self.note(f"STOP by {message.source}", "error", arrival_ns)
                self.latch.overheard(message, arrival_ns)
            case MocapHealth():
                if self.mocap is None or self.mocap.state != message.state:
                    level = "info" if message.state == "ok" else "warning"
                    self.note(f"Mocap {message.state}. {message.detail}".strip(), level, arrival_ns)
                self.mocap = message
            case LogEntry():
                self._take_log(message, arrival_ns)
            case _:
                pass

    def note(self, words: str, level: str, now_ns: int) -> None:
        """A line of the event log."""
        self._numbers += 1
        self.events.append((self._numbers, self._clock(now_ns), words, level))

    def _clock(self, now_ns: int) -> str:
        """Time since the start of the mission while there is one, else since the page began."""
        if self.status is not None and self.status.elapsed_s > 0:
            return clock(self.status.elapsed_s)
        return f"-{clock((now_ns - self.began_ns) / 1e9)}"

    def _take_frame(self, frame: MocapFrame, arrival_ns: int) -> None:
        self._frame, self._frame_ns = frame, arrival_ns
        for body in frame.bodies:
            if body.robot in self._index:
                self._bodies[body.robot] = body
                if body.valid:
                    self._poses[body.robot] = (body.x_m, body.y_m, body.heading_rad, frame.exposure_ns)
                    self._tracks[body.robot].append((frame.exposure_ns, body.x_m, body.y_m))

    def _take_report(self, report: RobotReport, arrival_ns: int) -> None:
        before = self._reports.get(report.robot)
        self._reports[report.robot] = (report, arrival_ns)
        acknowledged = report.robot in self.latch.acknowledged_ns
        self.latch.heard(report, arrival_ns)
        if not acknowledged and report.robot in self.latch.acknowledged_ns and not self.latch.silent:
            self.note(f"{len(self._names)} of {len(self._names)} confirmed STOP", "info", arrival_ns)
        who = label(report.robot)
        if report.task == "occupied" and report.run == "running":
            self._holds.setdefault(report.robot, arrival_ns)
        else:
            self._holds.pop(report.robot, None)
        if before is None:
            return
        old = before[0]
        if old.run != report.run:
            words = f"{who} {report.run}" + (f": {report.reason}" if report.reason else "")
            bad = report.run in ("stopped", "fault") or (report.run == "holding" and report.reason)
            self.note(words, "error" if bad else "info", arrival_ns)
        if set(old.links_on) | set(old.links_kept) and report.run == "running":
            for other in set(old.links_on + old.links_kept) - set(report.links_on + report.links_kept):
                if report.robot < other:
                    self.note(f"Link {who}\u2013{label(other)} removed", "info", arrival_ns)
        if old.task != "helping" and report.task == "helping" and report.run == "running":
            self.marks.append((self._elapsed(), "help"))
            self.note(f"{who} goes to help", "info", arrival_ns)

    def _elapsed(self) -> float:
        return self.status.elapsed_s if self.status else 0.0

    def _take_status(self, status: RunStatus, arrival_ns: int) -> None:
        old = self.status
        self.status, self.status_ns = status, arrival_ns
        if status.elapsed_s == 0.0 and (self.history or self.board.done):
            self.history.clear()
            self.marks.clear()
            self.board.done.clear()
        for target in status.occupied:
            if target not in self.board.done:
                self.board.done.add(target)
                self.marks.append((status.elapsed_s, "done"))
                self.note(f"T{target + 1:02d} done", "info", arrival_ns)
        if old is None or old.phase != status.phase:
            detail = f": {status.detail}" if status.detail and status.phase != "waiting" else ""
            bad = status.phase in ("failed", "stopped")
            self.note(f"Mission {status.phase}{detail}", "error" if bad else "info", arrival_ns)

    def _take_log(self, entry: LogEntry, arrival_ns: int) -> None:
        if entry.source == "recorder":
            worse = entry.level != "info" and (self.recorder is None or self.recorder.level != entry.level)
            self.recorder, self.recorder_ns = entry, arrival_ns
            if not worse:
                return
        elif entry.source in self._index or entry.level not in ("warning", "error"):
            return
        self.note(f"{entry.source}: {entry.text}", entry.level, arrival_ns)

    # --- out --------------------------------------------------------------------------------------

    def layout(self) -> dict[str, Any]:
        """What does not change while the page is open, and what has been so far."""
        arena, control = self.arena, self.arena.control
        return {
            "kind": "layout",
            "name": arena.arena.name,
            "size": arena.arena.size_m,
            "fence": arena.arena.fence_m,
            "robots": self._names,
            "labels": self._labels,
            "starts": [robot.start for robot in arena.robots.values()],
            "r_c": control.sensing_radius_m,
            "r_n": round(control.noncritical_radius_m, 4),
            "r_a": control.avoidance_radius_m,
            "diameter": arena.platform.diameter_m,
            "hold_s": control.occupying_time_s,
            "profile": control.profile,
            "floor": tree_floor(len(self._names)),
            "history": list(self.history),
            "marks": self.marks,
            "events": list(self.events),
            "insecure": arena.link.insecure,
        }

    @property
    def cloud(self) -> TargetCloud | None:
        return self.board.cloud

    @property
    def cloud_version(self) -> int:
        return self.board.version

    def targets(self) -> dict[str, Any]:
        """The targets, sent when they change."""
        return self.board.message()

    def view(self, now_ns: int) -> dict[str, Any]:
        """The arena at this moment."""
        complaints = self.complaints(now_ns)
        graph = self.network(now_ns)
        status = self.status
        if status is not None and status.phase == "running":
            when = status.elapsed_s
            if not self.history or when - self.history[-1][0] >= HISTORY_S:
                self.history.append((round(when, 2), round(graph.lambda2, 4)))
        away = self.misplaced()
        rows = [row(name, self._sight(name, complaints.get(name), away.get(name), now_ns)) for name in self._names]
        running = [self._poses[n][:2] for n, (r, _) in self._reports.items() if r.run == "running" and n in self._poses]
        recorder_age_s = (now_ns - self.recorder_ns) / 1e9
        station = self.station_alive(now_ns)
        view: dict[str, Any] = {
            "kind": "view",
            "t": now_ns // 1_000_000,
            "age_s": round(self.frame_age_s(now_ns), 3),
            "station": station,
            "robots": rows,
            "links": graph.pairs,
            "l2": round(graph.lambda2, 4),
            "elapsed": self._elapsed(),
            "version": self.cloud_version,
            "targets": self.board.letters((r for r, _ in self._reports.values()), running),
            "health": health(self.mocap, self.frame_age_s(now_ns), station, self.recorder, recorder_age_s),
            "events": list(self.events)[-SHOWN_EVENTS:],
            "marks": self.marks[-40:],
            "marked": len(self.marks),
            "history": list(self.history)[-4:],
        }
        view |= bar(self, rows, graph, now_ns)
        return view

    def station_alive(self, now_ns: int) -> bool:
        return self.status is not None and now_ns - self.status_ns < SILENT_S * 1e9

    def frame_age_s(self, now_ns: int) -> float:
        """Since the last pose frame arrived; -1 for never."""
        return (now_ns - self._frame_ns) / 1e9 if self._frame else -1.0

    def report_age_s(self, robot: str, now_ns: int) -> float:
        """Since the robot's last report arrived; -1 for never."""
        entry = self._reports.get(robot)
        return (now_ns - entry[1]) / 1e9 if entry else -1.0

    def reports(self) -> dict[str, RobotReport]:
        return {name: report for name, (report, _) in self._reports.items()}

    def silent(self, now_ns: int) -> list[str]:
        """Robots that have not confirmed the STOP, or where nobody pressed it, that do not report."""
        if self.latch.pressed is not None and self.latch.pressed.stop_id:
            return self.latch.silent
        return [name for name in self._names if not 0 <= self.report_age_s(name, now_ns) <= SILENT_S]

    def misplaced(self) -> dict[str, float]:
        """Robots that are not at their starts, with the distance in m."""
        places = {name: pose[:2] for name, pose in self._poses.items()}
        starts = {name: self.arena.robots[name].start for name in places}
        away = {name: math.dist(place, starts[name]) for name, place in places.items()}
        return {name: away_m for name, away_m in away.items() if away_m > MISPLACED_M}

    def complaints(self, now_ns: int) -> dict[str, Complaint]:
        """What is wrong, by robot."""
        found = {}
        for name in self._names:
            entry = self._reports.get(name)
            report, arrival_ns = entry if entry else (None, 0)
            ahead_s = (report.stamp_ns - arrival_ns) / 1e9 if report else 0.0
            age_s, frame_age_s = self.report_age_s(name, now_ns), self.frame_age_s(now_ns)
            trouble = complaint(self.arena, name, Heard(report, age_s, self._bodies.get(name), frame_age_s, ahead_s))
            if trouble is None:
                self._cautions.pop(name, None)
                continue
            if trouble.level == "caution" and report is not None:
                title, since_ns = self._cautions.get(name, ("", now_ns))
                if title != trouble.title:
                    since_ns = now_ns
                self._cautions[name] = (trouble.title, since_ns)
                if now_ns - since_ns < CAUTION_AFTER_S * 1e9:
                    continue
            found[name] = trouble
        return found

    def network(self, now_ns: int) -> Network:
        control = self.arena.control
        points = [self._poses[n][:2] if n in self._poses else None for n in self._names]
        enforced = [
            [self._index[o] for o in r.links_on + r.links_kept if o in self._index]
            for r in (self._reports[n][0] if n in self._reports else None for n in self._names)
            if r is not None
        ]
        linked = len(enforced) == len(self._names) and any(enforced)
        powered = any(r.run in (*POWERED, "stopped", "fault") for r, _ in self._reports.values())
        doubtful = frozenset(i for i, name in enumerate(self._names) if not self._verified(name, now_ns))
        fresh = 0 <= self.frame_age_s(now_ns) <= SILENT_S
        return network(
            [(p[0], p[1]) if p else None for p in points],
            enforced if linked and powered else None,
            doubtful,
            self._labels,
            control.sensing_radius_m,
            control.noncritical_radius_m,
            fresh,
        )

    def _verified(self, name: str, now_ns: int) -> bool:
        body = self._bodies.get(name)
        return body is not None and body.valid and 0 <= self.report_age_s(name, now_ns) <= SILENT_S

    def speed_mps(self, name: str) -> float | None:
        """As motion capture sees it, over the last 0.2 s."""
        track = self._tracks[name]
        if len(track) < 2:
            return None
        last = track[-1]
        first = next(point for point in track if last[0] - point[0] <= SPEED_OVER_S * 1e9)
        gap_s = (last[0] - first[0]) / 1e9
        return math.dist(first[1:], last[1:]) / gap_s if gap_s > 0 else None

    def _sight(self, name: str, trouble: Complaint | None, away_m: float | None, now_ns: int) -> Sight:
        entry = self._reports.get(name)
        held_ns = self._holds.get(name)
        hold_s = max(1e-3, self.arena.control.occupying_time_s)
        return Sight(
            report=entry[0] if entry else None,
            report_age_s=self.report_age_s(name, now_ns),
            body=self._bodies.get(name),
            pose=self._poses.get(name),
            exposure_ns=self._frame.exposure_ns if self._frame else None,
            speed_mps=self.speed_mps(name),
            hold_share=None if held_ns is None else (now_ns - held_ns) / 1e9 / hold_s,
            acknowledged_ns=self.latch.acknowledged_ns.get(name),
            away_m=away_m,
            trouble=trouble,
        )
