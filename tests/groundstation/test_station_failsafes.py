"""The station's failsafes, row by row through a session; a quorum, and who joins late."""

from collections.abc import Callable
from pathlib import Path

import pytest

from contract.messages import MocapHealth
from groundstation.course import Plan
from groundstation.failsafes import OVERRIDABLE, STATION_FAILSAFES, Facts, StationFailsafe, markdown
from groundstation.preflight import SAID_ELSEWHERE, Fleet, preflight
from tests.groundstation.test_session import ARENA, NAMES, Swarm

SAFETY = ARENA.safety


def change(**fields: object) -> Callable[[Swarm], None]:
    return lambda swarm: swarm.changes["r08"].update(fields)


def stamped(seconds: float) -> Callable[[Swarm], None]:
    """Reports of r08 stamped that much before they arrive."""

    def apply(swarm: Swarm) -> None:
        swarm.offset_ns = int(seconds * 1e9)

    return apply


def hush(swarm: Swarm) -> None:
    swarm.silent = {"r08"}
    swarm.now += int(SAFETY.report_silence_s * 1e9)


def blind(swarm: Swarm) -> None:
    swarm.frames = False
    swarm.now += int(SAFETY.report_silence_s * 1e9)


def apart(swarm: Swarm) -> None:
    swarm.x = (1.0, 2.1)


def disk(free_mb: float) -> Callable[[Swarm], None]:
    def apply(swarm: Swarm) -> None:
        swarm.session.disk_free_mb = free_mb

    return apply


def software(swarm: Swarm) -> None:
    swarm.changes["r06"]["software"] = "1.0"
    swarm.changes["r08"]["software"] = "1.1"


Step = Callable[[Swarm], None]
CASES: dict[str, tuple[Step, Step, str]] = {
    "robot_restarted": (change(boot=2), change(boot=1), "r08 has restarted (boot 2, armed as 1)"),
    "robot_differs": (change(arena_hash="0" * 12), change(), "r08 has another arena file"),
    "clock_ahead": (
        stamped(-SAFETY.clock_tolerance_s - 0.001),
        stamped(-SAFETY.clock_tolerance_s),
        "r08's clock is 21 ms ahead",
    ),
    "clock_behind": (
        stamped(SAFETY.report_age_s + 0.001),
        stamped(SAFETY.report_age_s),
        "r08's reports are 301 ms old",
    ),
    "robot_silent": (hush, change(), "r08"),
    "poses_silent": (blind, change(), "no pose frames"),
    "swarm_split": (apart, change(), "2 pieces"),
    "disk_low": (disk(SAFETY.min_disk_mb - 1), disk(SAFETY.min_disk_mb), "199 MB free for the recording"),
    "software_differs": (software, change(software="1.0"), "software differs (1.0: r06; 1.1: r08)"),
}
ROWS = {row.name: row for row in STATION_FAILSAFES}


def ill(state: str) -> Step:
    def apply(swarm: Swarm) -> None:
        swarm.session.receive(MocapHealth(stamp_ns=swarm.now, state=state, detail="no camera answers"), swarm.now)

    return apply


def near(swarm: Swarm) -> None:
    swarm.x = (1.0, 1.0 + SAFETY.min_distance_m - 0.01)


CHECKS: dict[str, tuple[Step, str]] = {
    "mocap": (ill("lost"), "mocap: lost"),
    "room": (near, "r08: nearest robot at 0.14 m"),
    "motors": (change(motor_faults=("over temperature",)), "r08: over temperature"),
}
"""What the pre-flight list refuses besides."""


class Stage(Swarm):
    """A swarm whose clocks, cameras and network can be spoilt."""

    def __init__(self, plan: Plan | None = None) -> None:
        super().__init__(Plan(automatic=True) if plan is None else plan)
        self.offset_ns = 0

    def report(self, name: str) -> None:
        self.changes[name]["stamp_ns"] = self.now - (self.offset_ns if name == "r08" else 0)
        super().report(name)


def check_before_the_start(row: StationFailsafe) -> None:
    spoil, fine, words = CASES[row.name]
    stage = Stage()
    fine(stage)
    assert stage.turn(6) == "running", stage.session.detail
    stage = Stage()
    stage.turn(0)
    spoil(stage)
    assert stage.turn(6) == ("waiting" if row.refuses else "running")
    assert not row.refuses or words in stage.session.detail


def check_with_power_on(row: StationFailsafe) -> None:
    spoil, fine, words = CASES[row.name]
    stage = Stage()
    stage.turn(6)
    fine(stage)
    assert stage.turn(2) == "running", stage.session.detail
    assert stage.session.detail == ""
    spoil(stage)
    stopped = row.action == "stop"
    assert stage.turn() == ("failed" if stopped else "running")
    assert words in stage.session.detail
    assert stage.session.heartbeat(stage.now).order == ("stop" if stopped else "run")


def test_every_row_has_a_case() -> None:
    assert CASES.keys() == ROWS.keys()


@pytest.mark.parametrize("name", CASES)
def test_before_the_start(name: str) -> None:
    check_before_the_start(ROWS[name])


@pytest.mark.parametrize("name", CASES)
def test_with_power_on(name: str) -> None:
    check_with_power_on(ROWS[name])


@pytest.mark.parametrize("name", CASES)
def test_a_row_without_its_threshold_is_found_out(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = tuple(row._replace(tripped=lambda facts: "") if row.name == name else row for row in STATION_FAILSAFES)
    monkeypatch.setattr("groundstation.failsafes.STATION_FAILSAFES", rows)
    with pytest.raises(AssertionError):
        check_with_power_on(ROWS[name])


@pytest.mark.parametrize("name", OVERRIDABLE)
def test_a_named_override_lets_it_start(name: str) -> None:
    stage = Stage(Plan(automatic=True, overrides=(name,)))
    (CASES[name] if name in CASES else CHECKS[name])[0](stage)
    assert stage.turn(6) == "running", stage.session.detail


@pytest.mark.parametrize("name", CHECKS)
def test_what_the_doctor_fails_refuses_the_start(name: str) -> None:
    spoil, words = CHECKS[name]
    others = tuple(other for other in OVERRIDABLE if other != name)
    stage = Stage(Plan(automatic=True, overrides=others))
    spoil(stage)
    assert stage.turn(6) == "waiting"
    assert words in stage.session.detail


def test_a_warning_of_the_doctor_refuses_nothing() -> None:
    stage = Stage()
    ill("degraded")(stage)
    assert stage.turn(6) == "running", stage.session.detail


def test_every_check_of_the_doctor_is_looked_at_before_the_start() -> None:
    stage = Stage()
    stage.turn(2)
    fleet = Fleet(stage.session.facts(stage.now), {}, None, None)
    assert {result.name for result in preflight(fleet)} - set(SAID_ELSEWHERE) == {
        "margins", "link", "battery thresholds", "mocap", "station", "motors", "room"
    }  # fmt: skip


def test_the_rest_is_started_with_a_quorum_and_the_late_robot_joins() -> None:
    stage = Stage(Plan(automatic=True, quorum=1))
    stage.silent = {"r08"}
    assert stage.turn(90) == "waiting", "the others have their time"
    assert stage.turn(30) == "running"
    assert stage.session.missing == ("r08",)
    assert "without r08" in stage.session.detail
    stage.silent = set()
    stage.state["r08"] = "disarmed"
    orders = []
    stage.obedient = False
    for _ in range(12):
        stage.turn()
        beat = stage.session.heartbeat(stage.now)
        orders.append((beat.order, beat.robots))
        if beat.robots == ("r08",) and beat.order == "arm":
            stage.state["r08"] = "armed"
        elif beat.order == "run" and stage.state["r08"] == "armed":
            stage.state["r08"] = "running"
    assert ("arm", ("r08",)) in orders
    assert orders[-1] == ("run", ())
    assert stage.session.missing == ()
    assert stage.session.phase == "running"
    assert stage.state == {"r06": "running", "r08": "running"}


def test_a_late_robot_that_does_not_arm_is_left_out_and_the_others_run_on() -> None:
    stage = Stage(Plan(automatic=True, quorum=1))
    stage.silent = {"r08"}
    stage.turn(120)
    stage.silent, stage.obedient = set(), False
    stage.state["r08"] = "disarmed"
    seen = set()
    for _ in range(160):
        assert stage.turn() == "running"
        seen.add(stage.session.heartbeat(stage.now).order)
        if stage.session.heartbeat(stage.now).order == "run" and "arm" in seen:
            break
    assert seen == {"arm", "run"}
    assert stage.session.missing == ("r08",)


def test_without_a_quorum_all_are_needed() -> None:
    stage = Stage()
    stage.silent = {"r08"}
    assert stage.turn(200) == "waiting"
    assert stage.session.detail == "r08 does not report"


def test_a_robot_that_nobody_has_heard_does_not_trip_what_needs_a_report() -> None:
    facts = Facts(10**10, ARENA, "", NAMES, {}, {}, {}, 2, 10**10, 1)
    tripped = [row.name for row in STATION_FAILSAFES if row.tripped(facts)]
    assert tripped == ["robot_silent"]


def test_the_page_shows_the_table() -> None:
    page = (Path(__file__).parents[2] / "docs" / "safety.md").read_text()
    assert markdown() in page, "regenerate with: python -m groundstation.failsafes"
