"""A slice of the fault matrix: bytes the emulated motors decoded, and how far the bodies rolled."""

import random
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from contract.messages import MotorSample
from groundstation.conditions import FIELD
from groundstation.faultkept import Kept
from groundstation.faultpage import markdown, percentiles
from groundstation.faultreal import REAL_ROWS, _real, judged, judged_by, victim_of
from groundstation.faultrig import Place, StageError, rest_s, rolled_m, unreadable
from groundstation.faultrows import ROWS, Outcome, Row, allowed_m, wire_of
from groundstation.faults import connected, linked, play
from groundstation.faultwords import judge, zero_after_s
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from mocap_bridge.mock.script import Fault

BY_NAME = {row.name: row for row in ROWS}
SLICE = (
    "wheels: commands lost (roboclaw)",
    "motion capture: occlusion",
    "motion capture: jump",
    "motion capture: duplicate",
    "station: STOP",
    "process: hung",
    "process: killed and restarted",
    "clock: robot's steps 0.3 s ahead",
    "radio: router lost",
)
GOOD = Outcome(
    row="", seed=1, victim="r01", at_s=1.0, speed_mps=0.5, zero_s=0.1, rest_s=0.5, rolled_m=0.1,
    failsafe=("pose_invalid",), collisions=0, split=False,
)  # fmt: skip


def test_the_matrix_has_forty_rows_and_more_each_of_its_own_name() -> None:
    assert len(BY_NAME) == len(ROWS) >= 40
    places = {"wheels", "motion capture", "datagrams", "messages", "radio", "station", "process", "clock", "nothing"}
    assert {row.where for row in ROWS} == places
    assert len({row.name for row in REAL_ROWS}) == len(REAL_ROWS)
    assert {row.where for row in REAL_ROWS} >= {"wheels", "motion capture", "radio", "station", "process", "disk"}


@pytest.mark.parametrize("name", SLICE)
def test_a_row(name: str) -> None:
    outcome = play(BY_NAME[name], 1)
    assert outcome.faults == ()


CASES = (
    ("motion capture: swap", 1596625896),
    ("wheels: bus-off (odrive)", 536467829),
    ("wheels: encoders stand still (odrive)", 798359651),
    ("wheels: encoders stand still (odrive)", 1381652169),
    ("wheels: supply of the motors cut (odrive)", 1417418707),
    ("motion capture: frozen", 63206090),
    ("motion capture: jump", 802665018),
    ("wheels: one bit in 8 bytes (odrive)", 1823438501),
)
"""Of longer runs that once ended badly."""


@pytest.mark.parametrize(("name", "seed"), CASES)
def test_what_once_ended_badly(name: str, seed: int) -> None:
    assert play(BY_NAME[name], seed).faults == ()


def test_robots_are_in_one_piece_by_their_places_before_they_are_by_their_links() -> None:
    world = World(arena_for(Job(3, 19, 1, "field", "field", 60.0)), scenario(3, 19, 1), FIELD, 1, 60.0)
    names = list(world.agents)
    assert (connected(world, names), linked(world, names)) == (True, False)
    world.until(1.0)
    assert (connected(world, names), linked(world, names)) == (True, True)
    world.agents[names[0]].controller.release()
    assert not linked(world, names[:2]), "both ends count"
    assert not connected(world, names, {names[0]: (9.0, 9.0)})


def test_a_fault_at_the_same_moment_is_the_same_fault() -> None:
    row = BY_NAME["station: STOP"]
    assert play(row, 2) == play(row, 2)


@pytest.mark.parametrize("fault", ["supply sags", "no bytes either way", "port unplugged", "bus-off"])
@pytest.mark.parametrize("family", ["odrive", "roboclaw"])
def test_a_robot_drives_again_once_the_cause_is_gone_and_it_is_released(fault: str, family: str) -> None:
    row = BY_NAME.get(f"wheels: {fault} ({family})")
    if row is None:
        return
    arena = arena_for(Job(3, 19, 1, "field", "field", 60.0, wired=True))
    world = World(arena, scenario(3, 19, 1), FIELD, 1, 60.0, wired=True)
    victim = next(name for name, robot in arena.robots.items() if robot.wheels["kind"] == family)
    world.until(0.5)
    row.inject(world, victim)
    world.until(1.2)
    world.stop()
    world.until(1.3)
    assert world.agents[victim].run_state == "stopped"
    for kind in ("brown-out", "dropped", "unplugged", "bus-off"):
        if kind != "bus-off" or family == "odrive":
            wire_of(world).emulated.repair(victim, kind)
    world.orders += [(world.now_ns + 100_000_000 * step, order, ()) for step, order in ((1, "disarm"), (8, "arm"))]
    world.until(2.5)
    assert world.agents[victim].run_state == "armed", world.agents[victim].verdict


BAD: dict[str, dict[str, Any]] = {
    "late": {"zero_s": 0.5},
    "never": {"zero_s": None, "rest_s": None},
    "still moving": {"rest_s": None},
    "too far": {"rolled_m": 3.0},
    "collision": {"collisions": 1},
    "split": {"split": True},
    "wrong word": {"failsafe": ("loop_overrun",)},
    "no word": {"failsafe": ()},
}


def test_a_robot_is_left_in_the_state_that_the_action_says() -> None:
    row = BY_NAME["station: STOP"]
    stopped = msgspec.structs.replace(GOOD, failsafe=(), state="stopped", zero_s=0.01)
    assert not list(judge(row, stopped, 1.0))
    assert list(judge(row, msgspec.structs.replace(stopped, state="running"), 1.0))
    restarted = BY_NAME["process: killed and restarted"]
    assert list(judge(restarted, stopped, 1.0))
    assert not list(judge(restarted, msgspec.structs.replace(stopped, state="disarmed"), 1.0))
    either = restarted._replace(leaves="disarmed stopped")
    assert not list(judge(either, stopped, 1.0))
    assert list(judge(either, msgspec.structs.replace(stopped, state="running"), 1.0))


def test_what_no_program_can_stop_must_be_named_and_collides_at_its_own_risk() -> None:
    row = BY_NAME["wheels: firmware hung (odrive)"]
    named = msgspec.structs.replace(GOOD, failsafe=("driver_silent",), zero_s=None, rest_s=None, collisions=1)
    assert not list(judge(row, named, float("inf")))
    assert list(judge(row, msgspec.structs.replace(named, failsafe=()), float("inf")))


def test_short_occlusions_and_a_restart_of_motion_capture_end_by_themselves() -> None:
    arena = arena_for(Job(3, 19, 1, "field", "field", 60.0, wired=True))
    world = World(arena, scenario(3, 19, 1), FIELD, 1, 60.0, wired=True)
    world.until(0.8)
    server = wire_of(world).server
    start_s = server.elapsed_s(world.now_ns)
    for robot, duration_s in zip(arena.robots.values(), (0.05, 0.3, 0.6), strict=True):
        server.inject(Fault("occlusion", start_s, duration_s, robot.body))
    server.inject(Fault("restart", start_s + 1.0, 0.4))
    world.until(4.0)
    for agent in world.agents.values():
        frame = agent.reception.frame
        assert frame is not None
        assert [body.resets for body in frame.bodies] == [1, 1, 1]
        assert agent.run_state == "running"
        assert agent.sensing.left(world.now_ns, ()) == []


def test_a_robot_that_hung_may_go_on_but_not_farther_than_one_that_hangs_for_good() -> None:
    row = next(row for row in REAL_ROWS if row.name == "process: hung for 0.6 s")
    stage = SimpleNamespace(arena=arena_for(Job(3, 19, 1, "field", "field", 60.0)))
    went_on = msgspec.structs.replace(GOOD, failsafe=(), zero_s=0.2, rest_s=None, rolled_m=0.7, state="running")
    assert judged(row, went_on, stage).faults == ()
    assert judged(row, msgspec.structs.replace(went_on, zero_s=0.4), stage).faults
    assert judged(row, msgspec.structs.replace(went_on, zero_s=None), stage).faults
    assert judged(row, msgspec.structs.replace(went_on, rolled_m=0.9), stage).faults


def test_an_interrupted_run_goes_on_where_it_was(tmp_path: Path) -> None:
    first = Kept(tmp_path / "kept", "lockstep")
    first.add(msgspec.structs.replace(GOOD, row="a"))
    with (tmp_path / "kept" / "lockstep.jsonl").open("ab") as file:
        file.write(b'{"row": "a", "se')
    again = Kept(tmp_path / "kept", "lockstep")
    assert again.outcomes == first.outcomes != {}
    assert Kept(None, "lockstep").outcomes == {}


@pytest.mark.parametrize("case", BAD)
def test_everything_a_row_demands_is_judged(case: str) -> None:
    row = BY_NAME["motion capture: occlusion"]
    allowed = allowed_m(row, arena_for(Job(3, 19, 1, "field", "field", 60.0)))
    assert not list(judge(row, GOOD, allowed))
    assert list(judge(row, msgspec.structs.replace(GOOD, **BAD[case]), allowed))


def test_a_robot_nobody_saw_may_be_going_again_when_it_is_seen_but_no_farther_than_it_may_be() -> None:
    row = next(row for row in REAL_ROWS if row.name == "radio: router and bridge killed, restarted")
    allowed = allowed_m(row, arena_for(Job(3, 19, 1, "field", "field", 60.0)))
    assert 0.3 < allowed < 1.2
    seen = msgspec.structs.replace(GOOD, failsafe=(), zero_s=None, rest_s=None, rolled_m=0.3, state="running")
    assert not list(judge(row, seen, allowed))
    assert list(judge(row, msgspec.structs.replace(seen, rolled_m=allowed + 0.01), allowed))
    assert list(judge(row, msgspec.structs.replace(seen, rolled_m=0.0), allowed)) == ["not seen again"]
    for other in (row._replace(resumes=False), row._replace(blind=False)):
        assert "neither a zero nor rest" in list(judge(other, seen, allowed))


def test_a_fault_that_must_not_stop_anybody_is_bad_when_it_does() -> None:
    row = BY_NAME["motion capture: duplicate"]
    assert list(judge(row, GOOD, float("inf")))
    assert not list(judge(row, msgspec.structs.replace(GOOD, failsafe=(), zero_s=None, rest_s=None), float("inf")))


def sample(stamp_ns: int, speed: float, enabled: bool = True, released: bool = False) -> MotorSample:
    return MotorSample(stamp_ns=stamp_ns, left_radps=speed, right_radps=-speed, enabled=enabled, released=released)


def test_zero_begins_where_no_motion_follows() -> None:
    moving = [sample(1, 1.0), sample(2, 0.0), sample(3, 1.0)]
    assert zero_after_s(moving, 0) is None
    assert zero_after_s([], 0) is None
    assert zero_after_s(moving, 0, first=True) == 0.0
    stopped = [*moving, sample(500_000_000, 0.0), sample(600_000_000, 0.0)]
    assert zero_after_s(stopped, 0) == 0.5
    assert zero_after_s([*moving, sample(500_000_000, 1.0, released=True)], 0) == 0.5
    assert zero_after_s([*moving, sample(500_000_000, 1.0, enabled=False)], 0) == 0.5
    assert zero_after_s([sample(1, 0.0), sample(700_000_000, 0.0)], 500_000_000) == 0.2


def test_a_fault_that_only_turning_wheels_show_has_no_deadline_while_they_rest() -> None:
    speeds = {1: 1.0, 3: 0.0, 8: 0.0, 9: 1.0, 12: 0.0, 13: 1.0, 14: 0.0}
    samples = [sample(tenths * 10**8, speed) for tenths, speed in speeds.items()]
    assert zero_after_s(samples, 10**8) == 1.3
    assert zero_after_s(samples, 10**8, gentle_radps=0.0) == 0.6, "0.3 to 0.9 and 1.2 to 1.3 s it rested"
    assert zero_after_s(samples[:3], 10**8, gentle_radps=0.0) == 0.2
    assert zero_after_s(samples[:4], 10**8, gentle_radps=0.0) is None
    gentle = [
        sample(tenths * 10**8, speed) for tenths, speed in {1: 1.0, 3: -0.2, 8: 0.0, 9: 1.0, 14: 0.1, 15: 0.0}.items()
    ]
    assert zero_after_s(gentle, 10**8, gentle_radps=0.2) == 0.7, "0.3 to 0.9 s it hardly turned, and from 1.4 s on"
    assert zero_after_s(gentle, 10**8, gentle_radps=0.19) == 1.2, "from 0.3 to 0.8 s it turned"
    assert {row.name for row in ROWS if row.turning} == {
        f"wheels: {what} ({family})"
        for what in ("supply of the motors cut", "wheels jammed", "encoders count backwards")
        for family in ("odrive", "roboclaw")
    }
    assert {row.name for row in REAL_ROWS if row.turning} == {row.name for row in ROWS if row.turning}


def test_a_body_s_way_and_rest_are_read_from_where_it_really_was() -> None:
    places = [Place(10**8 * k, 0.1 * k, 0.0, 0.5 if k < 3 else 0.001) for k in range(6)]
    assert rolled_m(places) == pytest.approx(0.5)
    assert rest_s(places, 0, 0.01) == 0.2
    assert rest_s(places[3:], 0, 0.01) == 0.0
    assert rest_s(places[:3], 0, 0.01) is None
    assert rest_s([], 0, 0.01) is None


def test_a_process_that_has_ended_by_itself_is_named() -> None:
    killed, full = (next(r for r in REAL_ROWS if word in r.name) for word in ("recorder: killed", "full for the rec"))
    outcome: Any = SimpleNamespace(state="running")
    stage: Any = None
    assert list(_real(full, outcome, stage, ["recorder", "r06"])) == ["recorder has ended", "r06 has ended"]
    assert list(_real(full, outcome, stage, [])) == []
    assert list(_real(killed, outcome, stage, ["recorder"])) == []


def test_a_recording_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    for folder in ("run", "run-2"):
        (tmp_path / folder).mkdir()
    assert unreadable(tmp_path / "run") == []
    (tmp_path / "run-2" / "run.mcap").write_bytes(b"nothing")
    assert "not an MCAP file" in unreadable(tmp_path / "run")[0]
    kept = Path(__file__).parents[1] / "data" / "kept.mcap"
    (tmp_path / "run-2" / "run.mcap").write_bytes(kept.read_bytes())
    assert unreadable(tmp_path / "run") == []


def test_the_page_has_every_row_and_its_figures() -> None:
    row: Row = BY_NAME["motion capture: occlusion"]
    arena = arena_for(Job(3, 19, 1, "field", "field", 60.0))
    page = markdown([msgspec.structs.replace(GOOD, row=row.name)], [], arena)
    assert all(f"| {entry.where} | {entry.fault}" in page for entry in (*ROWS, *REAL_ROWS))
    assert "0 to 1 times" in page
    assert "| 100 / 100 / 100 | 0.10 |" in page
    assert "| 1/1 |" in page
    assert percentiles([3.0, 1.0, 2.0]) == (2.0, 3.0, 3.0)
    assert percentiles([]) is None


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("radio: router and bridge frozen", [1.0, 1.3, 9.0]),
        ("radio: router killed", [1.0, 1.1]),
        ("process: hung", [1.1, 2.0, 8.0]),
        ("process: hung for 0.6 s", [1.1]),
    ],
)
def test_what_came_through_while_a_network_was_being_frozen_does_not_say_where_it_came_to_rest(
    name: str, kept: list[float]
) -> None:
    row = next(row for row in REAL_ROWS if row.name == name)
    stamps_s = (0.9, 1.1, 2.0, 8.0, 9.0) if not row.blind else (0.9, 1.1, 1.3, 9.0)
    places = [Place(round(at_s * 1e9), at_s, 0.0, 0.5) for at_s in stamps_s]
    times_ns = (1_000_000_000, 1_200_000_000, 8_500_000_000)
    found = judged_by(row, places, Place(900_000_000, 0.9, 0.0, 0.5), times_ns)
    assert [place.stamp_ns * 1e-9 for place in found] == kept
    assert not row.blind or found[0].speed_mps == 0.0


def test_a_place_kept_in_a_frozen_network_from_when_the_robot_still_moved_says_nothing_of_its_rest() -> None:
    row = next(row for row in REAL_ROWS if row.name == "radio: router and bridge frozen")
    places = [Place(1_210_000_000, 1.2, 0.0, 0.5), Place(4_000_000_000, 1.3, 0.0, 0.0)]
    times_ns = (1_000_000_000, 1_200_000_000, 3_900_000_000)
    found = judged_by(row, places, Place(900_000_000, 0.9, 0.0, 0.5), times_ns)
    assert rest_s(found, times_ns[0], 0.01) == 0.21
    assert rest_s(judged_by(row, places[:1], places[0], times_ns), times_ns[0], 0.01) is None


class Holding:
    """A stage whose robots begin on targets; every mission ends after so many looks."""

    def __init__(self, moves_after: int, ends_after: int) -> None:
        self.session = SimpleNamespace(phase="ready", detail="")
        self.missions = self._looks = 0
        self._moves_after, self._ends_after = moves_after, ends_after

    def to_running(self) -> None:
        self.missions += 1
        self.session.phase, self._looks = "running", 0

    def watch(self, seconds: float) -> None:
        pass

    def until(self, done: Any, what: str) -> None:
        while not done():
            self._looks += 1
            self.session.phase = "completed" if self._looks >= self._ends_after else "running"

    def moving(self) -> list[str]:
        return ["r09", "r02"] if self._looks >= self._moves_after else ["r09"]


def test_a_victim_is_waited_for_until_it_moves_or_the_mission_ends() -> None:
    stage: Any = Holding(moves_after=5, ends_after=9)
    name, _ = victim_of(stage, ["r01", "r02"], random.Random(1))
    assert (name, stage.missions) == ("r02", 1)
    with pytest.raises(StageError, match="8 missions ended before one of r01, r02 moved"):
        victim_of(Holding(moves_after=9, ends_after=5), ["r01", "r02"], random.Random(1))  # type: ignore[arg-type]
