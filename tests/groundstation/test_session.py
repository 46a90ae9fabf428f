"""The station's session: what it waits for, whom it orders what, and how it ends."""

from itertools import pairwise

import pytest

from contract.arena import Arena, digest, parse
from contract.messages import (
    SCHEMA_VERSION,
    BodyPose,
    MocapFrame,
    NeighbourState,
    OrderRequest,
    RobotReport,
    StopRequest,
    Target,
    TargetCloud,
)
from groundstation.course import Plan
from groundstation.session import Session

MS = 1_000_000
NAMES = ("r06", "r08")


def arena() -> Arena:
    robots = {n: {"body": n, "start": [1.0 + i, 1.0], "wheels": {"kind": "odrive"}} for i, n in enumerate(NAMES)}
    return parse({"arena": {"name": "lab", "size_m": [4.0, 5.0]}, "robots": robots}, "test")


ARENA = arena()
HASH = digest(ARENA)
AUTOMATIC = Plan(automatic=True)
CLOUD = TargetCloud(mission="m", targets=tuple(Target(index=k, x_m=2.0, y_m=2.0) for k in (0, 1, 7)))


class Swarm:
    """Robots that obey, each with changes of its own, and a clock."""

    def __init__(self, plan: Plan = AUTOMATIC, x: tuple[float, ...] = (1.0, 1.8)) -> None:
        self.now = 10_000 * MS
        self.session = Session(ARENA, CLOUD, 3, plan, self.now)
        self.x = x
        self.state = dict.fromkeys(NAMES, "disarmed")
        self.changes: dict[str, dict[str, object]] = {name: {} for name in NAMES}
        self.silent: set[str] = set()
        self.frames = True
        self.obedient = True
        self.seen_order = 0

    def report(self, name: str) -> None:
        if name in self.silent:
            return
        fields: dict[str, object] = {
            "robot": name,
            "boot": 1,
            "stamp_ns": self.now,
            "schema_version": SCHEMA_VERSION,
            "arena_hash": HASH,
            "pose_valid": True,
            "run": self.state[name],
            **self.changes[name],
        }
        self.session.receive(RobotReport(**fields), self.now)

    def frame(self) -> MocapFrame:
        bodies = tuple(BodyPose(robot=n, x_m=x, y_m=1.0, heading_rad=0.0) for n, x in zip(NAMES, self.x, strict=True))
        return MocapFrame(session=1, frame=1, exposure_ns=0, transmit_ns=0, publish_ns=0, rate_hz=120.0, bodies=bodies)

    def turn(self, times: int = 1) -> str:
        for _ in range(times):
            self.now += 50 * MS
            if self.frames:
                self.session.receive(self.frame(), self.now)
            for name in NAMES:
                self.report(name)
            self.session.advance(self.now)
            beat = self.session.heartbeat(self.now)
            if self.obedient and beat.order_id != self.seen_order:
                self.seen_order = beat.order_id
                after = {"arm": "armed", "run": "running", "hold": "holding", "disarm": "disarmed", "stop": "stopped"}
                self.state = dict.fromkeys(NAMES, after[beat.order])
        return self.session.phase

    def occupy(self, bitmap: str) -> None:
        state = NeighbourState(
            robot="r06", boot=1, seq=1, stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, vx_mps=0.0, vy_mps=0.0,
            stop_long=(0.0, 0.0), stop_short=(0.0, 0.0), mission=self.session.cloud.mission, occupied=bitmap,
        )  # fmt: skip
        self.session.receive(state, self.now)


def test_a_mission_from_waiting_to_completed() -> None:
    swarm = Swarm()
    phases = [swarm.turn() for _ in range(6)]
    assert phases[-1] == "running"
    assert [p for k, p in enumerate(phases) if p not in phases[:k]] == ["ready", "armed", "running"]
    swarm.occupy("81")
    assert swarm.turn() == "running"
    swarm.occupy("2")
    assert swarm.turn() == "completed"
    assert swarm.session.occupied == (0, 7, 1)
    assert swarm.session.heartbeat(swarm.now).order == "disarm"
    status = swarm.session.status(swarm.now)
    assert (status.phase, status.targets, status.components) == ("completed", 3, 1)
    assert status.lambda2 == pytest.approx(2.0)
    assert status.min_distance_m == pytest.approx(0.8)


def test_what_the_robots_say_is_occupied_stays_so_when_they_are_disarmed() -> None:
    swarm = Swarm()
    swarm.turn(5)
    swarm.occupy("81")
    swarm.session.order("disarm", swarm.now)
    assert swarm.session.occupied == (0, 7), "at once, not when they next say so"
    assert swarm.session.elapsed_s(swarm.now) == 0.0
    swarm.occupy("80")
    assert swarm.session.occupied == (7,), "a robot that has begun anew has forgotten the others"
    swarm.session.order("repeat", swarm.now)
    assert swarm.session.occupied == ()


def test_nothing_said_after_the_start_takes_an_occupied_target_back() -> None:
    swarm = Swarm()
    swarm.turn(6)
    swarm.occupy("81")
    swarm.occupy("2")
    assert swarm.session.occupied == (0, 7, 1)


def test_occupied_bits_that_are_no_targets_or_no_bitmap_do_not_count() -> None:
    swarm = Swarm()
    swarm.turn(5)
    swarm.occupy("7c")
    swarm.occupy("not hexadecimal")
    swarm.turn()
    assert swarm.session.occupied == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arena_hash": "0" * 12}, "r08 has another arena file"),
        ({"schema_version": 99}, "r08 speaks schema 99"),
        ({"pose_valid": False}, "r08 has no valid pose"),
        ({"run": "stopped"}, "r08 is stopped"),
        ({"reason": "driver: port gone"}, "r08: driver: port gone"),
    ],
)
def test_it_waits_and_says_for_what(change: dict[str, object], words: str) -> None:
    swarm = Swarm()
    swarm.changes["r08"] = change
    assert swarm.turn(5) == "waiting"
    assert words in swarm.session.detail
    assert swarm.session.heartbeat(swarm.now).order == "disarm"
    swarm.changes["r08"] = {}
    assert swarm.turn(5) == "running"


def test_it_waits_for_every_robot_and_for_a_swarm_in_one_piece() -> None:
    swarm = Swarm()
    swarm.silent = {"r06"}
    assert swarm.turn(5) == "waiting"
    assert swarm.session.detail == "r06 does not report"
    apart = Swarm(x=(1.0, 2.1))
    assert apart.turn(5) == "waiting"
    assert "2 pieces" in apart.session.detail


def test_a_robot_that_does_not_arm_fails_the_session_by_name() -> None:
    swarm = Swarm()
    swarm.obedient = False
    swarm.turn(60)
    assert swarm.session.phase in ("waiting", "ready")
    assert swarm.turn(60) == "failed"
    assert "r06" in swarm.session.detail
    assert "r08" in swarm.session.detail


def test_time_runs_out() -> None:
    swarm = Swarm(Plan(automatic=True, timeout_s=1.0))
    swarm.turn(5)
    swarm.occupy("1")
    assert swarm.turn(30) == "failed"
    assert "2 of 3 targets left" in swarm.session.detail
    assert swarm.session.heartbeat(swarm.now).order == "stop"
    never = Swarm(Plan(automatic=True, ready_timeout_s=1.0))
    never.silent = set(NAMES)
    assert never.turn(30) == "failed"
    assert "not ready in 1 s" in never.session.detail


@pytest.mark.parametrize("state", ["fault", "stopped"])
def test_a_robot_in_fault_or_stopped_stops_all(state: str) -> None:
    swarm = Swarm()
    swarm.turn(5)
    swarm.changes["r08"] = {"run": state, "reason": "motor on fire"}
    assert swarm.turn() == {"fault": "failed", "stopped": "stopped"}[state]
    assert "r08" in swarm.session.detail
    assert "motor on fire" in swarm.session.detail
    assert swarm.session.heartbeat(swarm.now).order == "stop"


@pytest.mark.parametrize("turns", [0, 1, 2, 6])
def test_a_stop_request_latches_in_every_phase(turns: int) -> None:
    swarm = Swarm()
    swarm.turn(turns)
    swarm.session.receive(StopRequest(stamp_ns=0, source="somebody", stop_id=1), swarm.now)
    assert swarm.turn(5) == "stopped"
    assert "somebody" in swarm.session.detail
    for order in ("arm", "run", "hold"):
        swarm.session.order(order, swarm.now)
        assert swarm.turn(3) == "stopped"
        assert swarm.session.heartbeat(swarm.now).order == "stop"
    swarm.session.order("disarm", swarm.now)
    assert swarm.turn(5) == "ready", "released, and not armed by itself"
    assert swarm.session.heartbeat(swarm.now).order == "disarm"


def test_stop_after_the_end_still_stops() -> None:
    swarm = Swarm()
    swarm.turn(6)
    swarm.occupy("83")
    assert swarm.turn() == "completed"
    swarm.session.receive(StopRequest(stamp_ns=0, source="somebody", stop_id=1), swarm.now)
    assert swarm.session.heartbeat(swarm.now).order == "stop"


def test_an_operator_takes_it_through_step_by_step() -> None:
    swarm = Swarm(Plan())
    number = iter(range(1, 99))

    def ask(order: str) -> str:
        request = OrderRequest(stamp_ns=0, source="x", number=next(number), order=order)
        swarm.session.receive(request, swarm.now)
        swarm.session.receive(request, swarm.now)
        return swarm.turn(3)

    assert swarm.turn(5) == "ready"
    assert ask("run") == "ready"
    assert "run refused while ready" in swarm.session.detail or swarm.session.phase == "ready"
    assert ask("arm") == "armed"
    assert ask("run") == "running"
    before = swarm.session.heartbeat(swarm.now).order_id
    assert ask("hold") == "running"
    assert swarm.state["r06"] == "holding"
    assert ask("run") == "running"
    assert swarm.session.heartbeat(swarm.now).order_id == before + 2, "a repeated request is one order"
    assert ask("disarm") == "ready"


def test_it_is_not_ready_again_before_every_robot_has_obeyed_the_release() -> None:
    swarm = Swarm()
    swarm.turn(5)
    swarm.obedient = False
    swarm.occupy("83")
    assert swarm.turn() == "completed"
    swarm.session.order("disarm", swarm.now)
    assert swarm.turn(3) == "waiting"
    assert "r06 is running; release it (disarm)" in swarm.session.detail
    swarm.obedient = True
    assert swarm.turn(3) == "ready"


def test_new_targets_have_to_reach_the_robots_before_it_is_ready_again() -> None:
    swarm = Swarm(Plan())
    assert swarm.turn(3) == "ready"
    swarm.session.seed(CLOUD)
    assert swarm.session.phase == "ready", "the same targets change nothing"
    swarm.session.seed(TargetCloud(mission="n", targets=CLOUD.targets))
    assert swarm.session.phase == "waiting"
    swarm.session.order("arm", swarm.now)
    assert swarm.session.heartbeat(swarm.now).order == "disarm"
    assert swarm.turn(2) == "ready"


def test_order_ids_only_rise_and_heartbeats_count() -> None:
    swarm = Swarm()
    beats = []
    for turn in range(12):
        if turn == 8:
            swarm.session.order("stop", swarm.now)
        swarm.turn()
        beats.append(swarm.session.heartbeat(swarm.now))
    assert [beat.order_id for beat in beats] == sorted(beat.order_id for beat in beats)
    assert all(a.seq < b.seq for a, b in pairwise(beats))
    assert {beat.boot for beat in beats} == {3}
    assert {beat.arena_hash for beat in beats} == {HASH}
