"""The agent as a whole: paced by frames, deaf to far robots, still without leave, counting what it refuses."""

import math

import msgspec
import pytest

from contract.arena import digest
from contract.margins import cut_m
from contract.messages import (
    SCHEMA_VERSION,
    BodyPose,
    LogEntry,
    Message,
    MocapFrame,
    NeighbourState,
    Order,
    RobotReport,
    StationHeartbeat,
    StepBatch,
    StopRequest,
    Target,
    TargetCloud,
    WheelFeedback,
)
from onboard.agent import Agent, Drive
from onboard.courses import cut_bounds, cut_way
from onboard.foreseen import Foreseen
from onboard.pacing import Pacing
from tests.onboard.samples import arena, state

MS = 1_000_000
PERIOD_NS = 8_333_333


class Stage:
    """An agent, frames at 120 Hz around it, and everything it says."""

    def __init__(self, others: dict[str, tuple[float, float]] | None = None, profile: str = "field") -> None:
        self.arena = arena(profile)
        self.agent = Agent(self.arena, "r01", boot=7)
        self.others = others or {}
        self.now_ns = 1_000 * MS
        self.frame = 0
        self.order: Order = "disarm"
        self.order_id = 1
        self.beats = 0
        self.said: list[tuple[str, Message]] = []
        self.drives: list[Drive] = []
        self.agent.receive(TargetCloud(mission="m", targets=(Target(index=0, x_m=1.2, y_m=0.5),)), self.now_ns)

    def give(self, order: Order) -> None:
        self.order, self.order_id = order, self.order_id + 1

    def run(self, steps: int, valid: bool = True, beat: bool = True) -> None:
        for _ in range(steps):
            self.now_ns += PERIOD_NS
            self.frame += 1
            if beat:
                self.beats += 1
                self.agent.receive(self.heartbeat(), self.now_ns)
            self.agent.feedback(self.feedback(), self.now_ns)
            due = self.agent.receive(self.mocap(valid), self.now_ns)
            drive = self.agent.step(self.now_ns) if due else self.agent.tick(self.now_ns)
            self.agent.driver_active(drive.enable, self.now_ns)
            self.agent.wrote(self.now_ns)
            self.drives.append(drive)
            self.said += self.agent.outbox(self.now_ns)

    def mocap(self, valid: bool = True) -> MocapFrame:
        places = {"r01": (0.5, 0.5)} | self.others
        return MocapFrame(
            session=1,
            frame=self.frame,
            exposure_ns=self.now_ns - 2 * MS,
            transmit_ns=self.now_ns - 1 * MS,
            publish_ns=self.now_ns,
            rate_hz=120.0,
            bodies=tuple(
                BodyPose(robot=name, x_m=x, y_m=y, heading_rad=0.0, valid=valid or name != "r01")
                for name, (x, y) in places.items()
            ),
        )

    def heartbeat(self) -> StationHeartbeat:
        return StationHeartbeat(
            schema_version=SCHEMA_VERSION,
            boot=1,
            seq=self.beats,
            stamp_ns=self.now_ns,
            order=self.order,
            order_id=self.order_id,
            arena_hash=digest(self.arena),
        )

    def feedback(self) -> WheelFeedback:
        return WheelFeedback(
            robot="r01",
            stamp_ns=self.now_ns,
            left_radps=0.0,
            right_radps=0.0,
            left_rad=0.0,
            right_rad=0.0,
            enabled=True,
        )

    def start(self) -> None:
        self.run(5)
        self.give("arm")
        self.run(5)
        self.give("run")
        self.run(30)


@pytest.mark.parametrize("profile", ["field", "paper"])
def test_it_moves_towards_its_target_once_armed_and_started(profile: str) -> None:
    stage = Stage(profile=profile)
    stage.run(10)
    assert not any(drive.left_radps or drive.right_radps or drive.enable for drive in stage.drives)
    stage.start()
    assert stage.drives[-1].enable
    assert stage.drives[-1].left_radps > 0
    assert stage.drives[-1].right_radps > 0


def test_stop_zeroes_at_once_latches_and_release_does_not_resume() -> None:
    stage = Stage()
    stage.start()
    stage.agent.receive(StopRequest(stamp_ns=stage.now_ns, source="test", stop_id=9), stage.now_ns)
    drive = stage.agent.tick(stage.now_ns)
    assert (drive.left_radps, drive.right_radps) == (0.0, 0.0)
    stage.run(30)
    assert all((d.left_radps, d.right_radps) == (0.0, 0.0) for d in stage.drives[-30:])
    stage.give("disarm")
    stage.run(30)
    assert all((d.left_radps, d.right_radps) == (0.0, 0.0) for d in stage.drives[-30:])
    assert stage.agent.run_state == "disarmed"


def test_no_frame_no_motion() -> None:
    stage = Stage()
    stage.start()
    last = stage.now_ns
    while stage.now_ns < last + 400 * MS:
        stage.now_ns += 18 * MS
        stage.beats += 1
        stage.agent.receive(stage.heartbeat(), stage.now_ns)
        stage.agent.feedback(stage.feedback(), stage.now_ns)
        drive = stage.agent.tick(stage.now_ns)
        if stage.now_ns > last + int(stage.arena.safety.pose_silence_s * 1e9) + 20 * MS:
            assert (drive.left_radps, drive.right_radps) == (0.0, 0.0)


def test_an_invalid_own_pose_holds_and_clears_by_itself() -> None:
    stage = Stage()
    stage.start()
    stage.run(3, valid=False)
    assert (stage.drives[-1].left_radps, stage.drives[-1].right_radps) == (0.0, 0.0)
    assert stage.drives[-1].enable
    stage.run(20)
    assert stage.drives[-1].left_radps > 0


def test_an_own_pose_that_comes_back_elsewhere_is_not_driven_on_until_it_has_been_released() -> None:
    stage = Stage()
    stage.start()
    stage.run(3, valid=False)
    stage.others["r01"] = (0.55, 0.5)
    stage.run(2)
    assert stage.agent.run_state == "running"
    assert stage.drives[-1].left_radps > 0.0
    stage.run(3, valid=False)
    stage.others["r01"] = (0.8, 0.5)
    before = len(stage.drives)
    stage.run(20)
    assert stage.agent.run_state == "fault"
    assert all(drive.left_radps == 0.0 == drive.right_radps for drive in stage.drives[before:])
    assert stage.agent.verdict is not None
    assert stage.agent.verdict.failsafe == "pose_jumped"
    assert "0.25 m away" in stage.agent.verdict.reason
    stage.run(100)
    stage.start()
    assert stage.agent.run_state == "fault", "orders do not end it"
    stage.give("disarm")
    stage.run(5)
    stage.start()
    assert stage.agent.run_state == "running"


def test_where_a_neighbour_was_before_it_jumped_is_kept_clear_until_this_robot_is_released() -> None:
    stage = Stage({"r02": (0.75, 0.5)})
    stage.start()
    stage.others.clear()
    stage.run(15)
    stage.others["r02"] = (0.75, 0.9)
    held = len(stage.drives)
    stage.run(100)
    platform, safety = stage.arena.platform, stage.arena.safety
    radius_m = platform.wheel_radius_m
    fastest_mps = max(max(drive[1:]) for drive in stage.drives[held:]) * radius_m
    cut = cut_m(fastest_mps, safety.watchdog_s, platform.coast_deceleration_mps2)
    assert 0.0 < cut <= 0.25 - platform.diameter_m + 0.05
    stage.give("disarm")
    stage.run(5)
    stage.start()
    assert max(max(drive[1:]) for drive in stage.drives[-20:]) * radius_m > fastest_mps


def test_a_far_robot_changes_nothing() -> None:
    near, far = Stage({"r02": (3.5, 4.5)}), Stage({"r02": (2.6, 3.1)})
    for stage, place in ((near, (3.5, 4.5)), (far, (2.6, 3.1))):
        stage.start()
        for seq in range(1, 20):
            message = state("r02", *place, seq=seq, claim=0, claim_at=(1.2, 0.5), occupied="1", cloud_seen=True)
            stage.agent.receive(message, stage.now_ns)
            stage.run(1)
    assert near.drives == far.drives
    texts = [[m for _, m in stage.said if isinstance(m, NeighbourState | StepBatch)] for stage in (near, far)]
    assert texts[0] == texts[1]


def test_a_frame_that_is_not_newer_is_counted_and_not_stepped_on() -> None:
    stage = Stage()
    stage.start()
    frame = stage.mocap()
    assert not stage.agent.receive(frame, stage.now_ns)
    assert stage.agent.counters["frame not newer"] == 1


def test_repeated_frames_hold_only_where_no_new_one_comes_in_between() -> None:
    stage = Stage()
    stage.start()
    for _ in range(20):
        stage.agent.receive(stage.mocap(), stage.now_ns)
        assert stage.agent.tick(stage.now_ns) == stage.drives[-1]
        stage.run(1)
    for after_ms, held in ((50, False), (51, True)):
        frame = stage.mocap()
        stage.agent.receive(frame, stage.now_ns + after_ms * MS)
        verdict = stage.agent.verdict if stage.agent.tick(stage.now_ns + after_ms * MS) else None
        assert verdict is not None
        assert (verdict.failsafe == "pose_frozen") == held


def test_its_own_id_from_another_boot_is_a_fault() -> None:
    stage = Stage()
    stage.start()
    stage.agent.receive(state("r01", boot=8), stage.now_ns)
    stage.run(2)
    assert stage.agent.run_state == "fault"
    assert (stage.drives[-1].left_radps, stage.drives[-1].right_radps) == (0.0, 0.0)


def test_it_reports_ten_times_a_second_with_everything_a_person_needs() -> None:
    stage = Stage()
    stage.run(120)
    reports = [m for _, m in stage.said if isinstance(m, RobotReport)]
    assert 9 <= len(reports) <= 11
    last = reports[-1]
    assert last.arena_hash == digest(stage.arena)
    assert last.timing is not None
    assert last.timing.rate_hz == pytest.approx(last.timing.nominal_hz, rel=1e-3)
    assert last.pose_age_ms == pytest.approx(2.0)


@pytest.mark.parametrize(("what", "run"), [("stop", "stopped"), ("order", "holding"), ("fault", "fault")])
def test_an_acknowledgement_does_not_wait_for_the_next_report(what: str, run: str) -> None:
    stage = Stage()
    stage.start()
    while not any(isinstance(m, RobotReport) for _, m in stage.said[-4:]):
        stage.run(1)
    if what == "stop":
        stage.agent.receive(StopRequest(stamp_ns=stage.now_ns, source="test", stop_id=9), stage.now_ns)
    elif what == "order":
        stage.give("hold")
        stage.beats += 1
        stage.agent.receive(stage.heartbeat(), stage.now_ns)
    else:
        stage.agent.driver_fault("port gone", "plug it in", stage.now_ns)
    stage.agent.tick(stage.now_ns)
    said = [[m for _, m in stage.agent.outbox(stage.now_ns) if isinstance(m, RobotReport)] for _ in range(2)]
    assert [len(reports) for reports in said] == [1, 0], "at once, and once"
    acknowledged = said[0][0]
    assert (acknowledged.run, acknowledged.order_id) == (run, stage.order_id)
    assert acknowledged.stop_id == (9 if what == "stop" else 0)


def test_motor_faults_are_reported_until_they_are_cleared_although_no_telemetry_comes_after_that() -> None:
    stage = Stage()
    stage.run(5)
    sample = msgspec.structs.replace(stage.feedback(), stamp_ns=stage.now_ns + 1, faults=("main battery low",))

    def reported() -> RobotReport:
        stage.now_ns += 200 * MS
        return [m for _, m in stage.agent.outbox(stage.now_ns) if isinstance(m, RobotReport)][-1]

    stage.agent.feedback(sample, stage.now_ns)
    assert reported().motor_faults == ("main battery low",)
    stage.agent.driver_fault("", "", stage.now_ns)
    assert reported().motor_faults == ()


def test_states_go_out_at_the_state_period() -> None:
    stage = Stage()
    stage.run(120)
    states = [m for _, m in stage.said if isinstance(m, NeighbourState)]
    expected = 120 * PERIOD_NS * 1e-9 / stage.arena.control.state_period_s
    assert len(states) == pytest.approx(expected, abs=3)
    assert [s.seq for s in states] == list(range(1, len(states) + 1))


def test_not_finite_feedback_moves_nothing() -> None:
    stage = Stage()
    stage.start()
    bad = WheelFeedback(
        robot="r01", stamp_ns=stage.now_ns + 1, left_radps=math.nan, right_radps=math.nan, left_rad=0.0, right_rad=0.0
    )
    stage.agent.feedback(bad, stage.now_ns)
    drive = stage.agent.step(stage.now_ns)
    assert math.isfinite(drive.left_radps)
    assert math.isfinite(drive.right_radps)


@pytest.mark.parametrize(("rate_hz", "divisor"), [(60, 1), (100, 1), (120, 1), (180, 2), (240, 2), (360, 4)])
def test_pacing_steps_on_every_kth_frame(rate_hz: int, divisor: int) -> None:
    pacing = Pacing(0.01, rate_hz)
    assert pacing.divisor == divisor
    due = [pacing.frame(1, k, rate_hz) for k in range(1, 121)]
    assert sum(due[1:]) == pytest.approx(120 / divisor, abs=1)
    assert pacing.misses == 0


def test_pacing_counts_lost_frames_and_steps_on_the_next() -> None:
    pacing = Pacing(0.01, 120.0)
    assert pacing.frame(1, 10, 120.0)
    assert pacing.frame(1, 13, 120.0)
    assert pacing.misses == 2
    assert not pacing.frame(1, 13, 120.0)
    assert pacing.frame(2, 1, 120.0)


def test_a_new_mission_forgets_the_occupied_targets_and_a_late_neighbour_does_not_bring_them_back() -> None:
    stage = Stage({"r02": (0.9, 0.5)})

    def occupied() -> str:
        return [m.occupied for _, m in stage.said if isinstance(m, NeighbourState)][-1]

    def hear(seq: int, mission: str) -> None:
        message = state("r02", 0.9, 0.5, seq=seq, mission=mission, occupied="1")
        stage.agent.receive(message, stage.now_ns)
        stage.run(12)

    stage.run(5)
    hear(1, "m")
    assert occupied() == "1"
    stage.agent.receive(TargetCloud(mission="m", targets=(Target(index=0, x_m=1.2, y_m=0.5),)), stage.now_ns)
    stage.run(12)
    assert occupied() == "1", "the same mission told again"
    stage.agent.receive(TargetCloud(mission="n", targets=(Target(index=0, x_m=1.2, y_m=0.5),)), stage.now_ns)
    stage.run(12)
    assert occupied() == ""
    hear(2, "m")
    assert occupied() == ""
    hear(3, "n")
    assert occupied() == "1"


def test_a_new_mission_between_a_step_and_its_thoughts_leaves_nothing_of_the_old_one() -> None:
    stage = Stage({"r02": (0.9, 0.5)})
    stage.run(5)
    stage.agent.receive(state("r02", 0.9, 0.5, seq=1, mission="m", occupied="1"), stage.now_ns)
    stage.now_ns += PERIOD_NS
    stage.frame += 1
    assert stage.agent.receive(stage.mocap(), stage.now_ns)
    stage.agent.step(stage.now_ns)
    stage.agent.receive(TargetCloud(mission="n", targets=(Target(index=0, x_m=1.2, y_m=0.5),)), stage.now_ns)
    stage.agent.outbox(stage.now_ns)
    stage.run(12)
    told = [message for _, message in stage.said if isinstance(message, NeighbourState)]
    assert [message.occupied for message in told if message.mission == "n"][-1] == ""


def test_towards_a_robot_at_rest_it_goes_no_faster_than_a_cut_allows() -> None:
    stage = Stage({"r02": (0.9, 0.5)})
    stage.agent.receive(TargetCloud(mission="n", targets=(Target(index=0, x_m=1.4, y_m=0.5),)), stage.now_ns)
    stage.start()
    alone = Stage()
    alone.agent.receive(TargetCloud(mission="n", targets=(Target(index=0, x_m=1.4, y_m=0.5),)), alone.now_ns)
    alone.start()
    radius_m = stage.arena.platform.wheel_radius_m
    fastest = max(max(drive.left_radps, drive.right_radps) for drive in stage.drives) * radius_m
    assert fastest < max(max(drive.left_radps, drive.right_radps) for drive in alone.drives) * radius_m
    bounds = cut_bounds(stage.arena)
    way = cut_way((0.0, 0.0, 0.0, 0.0, 0.0), fastest, fastest, bounds.standing_s, bounds)
    assert max(x for x, _ in way) <= 0.4 - bounds.contact_m + 2e-3


def test_what_a_neighbour_may_do_is_worked_out_when_it_is_heard_and_after_a_command(monkeypatch) -> None:
    stage = Stage({"r02": (0.95, 0.75)})
    stage.start()
    busy: list[str] = []
    worked_out: list[str] = []

    def noted(owner: object, name: str, during: str) -> None:
        call = getattr(owner, name)

        def tell(*args):
            busy.append(during)
            try:
                return call(*args)
            finally:
                busy.pop()

        monkeypatch.setattr(owner, name, tell)

    for name, during in (("step", "step"), ("receive", "message"), ("think", "thought")):
        noted(stage.agent, name, during)
    for name in ("_brake", "_come"):
        way = getattr(Foreseen, name)
        monkeypatch.setattr(Foreseen, name, lambda self, way=way: worked_out.append(busy[-1]) or way(self))
    for seq in range(1, 13):
        says = {"mission": "m", "rims_mps": (0.3, 0.3), "asked_mps": (0.3, 0.3), "heading_rad": math.pi}
        stamp_ns = stage.now_ns - 8 * MS
        stage.agent.receive(state("r02", 0.95 + seq * 1e-4, 0.75, seq=seq, stamp_ns=stamp_ns, **says), stage.now_ns)
        stage.run(5)
    assert worked_out.count("step") == 1, worked_out
    assert worked_out.count("message") == 11
    assert worked_out.count("thought") >= 11


def test_a_cause_that_lasts_is_logged_once_however_its_number_runs_on() -> None:
    stage = Stage()
    stage.start()
    stage.said.clear()
    for _ in range(100):
        stage.now_ns += 10 * MS
        stage.beats += 1
        stage.agent.receive(stage.heartbeat(), stage.now_ns)
        stage.agent.feedback(stage.feedback(), stage.now_ns)
        stage.agent.tick(stage.now_ns)
        stage.said += stage.agent.outbox(stage.now_ns)
    told = {message.reason for _, message in stage.said if isinstance(message, RobotReport) and message.reason}
    assert len(told) > 5, "reports say how long it has lasted"
    logged = [message for _, message in stage.said if isinstance(message, LogEntry)]
    assert [entry.text.partition(":")[0] for entry in logged] == [
        "the newest own pose is too old at mid-exposure",
        "no pose frame arrives",
    ]
    stage.run(5)
    assert [message.event for _, message in stage.said if isinstance(message, LogEntry)][-1] == "running"
