"""One robot's whole mind: messages, feedback and time in; wheel speeds and messages out. Pure.

Three feeders drive the same object: the runtime (real clock), ``simulate`` (lockstep) and ``replay``.
"""

from typing import Literal, NamedTuple

from contract.arena import Arena, digest
from contract.keys import Keys
from contract.messages import (
    SCHEMA_VERSION,
    BodyPose,
    FeedbackBatch,
    LinkState,
    LogEntry,
    Message,
    MocapFrame,
    NeighbourState,
    RobotReport,
    RobotStep,
    RunState,
    StationHeartbeat,
    StepBatch,
    StopRequest,
    TargetCloud,
    WheelFeedback,
)
from onboard import unicycle
from onboard.ahdc.controller import Controller, LinkWord
from onboard.ahdc.parameters import from_arena, record
from onboard.ahdc.plan import Motion
from onboard.ahdc.view import View
from onboard.cut import cut_bounds, limit_cut
from onboard.failsafes import Conditions
from onboard.homing import Home, Homing
from onboard.laws import installed_law
from onboard.limits import Neighbour, bounds_of, inside_fence, limit
from onboard.motion import MotionCheck
from onboard.odometry import Odometry, Pose
from onboard.pacing import Pacing
from onboard.safety import Supervisor, Verdict
from onboard.sensing import Sensing
from onboard.vitals import Vitals

REPORT_PERIOD_NS = 100_000_000
STALL_NS = 50_000_000
"""Repeated or overtaken frames are no fault while new ones come in between."""
DUPLICATE_WINDOW_NS = 2_000_000_000
STATE_AGE_NS = 2_000_000_000
"""What a neighbour said longer ago is refused like a lost message, whoever held it back."""
MAX_BATCH = 64
MAX_RIM_MPS = 20.0
"""A measured rim speed above this, or one that is not a number, is a fault of the telemetry."""


LogLevel = Literal["debug", "info", "warning", "error"]


class Drive(NamedTuple):
    """What the wheels shall do: motors enabled or not, wheel speeds in rad/s."""

    enable: bool
    left_radps: float
    right_radps: float


class Agent:
    """See the module. ``boot`` is a number never used before by this robot."""

    def __init__(self, arena: Arena, robot: str, boot: int, software: str = "") -> None:
        self.arena = arena
        self.robot = robot
        self.boot = boot
        self._software = software
        self._keys = Keys(arena.arena.name)
        self._hash = digest(arena)
        self._radius_m = arena.platform.wheel_radius_m
        self._separation_m = arena.platform.wheel_separation_m
        self._bounds = bounds_of(arena)
        self._cut_bounds = cut_bounds(arena)
        self.supervisor = Supervisor(arena, robot)
        self.sensing = Sensing(robot, arena.control.sensing_radius_m, arena.safety.neighbour_silence_s)
        self.pacing = Pacing(arena.control.control_period_s, arena.mocap.frame_rate_hz)
        parameters = from_arena(arena)
        self.counters: dict[str, int] = {}
        self._tolerance_ns = round(arena.safety.clock_tolerance_s * 1e9)
        self._past_sessions: set[int] = set()
        self._past_missions: set[str] = set()
        self._waiting_targets: TargetCloud | None = None
        """Of a mission that the station has not named yet."""
        law = installed_law(robot, parameters, arena.control.law, self.refuse)
        self.controller = Controller(robot, boot, parameters, self.pacing.period_s, unicycle.steer, unicycle.rims, law)
        self._parameters = parameters
        entry = arena.robots[robot]
        self._on_stand = entry.emulate == ("body",)
        """Its virtual body rolls as the wheels say they turn, which is told at once."""
        home = Home(*entry.start, entry.heading_rad)
        self.homing = Homing(robot, home, parameters, self._bounds, self.pacing.period_s)
        self._going_home = False
        self._odometry = Odometry(self._separation_m)
        self._motion = MotionCheck(arena.safety, self._separation_m)
        self._resets = 0
        self._moved: tuple[int, BodyPose] | None = None
        """Newest valid pose not yet compared with the wheels, and its time."""
        self._frame: MocapFrame | None = None
        self._frame_arrival_ns = 0
        self._advancing = False
        self._pose_valid = False
        self._pose_reason = "never seen"
        self._start_direction = 0.0
        self._feedback: WheelFeedback | None = None
        self._driver_active = False
        self._driver_fault = ""
        self._driver_remedy = ""
        self._duplicate_ns = -DUPLICATE_WINDOW_NS
        self._loop_ns = 0
        self._verdict: Verdict | None = None
        self._drive = Drive(False, 0.0, 0.0)
        self._commanded = (0.0, 0.0)
        self._steps: list[RobotStep] = []
        self._view: View | None = None
        """Of the last step, until it has been thought about."""
        self._stepped: MocapFrame | None = None
        self._step_ns = 0
        self._write_ns = 0
        self._waits = ""
        self._link_states: dict[str, LinkWord] = {}
        self._links: tuple[LinkState, ...] = ()
        self._samples: list[WheelFeedback] = []
        self._logs: list[LogEntry] = []
        self._next_state_ns = 0
        self._next_report_ns = 0
        self._last_words = ("", "")
        self._said: tuple[str, int, int] = ("", 0, 0)
        """Run state, order and stop of the last report."""

    # --- inputs -------------------------------------------------------------------------------

    def receive(self, message: Message, now_ns: int, payload: bytes = b"") -> bool:
        """Take a decoded message meant for this robot; True when a control step is due.

        :param payload: what it was decoded from, where that is at hand; a journal checks it.
        """
        match message:
            case MocapFrame():
                return self._on_frame(message, now_ns)
            case NeighbourState():
                self._on_state(message, now_ns)
            case StationHeartbeat():
                self.supervisor.heartbeat(message, now_ns)
                self.controller.exclude(self.supervisor.excluded)
                if self._waiting_targets and self._waiting_targets.mission == self.supervisor.mission:
                    self._on_targets(self._waiting_targets)
            case StopRequest():
                self.supervisor.stop_request(message, now_ns)
            case TargetCloud():
                self._on_targets(message)
            case _:
                self.refuse(f"unexpected {type(message).__name__}")
        return False

    def hears(self, robot: str) -> bool:
        """Whether a state message of that robot is worth decoding: the virtual radio reaches it, or it is our id."""
        return robot == self.robot or self.sensing.in_range(robot)

    def refuse(self, counter: str) -> None:
        """Count something that did not decode or was not meant for this robot."""
        self.counters[counter] = self.counters.get(counter, 0) + 1

    def feedback(self, sample: WheelFeedback, now_ns: int) -> None:
        """Take what the motor controller measured; speeds that cannot be are refused and count as silence."""
        if not max(abs(sample.left_radps), abs(sample.right_radps)) * self._radius_m <= MAX_RIM_MPS:
            self.refuse("feedback out of range")
            return
        self._feedback = sample
        rims = sample.left_radps * self._radius_m, sample.right_radps * self._radius_m
        self._odometry.record(sample.stamp_ns, *rims)
        self._motion.feedback(sample.stamp_ns, *rims)
        if len(self._samples) < MAX_BATCH:
            self._samples.append(sample)
        if sample.faults and not self._driver_fault:
            self.driver_fault(
                f"motor controller reports {', '.join(sample.faults)}", "clear the cause, then arm", now_ns
            )

    def driver_fault(self, text: str, remedy: str, now_ns: int) -> None:
        """The driver lost its port or the controller reports a fault; empty text: repaired."""
        if text and text != self._driver_fault:
            self._log(now_ns, "error", "driver_fault", text, remedy)
        self._driver_fault, self._driver_remedy = text, remedy

    def driver_active(self, active: bool, now_ns: int) -> None:
        """The motors are enabled (the device has confirmed it) or not."""
        self._driver_active = active
        if not active:
            self._motion.forget()

    @property
    def run_state(self) -> RunState:
        """The supervisor's state."""
        return self.supervisor.state

    @property
    def verdict(self) -> Verdict | None:
        """The supervisor's last word; None before the first step or tick."""
        return self._verdict

    @property
    def vitals(self) -> Vitals:
        """What a watchdog judges."""
        feedback_ns = self._feedback.stamp_ns if self._feedback else 0
        reason = self._verdict.reason if self._verdict else ""
        return Vitals(self.supervisor.state, reason, self._frame_arrival_ns, feedback_ns)

    # --- the loop -----------------------------------------------------------------------------

    def step(self, now_ns: int) -> Drive:
        """Control step on the newest frame."""
        verdict = self._assess(now_ns)
        own = self.sensing.own()
        if own is None:
            return self._rest(verdict)
        pose = self._odometry.predict(own[0], own[1], now_ns)
        left, right = self._odometry.rims
        motion = record(Motion, (*pose, left, right))
        sighted = self.sensing.sighted(pose, now_ns, self.controller.linked)
        heard = self.sensing.heard(sighted, now_ns)
        may_move = verdict.may_move and self.robot not in self.supervisor.excluded
        targets = self.sensing.targets(own[0])
        view = View(now_ns * 1e-9, motion, sighted, heard, targets, self._start_direction, may_move)
        self._follow_orders(now_ns)
        if self.controller.paper is not None and not self._going_home:
            self.controller.think(view)
        if self._going_home:
            self.homing.aside = self.supervisor.aside
            decision = self.homing.decide(view, self._commanded)
        else:
            decision = self.controller.act(view)
        speed, turn = unicycle.body(decision.left_mps, decision.right_mps, self._separation_m)
        around = [
            record(Neighbour, (*seen[:5], heard[name][1] if name in heard else 0.0)) for name, seen in sighted.items()
        ]
        place: tuple[float, float, float] = pose
        limited = limit(speed, turn, place, (left, right), around, self._bounds)
        cut = limit_cut(limited.v_mps, limited.omega_radps, place, (left, right), around, self._cut_bounds)
        waits = cut.by or limited.by or decision.waits
        rims = (0.0, 0.0)
        if verdict.may_move and verdict.enable:
            rims = unicycle.rims(cut.v_mps, cut.omega_radps, self._separation_m, self._parameters.max_speed_mps)
        self._commanded = rims
        self._motion.command(*rims)
        self._drive = Drive(verdict.enable, rims[0] / self._radius_m, rims[1] / self._radius_m)
        self.pacing.stepped(now_ns)
        self._view, self._stepped = view, self._frame
        self._step_ns, self._write_ns, self._waits = now_ns, now_ns, waits
        return self._drive

    def tick(self, now_ns: int) -> Drive:
        """Failsafes and timers without a frame: keeps the last command, or zeroes it."""
        verdict = self._assess(now_ns)
        if not verdict.may_move or not verdict.enable:
            return self._rest(verdict)
        return self._drive

    def wrote(self, write_ns: int) -> None:
        """The bus write of the last step has returned."""
        self._write_ns = write_ns

    def think(self) -> None:
        """After a step's command is out: tasks and links for the next one, and the record of this one."""
        self._judge_motion()
        view, self._view = self._view, None
        if view is None:
            return
        if self.controller.paper is None and not self._going_home:
            self.controller.think(view)
        if self._stepped is not None and len(self._steps) < MAX_BATCH:
            self._steps.append(self._record(self._stepped))

    def outbox(self, now_ns: int) -> list[tuple[str, Message]]:
        """(key, message) due now. Thinks first, where a step has not been thought about yet."""
        self.think()
        out: list[tuple[str, Message]] = []
        own = self.sensing.own()
        if own is not None and now_ns >= self._next_state_ns:
            self._next_state_ns = self._due(self._next_state_ns, self.arena.control.state_period_s, now_ns)
            pose = self._odometry.predict(own[0], own[1], now_ns)
            left, right = self._odometry.rims
            motion = Motion(pose.x_m, pose.y_m, pose.heading_rad, left, right)
            state = self.controller.announce(motion, now_ns, *self._commanded)
            out.append((self._keys.state(self.robot), state))
        if self._verdict is not None and self._report_due(self._verdict, now_ns):
            out.append((self._keys.report(self.robot), self._report(now_ns, self._verdict)))
            if self._steps:
                out.append((self._keys.steps(self.robot), StepBatch(robot=self.robot, steps=tuple(self._steps))))
                self._steps = []
            self._tell_feedback(out)
        if self._on_stand:
            self._tell_feedback(out)
        out += [(self._keys.log(self.robot), entry) for entry in self._logs]
        self._logs = []
        return out

    # --- inside -------------------------------------------------------------------------------

    def _tell_feedback(self, out: list[tuple[str, Message]]) -> None:
        if self._samples:
            batch = FeedbackBatch(robot=self.robot, samples=tuple(self._samples))
            out.append((self._keys.feedback(self.robot), batch))
            self._samples = []

    def _on_frame(self, frame: MocapFrame, now_ns: int) -> bool:
        last = self._frame
        if last is not None and frame.session == last.session and frame.frame <= last.frame:
            self.refuse("frame not newer")
            self._advancing = now_ns - self._frame_arrival_ns <= STALL_NS
            return False
        if last is not None and frame.session != last.session:
            if frame.session in self._past_sessions or frame.publish_ns < last.publish_ns:
                self.refuse("frame of an earlier session")
                return False
            self._past_sessions.add(last.session)
        self._frame, self._frame_arrival_ns, self._advancing = frame, now_ns, True
        body = self.sensing.frame(frame)
        self._pose_valid = body is not None and body.valid
        self._pose_reason = "not in the frame" if body is None else body.reason
        self._look_at_motion(body, frame.exposure_ns)
        return self.pacing.frame(frame.session, frame.frame, frame.rate_hz)

    def _look_at_motion(self, body: BodyPose | None, stamp_ns: int) -> None:
        """Begin anew at once where the pose breaks off; a good one waits until :meth:`think`."""
        if body is None or not body.valid or body.resets != self._resets:
            self._resets = body.resets if body is not None else self._resets
            self._moved = None
            self._motion.forget()
        else:
            self._moved = (stamp_ns, body)

    def _judge_motion(self) -> None:
        moved, self._moved = self._moved, None
        if moved is not None and self._driver_active:
            stamp_ns, body = moved
            self._motion.pose(stamp_ns, Pose(body.x_m, body.y_m, body.heading_rad))

    def _counted(self) -> dict[str, int]:
        """Everything refused so far, by name."""
        found = dict(self.counters)
        if self.sensing.replayed:
            found["state replayed"] = self.sensing.replayed
        if self.supervisor.ignored_heartbeats:
            found["heartbeat replayed"] = self.supervisor.ignored_heartbeats
        return found

    def _on_targets(self, cloud: TargetCloud) -> None:
        """An earlier mission's targets are a replay; unknown ones wait until the station names their mission."""
        named = self.supervisor.mission
        if cloud.mission != named and cloud.mission in self._past_missions:
            self.refuse("targets of an earlier mission")
            return
        if cloud.mission != named and named and self.sensing.mission == named:
            self.refuse("targets ahead of their mission")
            self._waiting_targets = cloud
            return
        self._waiting_targets = None
        before = self.sensing.mission
        if self.sensing.cloud(cloud):
            self._past_missions.add(before)
            self.think()  # the last step's view is of the old mission
            self.controller.begin(cloud.mission)
        self._start_direction = cloud.start_direction_rad

    def _on_state(self, state: NeighbourState, now_ns: int) -> None:
        if state.robot == self.robot:
            if state.boot != self.boot:
                self._duplicate_ns = now_ns
            return
        if state.robot not in self.arena.robots:
            self.refuse("state of a robot that is not in the arena file")
        elif state.stamp_ns > now_ns + self._tolerance_ns:
            self.refuse("state ahead of its time")
        elif now_ns - state.stamp_ns > STATE_AGE_NS:
            self.refuse("state too old")
        elif self.sensing.state(state, now_ns) and not self._going_home:
            mine = tuple(message for message in state.mail if message.to == self.robot)
            self.controller.hear_mail(state.robot, mine, now_ns * 1e-9)

    def _assess(self, now_ns: int) -> Verdict:
        own = self.sensing.own()
        sample = self._feedback
        left, right = self._odometry.rims
        verdict = self.supervisor.assess(
            Conditions(
                pose_valid=self._pose_valid,
                pose_reason=self._pose_reason,
                pose_stamp_ns=own[1] if own else 0,
                pose_arrival_ns=self._frame_arrival_ns,
                frame_advancing=self._advancing,
                feedback_stamp_ns=sample.stamp_ns if sample else 0,
                driver_active=self._driver_active,
                driver_fault=self._driver_fault,
                driver_remedy=self._driver_remedy,
                left_mps=left,
                right_mps=right,
                loop_last_step_ns=self._loop_ns,
                inside_fence=own is None or inside_fence(self._bounds, own[0].x_m, own[0].y_m),
                duplicate_id=now_ns - self._duplicate_ns < DUPLICATE_WINDOW_NS,
                motion_fault=self._motion.text,
                battery_v=sample.bus_v if sample else None,
            ),
            now_ns,
        )
        self._loop_ns = now_ns
        self._verdict = verdict
        words = (verdict.run, verdict.reason)
        if words != self._last_words:
            self._last_words = words
            self._log(now_ns, "warning" if verdict.reason else "info", verdict.run, verdict.reason, verdict.remedy)
        return verdict

    def _follow_orders(self, now_ns: int) -> None:
        """The mission or the way home; from one to the other all links are released."""
        home = self.supervisor.homing and self.supervisor.state == "running"
        if home != self._going_home:
            self._going_home = home
            self.controller.release()
            self.homing.begin(now_ns * 1e-9)

    def _task(self) -> str:
        tasking = self.controller.tasking
        if self._going_home:
            return "home" if self.homing.arrived else "homing"
        return "helping" if tasking.helping else tasking.task.value

    def _rest(self, verdict: Verdict) -> Drive:
        self._commanded = (0.0, 0.0)
        self._motion.command(0.0, 0.0)
        self._drive = Drive(verdict.enable, 0.0, 0.0)
        return self._drive

    def _record(self, frame: MocapFrame) -> RobotStep:
        tasking = self.controller.tasking
        states = self.controller.link_states()
        if states is not self._link_states and states != self._link_states:
            self._link_states = states
            self._links = tuple(LinkState(other=name, state=state) for name, state in states.items())
        return RobotStep(
            robot=self.robot,
            frame=frame.frame,
            exposure_ns=frame.exposure_ns,
            step_ns=self._step_ns,
            write_ns=self._write_ns,
            left_radps=round(self._drive.left_radps, 5),
            right_radps=round(self._drive.right_radps, 5),
            links=self._links,
            task=self._task(),
            claim=-1 if tasking.claim is None else tasking.claim,
            waits=self._waits,
        )

    def _report_due(self, verdict: Verdict, now_ns: int) -> bool:
        """Whether it is time for a report, or something to acknowledge cannot wait for that."""
        said = (verdict.run, self.supervisor.order_id, self.supervisor.stop_id)
        if now_ns >= self._next_report_ns:
            self._next_report_ns = self._due(self._next_report_ns, REPORT_PERIOD_NS * 1e-9, now_ns)
        elif said == self._said:
            return False
        self._said = said
        return True

    def _report(self, now_ns: int, verdict: Verdict) -> RobotReport:
        own = self.sensing.own()
        tasking = self.controller.tasking
        links = self.controller.link_states()
        sample = self._feedback
        return RobotReport(
            robot=self.robot,
            boot=self.boot,
            stamp_ns=now_ns,
            schema_version=SCHEMA_VERSION,
            software=self._software,
            arena_hash=self._hash,
            run=verdict.run,
            reason=verdict.reason,
            remedy=verdict.remedy,
            order_id=self.supervisor.order_id,
            stop_id=self.supervisor.stop_id,
            stopped=verdict.at_rest and not verdict.may_move,
            pose_age_ms=round(min(1e9, (now_ns - own[1]) * 1e-6), 3) if own else 1e9,
            pose_valid=self._pose_valid,
            timing=self.pacing.timing(),
            battery_v=sample.bus_v if sample else None,
            motor_faults=sample.faults if sample and self._driver_fault else (),
            task=self._task(),
            claim=-1 if tasking.claim is None else tasking.claim,
            occupied_count=tasking.occupied_count,
            neighbours=tuple(sorted(self.sensing.sighted(own[0], now_ns))) if own else (),
            links_on=tuple(name for name, state in links.items() if state == "on"),
            links_kept=tuple(name for name, state in links.items() if state != "on"),
            counters=self._counted(),
        )

    def _log(self, now_ns: int, level: LogLevel, event: str, text: str, remedy: str = "") -> None:
        words = f"{text}; {remedy}" if remedy and text else text
        entry = LogEntry(stamp_ns=now_ns, level=level, source=self.robot, event=event, text=words)
        self._logs = [*self._logs[-15:], entry]

    @staticmethod
    def _due(last_ns: int, period_s: float, now_ns: int) -> int:
        period_ns = int(period_s * 1e9)
        return last_ns + period_ns if now_ns - last_ns < 4 * period_ns else now_ns + period_ns
