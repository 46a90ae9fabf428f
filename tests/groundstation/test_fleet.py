"""The fleet verb's lines, and what doctor says of certificates."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest

from contract.arena import digest, load
from contract.messages import SCHEMA_VERSION, LogEntry, RobotReport
from groundstation import cli, rig
from groundstation.doctor import certificates
from groundstation.fleet import log_line, status_lines, version_lines

ARENA = load(rig.find_arena("bench2"))
NOW = datetime.now(UTC)


def report(robot: str, **changes: object) -> RobotReport:
    base = RobotReport(
        robot=robot, boot=1, stamp_ns=5, schema_version=SCHEMA_VERSION, software="1.2", arena_hash=digest(ARENA),
        run="running", pose_valid=True, pose_age_ms=4.0, counters={"refused_key": 0, "replayed_state": 3},
    )  # fmt: skip
    return msgspec.structs.replace(base, **changes)


def test_one_line_a_robot_and_what_it_refused() -> None:
    reports = {name: report(name) for name in ARENA.robots}
    lines, well = status_lines(ARENA, list(ARENA.robots), reports)
    assert well
    assert len(lines) == len(ARENA.robots)
    assert "replayed_state 3" in lines[0]
    assert "refused_key" not in lines[0]


@pytest.mark.parametrize(
    "worse", [None, {"run": "fault", "reason": "bus off"}, {"motor_faults": ("over_temperature",)}]
)
def test_one_that_is_not_well_makes_the_fleet_not_well(worse: dict[str, object] | None) -> None:
    reports = {name: report(name) for name in ARENA.robots}
    if worse is None:
        del reports["r08"]
    else:
        reports["r08"] = report("r08", **worse)
    lines, well = status_lines(ARENA, list(ARENA.robots), reports)
    assert not well
    assert ("SILENT" in lines[1]) == (worse is None)


@pytest.mark.parametrize("other", [{"software": "1.3"}, {"schema_version": 99}, {"arena_hash": "0"}])
def test_versions_that_differ_are_named(other: dict[str, object]) -> None:
    same = {name: report(name) for name in ARENA.robots}
    assert version_lines(ARENA, list(ARENA.robots), same)[1]
    lines, well = version_lines(ARENA, list(ARENA.robots), same | {"r08": report("r08", **other)})
    assert not well
    assert any("differs" in line.lower() for line in lines)


def test_a_log_line() -> None:
    entry = LogEntry(stamp_ns=1_500_000_000, level="warning", source="r06", event="refused_key", text="not ours")
    assert log_line(entry).split() == ["1.500", "warning", "r06", "refused_key:", "not", "ours"]


def site(tmp_path: Path, days: float) -> Path:
    path = tmp_path / "lab.toml"
    text = rig.find_arena("bench2").read_text()
    path.write_text(text.replace('"tcp/127.0.0.1:7447"', '"quic/127.0.0.1:7447"\nkeys = "keys"'))
    assert cli.main(["keys", "init", "--arena", str(path)]) == 0
    assert cli.main(["keys", "issue", "--days", str(days), "--arena", str(path)]) == 0
    return path


@pytest.mark.parametrize(
    ("days", "after", "verdict", "words"),
    [(30, 0, "pass", "29 days"), (30, 25, "warn", "4 days"), (3, 0, "warn", "2 days"), (3, 4, "fail", "expired 1 day")],
)
def test_doctor_warns_before_certificates_end(
    days: float, after: float, verdict: str, words: str, tmp_path: Path
) -> None:
    arena = load(site(tmp_path, days))
    found = {check.subject: check for check in certificates(arena, datetime.now(UTC) + timedelta(days=after))}
    assert set(found) == {"router", "bridge", "station", *arena.robots, ""}
    for name in ("router", "r06"):
        assert found[name].verdict == verdict
        assert words in found[name].seen
        assert bool(found[name].remedy) == (verdict != "pass")
    assert found[""].verdict == "pass"


def test_doctor_names_revoked_holders_and_keys_that_others_can_read(tmp_path: Path) -> None:
    path = site(tmp_path, 30)
    assert cli.main(["keys", "revoke", "r06", "--arena", str(path)]) == 0
    (tmp_path / "keys" / "station" / "private.key").chmod(0o644)
    found = {check.subject: check for check in certificates(load(path), NOW)}
    assert (found["r06"].verdict, found["r06"].seen) == ("fail", "revoked")
    assert "station/private.key" in found[""].seen
    assert found[""].verdict == "fail"


def test_on_a_robot_only_its_own_certificate_is_looked_at(tmp_path: Path) -> None:
    arena = load(site(tmp_path, 30))
    keys = tmp_path / "keys"
    for path in sorted(keys.rglob("*"), reverse=True):
        if path.is_file() and path.parent.name != "r06" and path.name != "ca.pem":
            path.unlink()
        elif path.is_dir() and path.name != "r06":
            path.rmdir()
    assert [check.subject for check in certificates(arena, NOW)] == ["r06", ""]


def test_a_loopback_site_needs_none_of_it() -> None:
    assert certificates(ARENA, NOW) == []
