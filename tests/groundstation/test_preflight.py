"""Pre-flight: every check of a good fleet passes, each thing wrong fails or warns by name, with a remedy."""

from typing import Any

import pytest
from msgspec.structs import replace

from contract.arena import Targets
from contract.checks import CheckResult, worst
from contract.messages import SCHEMA_VERSION, LoopTiming, MocapHealth, RobotReport
from groundstation.doctor import Ear, lines, pointed
from groundstation.failsafes import Facts
from groundstation.preflight import Fleet, preflight
from tests.groundstation.test_session import ARENA, HASH, MS, NAMES, Swarm

NOW = 10_000 * MS
TIMING = LoopTiming(nominal_hz=100.0, rate_hz=100.0, jitter_ms=0.5, steps=100, misses=0)


def report(name: str, **changes: Any) -> RobotReport:
    fields: dict[str, Any] = {
        "robot": name, "boot": 1, "stamp_ns": NOW, "schema_version": SCHEMA_VERSION, "arena_hash": HASH,
        "run": "disarmed", "pose_valid": True, "pose_age_ms": 12.0, "timing": TIMING, **changes,
    }  # fmt: skip
    return RobotReport(**fields)


def fleet(changes: dict[str, Any] | None = None, **facts: Any) -> Fleet:
    reports = {"r06": report("r06"), "r08": report("r08", **(changes or {}))}
    base = Facts(
        now_ns=NOW, arena=ARENA, arena_hash=HASH, crew=NAMES, reports=reports, heard_ns=dict.fromkeys(NAMES, NOW),
        boots={}, seen=2, frame_ns=NOW, components=1, disk_free_mb=9999.0,
    )  # fmt: skip
    health = MocapHealth(stamp_ns=NOW, state="ok", rate_hz=100.0, latency_ms=4.0)
    return Fleet(base._replace(**facts), {"r06": (1.0, 1.0), "r08": (1.8, 1.0)}, health, NOW)


def found(it: Fleet, verdict: str) -> set[tuple[str, str]]:
    return {(check.subject, check.name) for check in preflight(it) if check.verdict == verdict}


def test_a_good_fleet_fails_nothing_and_names_every_robot() -> None:
    results = preflight(fleet())
    assert found(fleet(), "fail") == set()
    assert found(fleet(), "warn") == {("", "battery thresholds")}, "real wheels without a battery threshold"
    assert {check.subject for check in results} == {"", *NAMES}


ROBOT = {
    "other file": ({"arena_hash": "0" * 12}, {("r08", "same file and schema")}),
    "other schema": ({"schema_version": 99}, {("r08", "same file and schema")}),
    "no pose": ({"pose_valid": False}, {("r08", "pose")}),
    "stopped": ({"run": "stopped"}, {("r08", "state")}),
    "not ready": ({"reason": "driver: port gone"}, {("r08", "state")}),
    "motor fault": ({"motor_faults": ("over current",)}, {("r08", "motors")}),
    "no loop": ({"timing": None}, {("r08", "loop")}),
    "clock ahead": ({"stamp_ns": NOW + 21 * MS}, {("", "clock_ahead")}),
    "clock behind": ({"stamp_ns": NOW - 301 * MS}, {("", "clock_behind")}),
}


@pytest.mark.parametrize("case", ROBOT)
def test_what_is_wrong_with_a_robot_fails_by_name_with_a_remedy(case: str) -> None:
    changes, expected = ROBOT[case]
    it = fleet(changes)
    assert found(it, "fail") == expected
    assert all(check.remedy for check in preflight(it) if check.verdict != "pass")


SITE = {
    "no room on the disk": (fleet(disk_free_mb=10.0), {("", "disk_low")}),
    "in pieces": (fleet(components=2), {("", "swarm_split")}),
    "no frames": (fleet(frame_ns=0), {("", "poses_silent")}),
    "no bridge": (fleet()._replace(health=None), {("", "mocap")}),
    "a robot silent": (
        fleet({"stamp_ns": NOW - 1001 * MS}, heard_ns={"r06": NOW, "r08": NOW - 1001 * MS}),
        {("r08", "reports")},
    ),
    "too near": (fleet()._replace(places={"r06": (1.0, 1.0), "r08": (1.1, 1.0)}), {("r06", "room"), ("r08", "room")}),
}


@pytest.mark.parametrize("case", SITE)
def test_what_is_wrong_with_the_site_fails_by_name(case: str) -> None:
    it, expected = SITE[case]
    assert found(it, "fail") == expected


def test_what_only_warns() -> None:
    slow = TIMING.__class__(nominal_hz=100.0, rate_hz=98.0, jitter_ms=9.0, steps=1, misses=0)
    assert ("r08", "loop") in found(fleet({"timing": slow}), "warn")
    assert ("", "station") in found(fleet()._replace(heartbeat_ns=None), "warn")
    near = fleet()._replace(places={"r06": (1.0, 1.0), "r08": (1.18, 1.0)})
    assert ("r06", "room") in found(near, "warn")


def test_the_table_says_verdict_subject_and_remedy() -> None:
    results = preflight(fleet({"pose_valid": False}))
    said = "\n".join(lines(results))
    assert "FAIL  r08  pose" in said
    assert "-> look at the markers" in said
    assert said.endswith("1 warn, 1 fail")
    assert worst(results) == "fail"
    assert all(isinstance(check, CheckResult) for check in results)


@pytest.mark.parametrize(
    ("wish", "verdict", "words"),
    [
        (Targets(points=((3.0, 1.0), (3.5, 1.0))), "pass", "2, the first in sight"),
        (Targets(points=((3.0, 1.0),), start_direction_rad=1.57), "warn", "1.57 rad, passes all 1 out of sight"),
        (Targets(), "pass", "19, the first in sight"),
    ],
)
def test_a_swarm_pointed_past_its_targets_is_warned_of(wish: Targets, verdict: str, words: str) -> None:
    check = pointed(replace(ARENA, targets=wish))
    assert check.verdict == verdict
    assert words in check.seen
    assert bool(check.remedy) == (verdict != "pass")


def test_a_cloud_for_which_there_is_no_room_fails() -> None:
    small = replace(ARENA, arena=replace(ARENA.arena, size_m=(1.0, 1.0)))
    assert pointed(small).verdict == "fail"


def test_the_ear_hears_what_the_checks_need() -> None:
    swarm = Swarm()
    ear = Ear(ARENA, 5.0)
    ear.receive(swarm.frame(), NOW)
    for name in NAMES:
        ear.receive(report(name), NOW)
    ear.receive(swarm.session.heartbeat(NOW), NOW)
    ear.receive(MocapHealth(stamp_ns=NOW, state="ok"), NOW)
    heard = ear.fleet(NOW)
    assert found(heard, "fail") == {("", "disk_low")}
    assert heard.facts.components == 1
