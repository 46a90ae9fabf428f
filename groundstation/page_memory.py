"""Everything the arena page has heard so far: the newest of each, the mission's past, the event log. Pure.

Robots are counted in the order of the arena file; metres and radians in the arena frame; times of arrival ns.
"""

from collections import deque
from collections.abc import Collection
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
from groundstation.page_missing import BRIDGE, RECORDER, STATION, Roll
from groundstation.page_rows import told
from groundstation.page_stop import StopLatch
from groundstation.page_targets import TargetBoard
from groundstation.scenes import clock, label

EVENTS = 200
PARTS = {BRIDGE: "Mocap bridge", STATION: "Station", RECORDER: "Recorder"}
"""Source -> name of what is told to come and go; robots are told by their reports."""


class PageMemory:
    """Everything heard so far."""

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
        self.news = 0
        """Raised by what has to be shown at once: STOP and its answers, run states, faults, phases, processes."""
        self.began_ns = now_ns
        self._names = list(arena.robots)
        self._labels = [label(name) for name in self._names]
        self._index = {name: i for i, name in enumerate(self._names)}
        self._reports: dict[str, tuple[RobotReport, int]] = {}
        self._told: dict[str, dict[str, Any]] = {}
        self._bodies: dict[str, BodyPose] = {}
        self._poses: dict[str, tuple[float, float, float, int]] = {}
        self._tracks: dict[str, deque[tuple[int, float, float]]] = {name: deque(maxlen=64) for name in self._names}
        self._frame: MocapFrame | None = None
        self._frame_ns = 0
        self._holds: dict[str, int] = {}
        self._numbers = 0
        self.roll = Roll()

    def frame_age_s(self, now_ns: int) -> float:
        """Since the last pose frame arrived; -1 for never."""
        return (now_ns - self._frame_ns) / 1e9 if self._frame else -1.0

    def poses(self, now_ns: int) -> dict[str, Any]:
        """What moves between two views: (x, y, heading, valid) of every robot, None where it was never seen.

        ``hold`` is how much of its occupying time each robot that occupies a target has behind it.
        """
        bodies = self._bodies
        return {
            "kind": "poses",
            "t": now_ns // 1_000_000,
            "age_s": round(self.frame_age_s(now_ns), 3),
            "poses": [
                (round(pose[0], 4), round(pose[1], 4), round(pose[2], 3), int(bodies[name].valid))
                if (pose := self._poses.get(name)) is not None
                else None
                for name in self._names
            ],
            "hold": {self._index[name]: self.hold_share(name, now_ns) for name in self._holds},
        }

    def hold_share(self, name: str, now_ns: int) -> float | None:
        """Of its occupying time that a robot has behind it; None while it occupies nothing."""
        held_ns, whole_s = self._holds.get(name), max(1e-3, self.arena.control.occupying_time_s)
        return None if held_ns is None else round(min(1.0, (now_ns - held_ns) / 1e9 / whole_s), 3)

    def receive(self, message: Message, arrival_ns: int) -> None:
        match message:
            case MocapFrame():
                self.roll.heard(BRIDGE)
                self._take_frame(message, arrival_ns)
            case RobotReport() if message.robot in self._index:
                self._take_report(message, arrival_ns)
            case RunStatus():
                self.roll.heard(STATION)
                self._take_status(message, arrival_ns)
            case TargetCloud():
                self.board.take(message)
            case StationHeartbeat():
                self.news += self.heartbeat is None or self.heartbeat.order != message.order
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

    def attend(self, present: Collection[str], now_ns: int) -> None:
        """Take which processes of the site are there."""
        come, gone = self.roll.call(present, now_ns)
        self.news += bool(come or gone)
        for source in gone:
            if source in PARTS:
                self.note(f"{PARTS[source]} gone", "error", now_ns)
        for source in come:
            if source in PARTS:
                self.note(f"{PARTS[source]} is there", "info", now_ns)

    def note(self, words: str, level: str, now_ns: int) -> None:
        """A line of the event log."""
        self._numbers += 1
        self.news += level != "info"
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
        self._told[report.robot] = told(report)
        acknowledged, pressed = report.robot in self.latch.acknowledged_ns, self.latch.pressed
        self.latch.heard(report, arrival_ns)
        self.news += before is None or _grave(before[0]) != _grave(report) or pressed is not self.latch.pressed
        self.news += acknowledged is not (report.robot in self.latch.acknowledged_ns)
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
            self.news += 1
            detail = f": {status.detail}" if status.detail and status.phase != "waiting" else ""
            bad = status.phase in ("failed", "stopped")
            self.note(f"Mission {status.phase}{detail}", "error" if bad else "info", arrival_ns)

    def _take_log(self, entry: LogEntry, arrival_ns: int) -> None:
        if entry.source == RECORDER:
            self.roll.heard(RECORDER)
            worse = entry.level != "info" and (self.recorder is None or self.recorder.level != entry.level)
            self.recorder, self.recorder_ns = entry, arrival_ns
            if not worse:
                return
        elif entry.source in self._index or entry.level not in ("warning", "error"):
            return
        self.note(f"{entry.source}: {entry.text}", entry.level, arrival_ns)


def _grave(report: RobotReport) -> tuple[object, ...]:
    """What of a report is shown at once when it changes."""
    return report.run, report.reason, report.motor_faults, report.pose_valid
