"""What a robot tells its station of itself: reports, steps, wheel feedback and log entries. Pure."""

import re
from typing import Final, Literal, NamedTuple

from contract.arena import Arena, digest
from contract.keys import Keys
from contract.messages import (
    SCHEMA_VERSION,
    FeedbackBatch,
    LinkState,
    LogEntry,
    Message,
    MocapFrame,
    RobotReport,
    RobotStep,
    StepBatch,
    WheelFeedback,
)
from contract.units import fifth
from onboard.ahdc.controller import Controller, LinkWord
from onboard.pacing import Pacing
from onboard.safety import Supervisor, Verdict
from onboard.sensing import Sensing

REPORT_PERIOD_NS: Final = 100_000_000
MAX_BATCH: Final = 64
NUMBER = re.compile(r"(?<!\w)\d[\d.]*")
"""Not that in a robot's name."""

LogLevel = Literal["debug", "info", "warning", "error"]
Outbox = list[tuple[str, Message]]
"""(key, message)."""


class Drive(NamedTuple):
    """What the wheels shall do: motors enabled or not, wheel speeds in rad/s."""

    enable: bool
    left_radps: float
    right_radps: float


class Account:
    """Keeps what has not been told yet; :attr:`counters` is everything refused so far, by name."""

    def __init__(
        self,
        arena: Arena,
        robot: str,
        boot: int,
        software: str,
        supervisor: Supervisor,
        sensing: Sensing,
        pacing: Pacing,
    ) -> None:
        keys = Keys(arena.arena.name)
        self.counters: dict[str, int] = {}
        self._robot = robot
        self._boot = boot
        self._software = software
        self._hash = digest(arena)
        self._supervisor = supervisor
        self._sensing = sensing
        self._pacing = pacing
        self._report_key, self._steps_key = keys.report(robot), keys.steps(robot)
        self._feedback_key, self._log_key = keys.feedback(robot), keys.log(robot)
        self._steps: list[RobotStep] = []
        self._samples: list[WheelFeedback] = []
        self._logs: list[LogEntry] = []
        self._link_states: dict[str, LinkWord] = {}
        self._links: tuple[LinkState, ...] = ()
        self._next_report_ns = 0
        self._last_words = ("", "")
        self._said: tuple[str, int, int] = ("", 0, 0)
        """Run state, order and stop of the last report."""

    def refuse(self, counter: str) -> None:
        """Count something that was not taken."""
        self.counters[counter] = self.counters.get(counter, 0) + 1

    def sample(self, sample: WheelFeedback) -> None:
        """Note what the motor controller measured."""
        if len(self._samples) < MAX_BATCH:
            self._samples.append(sample)

    def step(
        self, frame: MocapFrame, times_ns: tuple[int, int], drive: Drive, waits: str, task: str, controller: Controller
    ) -> None:
        """Note one control step, at its end; ``times_ns``: it began, and its bus write had returned."""
        if len(self._steps) >= MAX_BATCH:
            return
        states = controller.link_states()
        if states is not self._link_states and states != self._link_states:
            self._link_states = states
            self._links = tuple(LinkState(other=name, state=state) for name, state in states.items())
        step_ns, write_ns = times_ns
        _, left_radps, right_radps = drive
        claim = controller.tasking.claim
        step = RobotStep(
            robot=self._robot,
            frame=frame.frame,
            exposure_ns=frame.exposure_ns,
            step_ns=step_ns,
            write_ns=write_ns,
            left_radps=fifth(left_radps),
            right_radps=fifth(right_radps),
            links=self._links,
            task=task,
            claim=-1 if claim is None else claim,
            waits=waits,
        )
        self._steps.append(step)

    def log(self, now_ns: int, level: LogLevel, event: str, text: str, remedy: str = "") -> None:
        """Say something to a person; of many at once the last are kept."""
        words = f"{text}; {remedy}" if remedy and text else text
        entry = LogEntry(stamp_ns=now_ns, level=level, source=self._robot, event=event, text=words)
        self._logs = [*self._logs[-15:], entry]

    def verdict(self, verdict: Verdict, now_ns: int) -> None:
        """Log the supervisor's word where it is another than before; a number in it that runs on is not."""
        words = (verdict.run, verdict.reason)
        if words == self._last_words:
            return
        before, self._last_words = self._last_words, words
        if words[0] != before[0] or NUMBER.sub("", words[1]) != NUMBER.sub("", before[1]):
            level: LogLevel = "warning" if verdict.reason else "info"
            self.log(now_ns, level, verdict.run, verdict.reason, verdict.remedy)

    def report_due(self, verdict: Verdict, now_ns: int) -> bool:
        """Whether it is time for a report, or something to acknowledge cannot wait for that."""
        said = (verdict.run, self._supervisor.order_id, self._supervisor.stop_id)
        if now_ns >= self._next_report_ns:
            self._next_report_ns = next_ns(self._next_report_ns, REPORT_PERIOD_NS, now_ns)
        elif said == self._said:
            return False
        self._said = said
        return True

    def report(
        self,
        now_ns: int,
        verdict: Verdict,
        pose_valid: bool,
        sample: WheelFeedback | None,
        faulty: bool,
        task: str,
        controller: Controller,
    ) -> Outbox:
        """A report, and the steps and feedback since the last one; ``faulty``: the driver says so."""
        own = self._sensing.own()
        tasking = controller.tasking
        links = controller.link_states()
        report = RobotReport(
            robot=self._robot,
            boot=self._boot,
            stamp_ns=now_ns,
            schema_version=SCHEMA_VERSION,
            software=self._software,
            arena_hash=self._hash,
            run=verdict.run,
            reason=verdict.reason,
            remedy=verdict.remedy,
            order_id=self._supervisor.order_id,
            stop_id=self._supervisor.stop_id,
            stopped=verdict.at_rest and not verdict.may_move,
            pose_age_ms=round(min(1e9, (now_ns - own[1]) * 1e-6), 3) if own else 1e9,
            pose_valid=pose_valid,
            timing=self._pacing.timing(),
            battery_v=sample.bus_v if sample else None,
            motor_faults=sample.faults if sample and faulty else (),
            task=task,
            claim=-1 if tasking.claim is None else tasking.claim,
            occupied_count=tasking.occupied_count,
            neighbours=tuple(sorted(self._sensing.sighted(own[0], now_ns))) if own else (),
            links_on=tuple(name for name, state in links.items() if state == "on"),
            links_kept=tuple(name for name, state in links.items() if state != "on"),
            counters=self._counted(),
        )
        out: Outbox = [(self._report_key, report)]
        if self._steps:
            out.append((self._steps_key, StepBatch(robot=self._robot, steps=tuple(self._steps))))
            self._steps = []
        return out + self.feedback()

    def feedback(self) -> Outbox:
        """The wheel feedback not told yet."""
        if not self._samples:
            return []
        batch = FeedbackBatch(robot=self._robot, samples=tuple(self._samples))
        self._samples = []
        return [(self._feedback_key, batch)]

    def logs(self) -> Outbox:
        """The log entries not told yet."""
        if not self._logs:
            return []
        logs, self._logs = self._logs, []
        return [(self._log_key, entry) for entry in logs]

    def _counted(self) -> dict[str, int]:
        found = dict(self.counters)
        if self._sensing.replayed:
            found["state replayed"] = self._sensing.replayed
        if self._supervisor.ignored_heartbeats:
            found["heartbeat replayed"] = self._supervisor.ignored_heartbeats
        return found


def next_ns(last_ns: int, period_ns: int, now_ns: int) -> int:
    """When to tell again what was due at ``last_ns``: in step, or from now on where that was long ago."""
    return last_ns + period_ns if now_ns - last_ns < 4 * period_ns else now_ns + period_ns
