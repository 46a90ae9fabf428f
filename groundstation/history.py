"""A run as columns: fed message by message, live or from a recording, and read by metrics and figures. Pure.

Robots are counted in the order of the arena file. Times are site time, ns; positions metres in the
arena frame; NaN where a robot was not seen.
"""

from array import array
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contract.arena import Arena
from contract.messages import (
    LogEntry,
    Message,
    MocapFrame,
    MocapHealth,
    MotorBatch,
    NeighbourState,
    RobotReport,
    RobotStep,
    RunStatus,
    StepBatch,
    StopRequest,
    TargetCloud,
)
from groundstation.activity import activity

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
ENDINGS = ("completed", "stopped", "failed")
HOLD_NS = 250_000_000
"""Positions are not interpolated across a longer gap."""


class Doing(NamedTuple):
    """What a robot did from ``since_ns`` on."""

    since_ns: int
    task: str
    activity: str
    claim: int


class Links(NamedTuple):
    """Links a robot enforced from the frame exposed at ``exposure_ns`` on; those in ``on`` it also vouched for."""

    exposure_ns: int
    enforced: frozenset[int]
    on: frozenset[int]


class Occupation(NamedTuple):
    """When a target was first reported occupied, and by whom."""

    target: int
    stamp_ns: int
    robot: str
    mission: str = ""


class Mission(NamedTuple):
    """The span from start to end; ``ending`` is the phase it ended in, empty where the recording ends first."""

    start_ns: int
    end_ns: int
    ending: str
    detail: str = ""


@dataclass
class RobotTrack:
    """What one robot did."""

    step_ns: "array[int]" = field(default_factory=lambda: array("q"))
    write_ns: "array[int]" = field(default_factory=lambda: array("q"))
    exposure_ns: "array[int]" = field(default_factory=lambda: array("q"))
    links: list[Links] = field(default_factory=list)
    doing: list[Doing] = field(default_factory=list)
    motor_ns: "array[int]" = field(default_factory=lambda: array("q"))
    """When the emulated motor controller had decoded each command."""
    true_ns: "array[int]" = field(default_factory=lambda: array("q"))
    true_xy_m: "array[float]" = field(default_factory=lambda: array("d"))
    reports: list[RobotReport] = field(default_factory=list)
    """Only those that say something new about state, faults or counters, and the latest."""

    def links_at(self, exposure_ns: int) -> Links | None:
        """What it enforced as of a frame."""
        k = bisect_right(self.links, exposure_ns, key=lambda entry: entry.exposure_ns)
        return self.links[k - 1] if k else None


class History:
    """Everything worth knowing of a run, in memory. :meth:`receive` takes any message of the site."""

    def __init__(self, arena: Arena) -> None:
        self.arena = arena
        self.robots = tuple(arena.robots)
        self.tracks = {name: RobotTrack() for name in self.robots}
        self.cloud: TargetCloud | None = None
        self.occupations: dict[int, Occupation] = {}
        self.statuses: list[RunStatus] = []
        """One for every change of phase, in order."""
        self.newest: RunStatus | None = None
        self.logs: list[LogEntry] = []
        """Warnings and errors."""
        self.stops: list[StopRequest] = []
        """The first request of each stop."""
        self.health: list[MocapHealth] = []
        self.frame_numbers: list[tuple[int, int]] = []
        """(session, frame) of every frame."""
        self._index = {name: i for i, name in enumerate(self.robots)}
        self._exposure_ns = array("q")
        self._transmit_ns = array("q")
        self._poses = array("d")

    # --- in ---------------------------------------------------------------------------------------

    def receive(self, message: Message) -> None:
        match message:
            case MocapFrame():
                self._frame(message)
            case StepBatch():
                for step in message.steps:
                    self._step(step)
            case MotorBatch() if message.robot in self.tracks:
                track = self.tracks[message.robot]
                track.motor_ns.extend(sample.stamp_ns for sample in message.samples)
                track.true_ns.append(message.true_ns)
                track.true_xy_m.extend((message.true_x_m, message.true_y_m))
            case NeighbourState():
                self._state(message)
            case RobotReport() if message.robot in self.tracks:
                self._report(message)
            case RunStatus():
                self.newest = message
                if not self.statuses or self.statuses[-1].phase != message.phase:
                    self.statuses.append(message)
            case TargetCloud():
                self._targets(message)
            case MocapHealth():
                self.health.append(message)
            case StopRequest():
                if message.stop_id not in [stop.stop_id for stop in self.stops]:
                    self.stops.append(message)
            case LogEntry() if message.level in ("warning", "error"):
                self.logs.append(message)
            case _:
                pass

    def _frame(self, frame: MocapFrame) -> None:
        if self._exposure_ns and frame.exposure_ns <= self._exposure_ns[-1]:
            return
        row = [float("nan")] * (3 * len(self.robots))
        for body in frame.bodies:
            i = self._index.get(body.robot)
            if i is not None and body.valid:
                row[3 * i : 3 * i + 3] = body.x_m, body.y_m, body.heading_rad
        self.frame_numbers.append((frame.session, frame.frame))
        self._exposure_ns.append(frame.exposure_ns)
        self._transmit_ns.append(frame.transmit_ns)
        self._poses.extend(row)

    def _step(self, step: RobotStep) -> None:
        track = self.tracks.get(step.robot)
        if track is None:
            return
        track.step_ns.append(step.step_ns)
        track.write_ns.append(step.write_ns)
        track.exposure_ns.append(step.exposure_ns)
        known = [(self._index[link.other], link.state) for link in step.links if link.other in self._index]
        enforced = frozenset(i for i, _ in known)
        on = frozenset(i for i, state in known if state == "on")
        if not track.links or track.links[-1][1:] != (enforced, on):
            track.links.append(Links(step.exposure_ns, enforced, on))
        word = activity(step)
        if not track.doing or track.doing[-1][1:] != (step.task, word, step.claim):
            track.doing.append(Doing(step.step_ns, step.task, word, step.claim))

    def _targets(self, cloud: TargetCloud) -> None:
        """The newest targets up to the start; those of a later mission belong to another run."""
        old = self.cloud
        if old is None or cloud.mission != old.mission:
            if old is not None and any(status.phase == "running" for status in self.statuses):
                return
            mission = ("", cloud.mission)
            self.occupations = {k: entry for k, entry in self.occupations.items() if entry.mission in mission}
        self.cloud = cloud

    def _state(self, state: NeighbourState) -> None:
        if self.cloud is not None and state.mission not in ("", self.cloud.mission):
            return
        try:
            bits = int(state.occupied or "0", 16)
        except ValueError:
            return
        while bits:
            target = (bits & -bits).bit_length() - 1
            bits &= bits - 1
            known = self.occupations.get(target)
            if known is None or state.stamp_ns < known.stamp_ns:
                self.occupations[target] = Occupation(target, state.stamp_ns, state.robot, state.mission)

    def _report(self, report: RobotReport) -> None:
        kept = self.tracks[report.robot].reports

        def essence(r: RobotReport) -> tuple[object, ...]:
            return (r.run, r.reason, r.motor_faults, r.stop_id, r.stopped, r.counters)

        if len(kept) > 1 and essence(kept[-1]) == essence(report) == essence(kept[-2]):
            kept[-1] = report
        else:
            kept.append(report)

    # --- out --------------------------------------------------------------------------------------

    @property
    def frames(self) -> int:
        return len(self._exposure_ns)

    @property
    def exposure_ns(self) -> Integers:
        """Shape (frames,)."""
        return np.array(self._exposure_ns, dtype=np.int64)

    @property
    def transmit_ns(self) -> Integers:
        """Shape (frames,)."""
        return np.array(self._transmit_ns, dtype=np.int64)

    def poses(self) -> Floats:
        """x, y (m) and heading (rad) of the valid bodies: shape (frames, robots, 3), NaN where invalid."""
        return np.array(self._poses, dtype=np.float64).reshape(self.frames, len(self.robots), 3)

    def last_known(self) -> Floats:
        """Like :meth:`poses`, an invalid pose replaced by the robot's last valid one."""
        poses = self.poses()
        for i in range(len(self.robots)):
            seen = ~np.isnan(poses[:, i, 0])
            rows = np.maximum.accumulate(np.where(seen, np.arange(self.frames), -1))
            poses[rows >= 0, i] = poses[rows[rows >= 0], i]
        return poses

    def true_positions(self) -> Floats:
        """Where the robots really were at each exposure: shape (frames, robots, 2).

        Interpolated from the emulated bodies where there are any, else the last known pose.
        """
        positions = self.last_known()[:, :, :2]
        at_ns = self.exposure_ns
        for i, name in enumerate(self.robots):
            track = self.tracks[name]
            if len(track.true_ns) < 2:
                continue
            stamps = np.array(track.true_ns, dtype=np.int64)
            truth = np.array(track.true_xy_m, dtype=np.float64).reshape(-1, 2)
            after = np.searchsorted(stamps, at_ns)
            inside = (after > 0) & (after < len(stamps))
            inside[inside] &= stamps[after[inside]] - stamps[after[inside] - 1] <= HOLD_NS
            for axis in range(2):
                positions[inside, i, axis] = np.interp(at_ns[inside], stamps, truth[:, axis])
        return positions

    def mission(self) -> Mission | None:
        """The mission of the recording; None when none was started.

        From the moment of the start (stamp less elapsed time of the first ``running`` status) until the ending
        status says, by the time elapsed since the last start. A mission that was stopped and started again has not
        ended by that; what comes after the end does not change it. Without an ending, to the newest status or frame.
        """
        start_ns = begun_ns = -1
        ending: RunStatus | None = None
        for status in self.statuses:
            if status.phase == "running":
                begun_ns = status.stamp_ns - round(status.elapsed_s * 1e9)
                start_ns, ending = start_ns if start_ns >= 0 else begun_ns, None
            elif status.phase in ENDINGS and start_ns >= 0 and ending is None:
                ending = status
        if start_ns < 0:
            return None
        if ending is not None:
            return Mission(start_ns, begun_ns + round(ending.elapsed_s * 1e9), ending.phase, ending.detail)
        assert self.newest is not None
        end_ns = max(self.newest.stamp_ns, self._exposure_ns[-1] if self._exposure_ns else 0)
        return Mission(start_ns, end_ns, "")
