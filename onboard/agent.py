"""One robot's whole mind: messages, feedback and time in; wheel speeds and messages out. Pure.

Three feeders drive the same object: the runtime (real clock), ``simulate`` (lockstep) and ``replay``.
"""

import math
from typing import Final, NamedTuple

from contract.arena import Arena
from contract.keys import Keys
from contract.messages import (
    Message,
    MocapFrame,
    NeighbourState,
    RunState,
    StationHeartbeat,
    StopRequest,
    TargetCloud,
    WheelFeedback,
)
from onboard import unicycle
from onboard.account import Account, Drive, Outbox, next_ns
from onboard.ahdc.controller import Controller
from onboard.ahdc.parameters import from_arena
from onboard.ahdc.plan import Motion
from onboard.ahdc.view import View
from onboard.asked import Asked
from onboard.expected import slowest
from onboard.failsafes import Conditions
from onboard.guard import Guard
from onboard.homing import Home, Homing
from onboard.jump import MARGIN_SHARE, JumpCheck
from onboard.laws import installed_law
from onboard.motion import MotionCheck
from onboard.odometry import Odometry, Pose
from onboard.pacing import Pacing
from onboard.reception import Reception
from onboard.record import record
from onboard.safety import Supervisor, Verdict
from onboard.sensing import Sensing
from onboard.vitals import Vitals

MAX_RIM_MPS: Final = 20.0
"""A measured rim speed above this, or one that is not a number, is a fault of the telemetry."""

__all__ = ["Agent", "Drive"]


class Stepped(NamedTuple):
    """The last step, until it has been thought about."""

    view: View
    frame: MocapFrame | None
    now_ns: int
    waits: str


class Agent:
    """See the module. ``boot`` is a number never used before by this robot."""

    def __init__(self, arena: Arena, robot: str, boot: int, software: str = "") -> None:
        self.arena = arena
        self.robot = robot
        self.boot = boot
        self._radius_m = arena.platform.wheel_radius_m
        separation_m = arena.platform.wheel_separation_m
        self._guard = Guard(arena)
        self.supervisor = Supervisor(arena, robot)
        control, safety = arena.control, arena.safety
        plausible = (control.max_speed_mps, MARGIN_SHARE * safety.motion_way_m)
        self.sensing = Sensing(robot, control.sensing_radius_m, safety.neighbour_silence_s, *plausible)
        self.pacing = Pacing(arena.control.control_period_s, arena.mocap.frame_rate_hz)
        self.reception = Reception(arena, robot, boot)
        self._account = Account(arena, robot, boot, software, self.supervisor, self.sensing, self.pacing)
        self.counters = self._account.counters
        """Everything refused so far, by name."""
        parameters = from_arena(arena)
        law = installed_law(robot, parameters, arena.control.law, self.refuse)
        self.controller = Controller(robot, boot, parameters, self.pacing.period_s, unicycle.steer, unicycle.rims, law)
        entry = arena.robots[robot]
        self._on_stand = entry.emulate == ("body",)
        """Its virtual body rolls as the wheels say they turn, which is told at once."""
        home = Home(*entry.start, entry.heading_rad)
        self.homing = Homing(robot, home, parameters, self._guard.bounds, self.pacing.period_s)
        self._going_home = False
        self._odometry = Odometry(separation_m, silence_s=safety.driver_silence_s)
        self._motion = MotionCheck(arena.safety, separation_m, slowest(arena))
        self._jump = JumpCheck(arena.safety, separation_m)
        self._pose = (False, "never seen")
        """Whether the newest frame's own pose is valid, and why not."""
        self._start_direction = 0.0
        self._feedback: WheelFeedback | None = None
        self._driver_active = False
        self._driver_fault = ("", "")
        """What is wrong with the driver, and the remedy."""
        self._loop_ns = 0
        self._verdict: Verdict | None = None
        self._drive = Drive(False, 0.0, 0.0)
        self._asked = Asked()
        self._last: Stepped | None = None
        self._write_ns = 0
        self._state_key = Keys(arena.arena.name).state(robot)
        self._state_period_ns = int(arena.control.state_period_s * 1e9)
        self._next_state_ns = 0

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
                cloud = self.reception.waiting(self.supervisor.mission)
                if cloud is not None:
                    self._on_targets(cloud)
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
        self._account.refuse(counter)

    def feedback(self, sample: WheelFeedback, now_ns: int) -> None:
        """Take what the motor controller measured; speeds that cannot be are refused and count as silence."""
        left, right = sample.left_radps * self._radius_m, sample.right_radps * self._radius_m
        if not (-MAX_RIM_MPS <= left <= MAX_RIM_MPS and -MAX_RIM_MPS <= right <= MAX_RIM_MPS):
            self.refuse("feedback out of range")
            return
        self._feedback = sample
        self._odometry.record(sample.stamp_ns, left, right)
        self._asked.feedback(sample.stamp_ns)
        self._motion.feedback(sample.stamp_ns, left, right)
        self._jump.feedback(sample.stamp_ns, left, right)
        self._account.sample(sample)
        if sample.faults and not self._driver_fault[0]:
            self.driver_fault(
                f"motor controller reports {', '.join(sample.faults)}", "clear the cause, then arm", now_ns
            )

    def driver_fault(self, text: str, remedy: str, now_ns: int) -> None:
        """The driver lost its port or the controller reports a fault; empty text: repaired."""
        if text and text != self._driver_fault[0]:
            self._account.log(now_ns, "error", "driver_fault", text, remedy)
        self._driver_fault = (text, remedy)

    def driver_active(self, active: bool, now_ns: int) -> None:
        """The motors are enabled (the device has confirmed it) or not."""
        self._driver_active = active
        if not active:
            self._motion.forget()
            self._jump.forget()

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
        return Vitals(self.supervisor.state, reason, self.reception.frame_ns, feedback_ns)

    # --- the loop -----------------------------------------------------------------------------

    def step(self, now_ns: int) -> Drive:
        """Control step on the newest frame."""
        verdict = self._assess(now_ns)
        own = self.sensing.own()
        if own is None:
            return self._rest(verdict)
        x, y, heading = pose = self._odometry.predict(own[0], self.sensing.own_since_ns, now_ns)
        left, right = rims = self._odometry.rims
        motion = record(Motion, (x, y, heading, left, right))
        sighted = self.sensing.sighted(pose, now_ns, self.controller.linked)
        heard = self.sensing.heard(sighted, now_ns)
        may_move = verdict.may_move and self.robot not in self.supervisor.excluded
        targets = self.sensing.targets(own[0])
        left_places = self.sensing.left(now_ns, self.supervisor.excluded)
        now_s, start = now_ns * 1e-9, self._start_direction
        view = record(View, (now_s, motion, sighted, heard, targets, start, may_move, left_places))
        self._follow_orders(now_ns)
        if self.controller.paper is not None and not self._going_home:
            self.controller.think(view)
        if self._going_home:
            self.homing.aside = self.supervisor.aside
            decision = self.homing.decide(view, self._asked.latest)
        else:
            decision = self.controller.act(view)
        asked = self._asked.standing(now_ns)
        left, right, waits = self._guard.limited(decision, pose, rims, asked, sighted, heard, left_places)
        if not (verdict.may_move and verdict.enable):
            left = right = 0.0
        self._command(left, right)
        self._drive = record(Drive, (verdict.enable, left / self._radius_m, right / self._radius_m))
        self.pacing.stepped(now_ns)
        self._last = record(Stepped, (view, self.reception.frame, now_ns, waits))
        self._write_ns = now_ns
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
        self._motion.compare(self._driver_active)
        last, self._last = self._last, None
        if last is None:
            return
        view, frame, step_ns, waits = last
        self._guard.look_ahead(self.pacing.period_s)
        if self.controller.paper is None and not self._going_home:
            self.controller.think(view)
        if frame is not None:
            times_ns = (step_ns, self._write_ns)
            self._account.step(frame, times_ns, self._drive, waits, self._task(), self.controller)

    def outbox(self, now_ns: int) -> Outbox:
        """(key, message) due now. Thinks first, where a step has not been thought about yet."""
        self.think()
        account, own, verdict = self._account, self.sensing.own(), self._verdict
        out: Outbox = []
        if own is not None and now_ns >= self._next_state_ns:
            self._next_state_ns = next_ns(self._next_state_ns, self._state_period_ns, now_ns)
            pose = self._odometry.predict(own[0], self.sensing.own_since_ns, now_ns)
            out.append((self._state_key, self._announce(pose, now_ns)))
        if verdict is not None and account.report_due(verdict, now_ns):
            pose_valid, faulty, sample = self._pose[0], bool(self._driver_fault[0]), self._feedback
            out += account.report(now_ns, verdict, pose_valid, sample, faulty, self._task(), self.controller)
        if self._on_stand:
            out += account.feedback()
        return out + account.logs()

    # --- inside -------------------------------------------------------------------------------

    def _announce(self, pose: Pose, now_ns: int) -> NeighbourState:
        rims, asked, rolls_to = self._odometry.rims, self._asked, None
        standing = asked.standing(now_ns)
        if asked.silent(now_ns):
            rolls_to = self._guard.rolls_to(pose, rims, standing, asked.silence_s(now_ns))
        elif not self._drive.enable:
            rolls_to = self._guard.rolls_to(pose, rims, rims, math.inf)
        return self.controller.announce(Motion(*pose, *rims), now_ns, *asked.latest, standing, rolls_to)

    def _on_frame(self, frame: MocapFrame, now_ns: int) -> bool:
        refusal = self.reception.take_frame(frame, now_ns)
        if refusal:
            self.refuse(refusal)
            return False
        body = self.sensing.frame(frame, self.controller.linked)
        self._pose = (False, "not in the frame") if body is None else (body.valid, body.reason)
        self._motion.see(body, frame.exposure_ns)
        self._jump.see(body, frame.exposure_ns, self._driver_active)
        own = self.sensing.own()
        if own is not None and own[1] == frame.exposure_ns:
            self._odometry.seen(*own)
        return self.pacing.frame(frame.session, frame.frame, frame.rate_hz)

    def _on_targets(self, cloud: TargetCloud) -> None:
        known = self.sensing.mission
        refusal = self.reception.take_targets(cloud, self.supervisor.mission, known)
        if refusal:
            self.refuse(refusal)
            return
        if self.sensing.cloud(cloud):
            self.reception.retire(known)
            self.think()  # the last step's view is of the old mission
            self.controller.begin(cloud.mission)
        self._start_direction = cloud.start_direction_rad

    def _on_state(self, state: NeighbourState, now_ns: int) -> None:
        if state.robot == self.robot:
            self.reception.hear_own(state, now_ns)
            return
        refusal = self.reception.take_state(state, now_ns)
        if refusal:
            self.refuse(refusal)
        elif self.sensing.state(state, now_ns):
            self._guard.hear(state, (now_ns - state.stamp_ns) * 1e-9 + self.pacing.period_s / 2)
            if state.mail and not self._going_home:
                mine = tuple(message for message in state.mail if message.to == self.robot)
                self.controller.hear_mail(state.robot, mine, now_ns * 1e-9)

    def _assess(self, now_ns: int) -> Verdict:
        own, reception, sample = self.sensing.own(), self.reception, self._feedback
        left, right = self._odometry.rims
        (pose_valid, pose_reason), (fault, remedy) = self._pose, self._driver_fault
        verdict = self.supervisor.assess(
            Conditions(
                pose_valid=pose_valid,
                pose_reason=pose_reason,
                pose_stamp_ns=own[1] if own else 0,
                pose_arrival_ns=reception.frame_ns,
                frame_advancing=reception.advancing,
                feedback_stamp_ns=sample.stamp_ns if sample else 0,
                driver_active=self._driver_active,
                driver_fault=fault,
                driver_remedy=remedy,
                left_mps=left,
                right_mps=right,
                loop_last_step_ns=self._loop_ns,
                inside_fence=own is None or self._guard.inside_fence(own[0]),
                duplicate_id=reception.duplicate(now_ns),
                motion_fault=self._motion.text,
                jump=self._jump.text,
                battery_v=sample.bus_v if sample else None,
            ),
            now_ns,
        )
        self._loop_ns = now_ns
        released = self._verdict is not None and self._verdict.run == "disarmed"
        self._verdict = verdict
        if verdict.run == "disarmed":
            self.sensing.settle()
            self.controller.settle(self.sensing.beyond)
        elif released:
            self.controller.rejoin()
        obeyed = verdict.failsafe != "driver_silent" and not self._asked.silent(now_ns)
        self.controller.vouch(verdict.run != "fault" and obeyed)
        self._account.verdict(verdict, now_ns)
        return verdict

    def _follow_orders(self, now_ns: int) -> None:
        """The mission or the way home; from one to the other all links are released."""
        home = self.supervisor.homing and self.supervisor.state == "running"
        if home != self._going_home:
            self._going_home = home
            self.controller.release()
            self.homing.begin(now_ns * 1e-9)

    def _task(self) -> str:
        if self._going_home:
            return "home" if self.homing.arrived else "homing"
        tasking = self.controller.tasking
        return "helping" if tasking.helping else tasking.task.value

    def _rest(self, verdict: Verdict) -> Drive:
        self._command(0.0, 0.0)
        self._drive = Drive(verdict.enable, 0.0, 0.0)
        return self._drive

    def _command(self, left_mps: float, right_mps: float) -> None:
        self._asked.command(left_mps, right_mps)
        self._motion.command(left_mps, right_mps)
