"""Deployment without a robot: checks, wheels, plans and courses as data, then the real scripts below a folder."""

import hashlib
import re
import shutil
import subprocess
import sys
from importlib.metadata import PathDistribution
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Arena, parse
from contract.checks import worst
from contract.messages import RobotReport, RunStatus
from groundstation.deploy import Deployment, Visit, table
from groundstation.deployment import bundle, pins, plan, render
from groundstation.deployment.course import Outcome, follow
from groundstation.deployment.facts import preflight, read
from groundstation.deployment.plan import Release, Step, Target
from groundstation.deployment.remote import Here, Ssh, run
from groundstation.deployment.site import busy
from tests.house.checkout import ROOT

PROBE = """user=0
machine=aarch64
glibc=2.36
systemd=252
booted=yes
rsync=/usr/bin/rsync
python=/usr/bin/python3
version=3.11.2
disk_mb=9000
current=0.1.0-b
previous=0.1.0-a
leap=Normal
clock=1000.5
"""
FACTS = read(PROBE, 1000.0, 1001.0)
LOCK = pins.read((ROOT / "requirements.lock").read_text())
NEEDS = {
    "ahdc-fieldkit": ["numpy>=2", "python-can>=4", 'canopen; extra == "canopen"', 'pytest; extra == "test"'],
    "python-can": ["packaging", "wrapt~=1.10", 'msgpack; sys_platform == "win32"'],
    "canopen": ["python-can"],
}


def arena(**robot: Any) -> Arena:
    wheels = robot.pop("wheels", {"kind": "odrive", "channel": "can0", "left": 0, "right": 1, "bitrate": 250_000})
    entry = {"body": "r06", "start": [1.0, 1.0], "host": "robot-06", "wheels": wheels}
    deploy = {"cpus": [2, 3]} | robot
    return parse({"arena": {"name": "lab", "size_m": [4.0, 5.0]}, "robots": {"r06": entry}, "deploy": deploy}, "test")


# --- looking ------------------------------------------------------------------------------------


def test_a_probe_is_read_whole() -> None:
    assert tuple(FACTS)[:6] == (True, "aarch64", (2, 36), "/usr/bin/python3", "3.11.2", 252)
    assert tuple(FACTS)[6:] == (True, True, 9000, "0.1.0-b", "0.1.0-a", "Normal", 0.0, 0.5)
    assert FACTS.minor == "3.11"
    assert worst(preflight(FACTS, "r06")) == "pass"


@pytest.mark.parametrize(("clock", "ahead_s"), [(1000.0, 0.0), (1001.0, 0.0), (1004.0, 3.0), (998.0, -2.0)])
def test_a_clock_is_off_by_no_less_than_the_way_allows(clock: float, ahead_s: float) -> None:
    assert read(f"clock={clock}", 1000.0, 1001.0).ahead_s == pytest.approx(ahead_s)


@pytest.mark.parametrize(
    ("change", "name", "verdict"),
    [
        ({"root": False}, "root", "fail"),
        ({"machine": "armv7l"}, "machine", "fail"),
        ({"glibc": ()}, "glibc", "fail"),
        ({"glibc": (2, 12)}, "glibc", "fail"),
        ({"python": "", "version": ""}, "python", "fail"),
        ({"booted": False}, "systemd", "fail"),
        ({"systemd": 241}, "systemd", "fail"),
        ({"rsync": False}, "rsync", "fail"),
        ({"disk_mb": 599}, "disk", "fail"),
        ({"ahead_s": -61.0}, "clock", "fail"),
        ({"ahead_s": 0.2}, "clock", "warn"),
    ],
)
def test_each_reason_to_refuse_is_named_with_its_remedy(change: dict[str, Any], name: str, verdict: str) -> None:
    wrong = [check for check in preflight(FACTS._replace(**change), "r06") if check.verdict != "pass"]
    assert [(check.name, check.verdict) for check in wrong] == [(name, verdict)]
    assert wrong[0].remedy


@given(st.text(max_size=200))
def test_no_answer_crashes_the_probe_or_passes_it(text: str) -> None:
    assert worst(preflight(read(text, 0.0, 1.0), "r06")) == "fail"


def test_a_mission_or_powered_motors_forbid_a_change() -> None:
    def report(name: str, state: str) -> RobotReport:
        return RobotReport(robot=name, boot=1, stamp_ns=1, run=state)  # type: ignore[arg-type]

    assert not busy(None, {})
    for phase in ("waiting", "ready", "armed", "running", "homing", "completed", "stopped", "failed"):
        status = RunStatus(stamp_ns=1, mission="m", phase=phase)  # type: ignore[arg-type]
        assert bool(busy(status, {})) == (phase in ("armed", "running", "homing"))
    for state in ("disarmed", "armed", "running", "holding", "stopped", "fault"):
        words = busy(None, {"r06": report("r06", state), "r08": report("r08", "disarmed")})
        assert bool(words) == (state in ("armed", "running", "holding"))
        assert "r08" not in words


# --- wheels -------------------------------------------------------------------------------------


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_a_robot_gets_what_it_needs_and_no_more(python: str, machine: str) -> None:
    where = pins.environment(python, machine)
    names = [pin.name for pin in pins.closure(LOCK, NEEDS, [], where)]
    assert names == ["numpy", "packaging", "python-can", "wrapt"]
    more = pins.closure(LOCK, NEEDS, pins.extras(["odrive", "cia402"]), where)
    assert "canopen" in [pin.name for pin in more]
    for pin in more:
        assert re.fullmatch(rf"{pin.name}==[^ ;]+( --hash=sha256:[0-9a-f]{{64}})+", pin.line())


def test_a_need_that_is_not_locked_is_named() -> None:
    with pytest.raises(pins.PinError, match="left-pad, which ahdc-fieldkit needs"):
        pins.closure(LOCK, {"ahdc-fieldkit": ["left-pad"]}, [], pins.environment("3.11", "x86_64"))


def test_platform_tags_go_no_newer_than_the_robots_glibc() -> None:
    tags = pins.platforms("aarch64", (2, 28))
    assert tags[0] == "manylinux_2_28_aarch64"
    assert tags[-2:] == ["manylinux_2_17_aarch64", "manylinux2014_aarch64"]


def fake_kit(folder: Path, says: str, version: str = "0.1.0") -> Path:
    """A wheel named like the field kit whose ``ahdc-onboard`` prints ``says``."""
    info = folder / "meta" / "ahdc_fieldkit-0.dist-info"
    info.mkdir(parents=True, exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: ahdc-fieldkit\nVersion: {version}\n")
    (info / "entry_points.txt").write_text("[console_scripts]\nahdc-onboard = fakekit:main\n")
    code = f"def main():\n    print({says!r})\n".encode()
    return bundle.pack(PathDistribution(info), {"fakekit.py": code}, folder / "wheels")


def test_a_packed_wheel_is_the_same_bytes_each_time(tmp_path: Path) -> None:
    first = fake_kit(tmp_path / "a", "x").read_bytes()
    assert fake_kit(tmp_path / "b", "x").read_bytes() == first
    assert fake_kit(tmp_path / "c", "y").read_bytes() != first


def test_a_wheel_whose_hash_the_lock_does_not_have_is_not_there(tmp_path: Path) -> None:
    wheel = fake_kit(tmp_path, "x")
    good = pins.Pin(LOCK[0].requirement, (bundle.sha256(wheel),))
    assert bundle.present([good, LOCK[1]], wheel.parent) == {good.name: wheel}
    wheel.write_bytes(wheel.read_bytes() + b"x")
    assert bundle.present([good], wheel.parent) == {}


# --- plans --------------------------------------------------------------------------------------

TARGET = Target("r06", "/opt/ahdc/r06")
RELEASE = Release("0.1.0-c", "e1", Path("/f"), Path("/w"), "req", "pip-1.whl", "00", "/usr/bin/python3", "abc")
STEPS = plan.deployment(TARGET, RELEASE, "ready")


EVERY = [*STEPS, plan.probe(TARGET), *(s for name in ("x", "") for s in plan.rollback(TARGET, name, "ready"))]


@pytest.mark.parametrize("step", [*EVERY, *plan.removal(TARGET)], ids=lambda step: step.name)
def test_scripts_are_whole(step: Step) -> None:
    if step.script:
        done = subprocess.run(["sh", "-n"], input=step.script, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        used = set(re.findall(r"\$\{?([A-Z][A-Z0-9_]*)", step.script))
        assert used <= set(re.findall(r"^([A-Z][A-Z0-9_]*)=", step.script, re.MULTILINE))


@given(st.text(st.characters(blacklist_characters="\0", blacklist_categories=["Cs"]), max_size=20))
def test_a_value_is_a_value_whatever_is_in_it(value: str) -> None:
    script = plan.script("withdraw", TARGET, {"RELEASE": value}).partition("# There")[0] + 'printf %s "$RELEASE"'
    assert subprocess.run(["sh", "-s"], input=script.encode(), capture_output=True, check=True).stdout == value.encode()


def test_the_order_of_work() -> None:
    assert [step.name for step in STEPS] == ["prepare", "copy", "install", "check", "switch", "wait", "prune"]
    assert [step.name for step in STEPS if step.switched] == ["switch", "wait"]


def good(step: Step) -> tuple[int, str]:
    return 0, {"check": "arena=abc", "wait": f"Steady={plan.STEADY}"}.get(step.name, "")


@pytest.mark.parametrize("fails", [step.name for step in STEPS])
@pytest.mark.parametrize("back_works", [True, False])
def test_what_follows_a_failure_of_each_step(fails: str, back_works: bool) -> None:
    done: list[str] = []

    def runner(step: Step) -> tuple[int, str]:
        done.append(step.name)
        if step.name == fails and done.count(fails) == 1:
            return 7, "it broke"
        return (1, "no way") if step.name == "switch back" and not back_works else good(step)

    outcome = follow(
        "r06", STEPS, lambda: plan.rollback(TARGET, "0.1.0-b", "ready"), runner, done.append, RELEASE, "0.1.0-b"
    )
    assert "it broke" in outcome.detail
    if fails in ("switch", "wait"):
        assert outcome.ending == ("rolled back" if back_works else "stranded")
        assert "switch back" in done
        assert outcome.release == ("0.1.0-b" if back_works else "")
    else:
        assert (outcome.ending, outcome.release) == ("failed", "0.1.0-b")
        assert "switch back" not in done


def test_a_good_course_ends_with_the_new_release() -> None:
    told: list[str] = []
    outcome = follow("r06", STEPS, lambda: (), good, told.append, RELEASE, "0.1.0-b")
    assert outcome == Outcome("r06", "done", "", "0.1.0-c", "0.1.0-b")
    assert len(told) == len(STEPS)


def test_exit_code_0_is_not_enough() -> None:
    wait, check = STEPS[5], STEPS[3]
    said = "ActiveState=activating\nSubState=auto-restart\nResult=exit-code\nSteady=1\nJournal=it exploded"
    assert plan.fault_of(wait, 0, said) == "not ready (activating/auto-restart, exit-code); it exploded"
    assert "reads as 'other' there" in plan.fault_of(check, 0, "arena=other", RELEASE)


def test_unit_and_rules_say_what_the_arena_file_says() -> None:
    unit = render.unit(arena(realtime_priority=40), "r06", "0.1.0-c")
    for line in (
        "Type=notify",
        "Restart=on-failure",
        "ExecStart=/opt/ahdc/r06/current/env/bin/ahdc-onboard run --arena /opt/ahdc/r06/current/arena.toml --robot r06",
        "Environment=AHDC_RELEASE=0.1.0-c PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1",
        "CPUAffinity=2 3",
        "CPUSchedulingPolicy=fifo",
        "CPUSchedulingPriority=40",
    ):
        assert line in unit.splitlines()
    assert "RestrictRealtime=yes" in render.unit(arena(), "r06", "x").splitlines()
    assert "{" not in unit
    assert "bitrate 250000 restart-ms 100" in render.rules(arena().robots["r06"])


def test_no_controller_that_is_silent_starves_the_watchdog() -> None:
    from drivers.serial.arduino import Drive

    (watchdog_s,) = re.findall(r"^WatchdogSec=(\d+)$", render.unit(arena(), "r06", "x"), re.MULTILINE)
    petted_every_s = int(watchdog_s) / 4
    assert petted_every_s + Drive.BOOT_S + 1.0 < int(watchdog_s)


@pytest.mark.parametrize("channel", ["/dev/ttyACM0", 'can0", RUN+="/bin/sh', "a" * 16, ""])
def test_no_channel_writes_a_rule_of_its_own(channel: str) -> None:
    wheels = {"kind": "odrive", "channel": channel, "left": 0, "right": 1}
    assert "ip link" not in render.rules(arena(wheels=wheels).robots["r06"])


def test_ssh_never_asks_and_reaches_ipv6(tmp_path: Path) -> None:
    ssh = Ssh("fe80::1", "pi", 2222)
    copying = ssh._copying(plan.Copy(Path("/a"), "/b", delete=True))
    assert copying[-1] == "pi@[fe80::1]:/b/"
    assert "--rsync-path=sudo -n rsync" in copying
    assert any("BatchMode=yes" in word and "-p 2222" in word for word in copying)


def test_a_command_that_is_missing_or_slow_is_an_exit_code() -> None:
    assert run(["no-such-command"], "", 1.0) == (127, "no-such-command: No such file or directory")
    code, said = run(["sh", "-c", "echo begun; exec sleep 60"], "", 0.2)
    assert (code, "begun" in said, "no answer within 0.2 s" in said) == (124, True, True)


def test_the_table_names_what_went_wrong() -> None:
    visits = [Visit(Outcome("r06", "rolled back", "not ready", "0.1.0-a", "0.1.0-a"), FACTS, [], 12.0)]
    assert table(arena(), visits)[1:] == [
        "r06    robot-06  aarch64  3.11.2  0.1.0-a  0.1.0-a  rolled back  12 s",
        "r06: not ready",
    ]


def test_a_computer_that_does_not_answer_is_refused_with_a_line_to_try(capsys: pytest.CaptureFixture[str]) -> None:
    deployment = Deployment(arena(), ["r06"], {"r06": lambda step: (255, "Connection refused")})
    visit = deployment.go_back("r06", dry=False)
    assert visit.outcome.ending == "refused"
    assert "Connection refused (try: ssh -p 22 root@robot-06)" in visit.outcome.detail


# --- the scripts, below a folder ------------------------------------------------------------------

STUBS = {
    "id": 'case "$1" in -u) echo 1000 ;; ahdc) exit 0 ;; esac',
    "chgrp": ":",
    "udevadm": ":",
    "journalctl": "echo it exploded",
    "userdel": ":",
    "systemctl": """unit=$(cat "$AHDC_ROOT"/etc/systemd/system/*.service 2>/dev/null)
case "$1" in
  show) echo MainPID=42; echo NRestarts=0
    case $unit in
      *broken*) echo ActiveState=activating; echo StatusText= ;;
      *) echo ActiveState=active; echo "StatusText=disarmed [$unit]" ;;
    esac ;;
  *) echo "$*" >>"$AHDC_ROOT/systemctl.log" ;;
esac""",
}


class Computer:
    """Scripts run here, below a folder, with stubs of what would need root."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.root = folder / "root"
        self.root.mkdir()
        stubs = folder / "stubs"
        stubs.mkdir()
        for name, text in STUBS.items():
            (stubs / name).write_text(f"#!/bin/sh\n{text}\n")
            (stubs / name).chmod(0o755)
        monkeypatch.setenv("AHDC_ROOT", str(self.root))
        monkeypatch.setattr(plan, "PAUSE_S", 0)
        monkeypatch.setattr(plan, "READY_TURNS", 6)
        self.target = Target("r06", "/opt/ahdc/r06", str(self.root))
        self.run = Here(f"{stubs}:/usr/sbin:/usr/bin:/sbin:/bin")
        self.base = self.root / "opt/ahdc/r06"
        self.folder = folder

    def release(self, name: str, wheel: Path, pip: Path) -> Release:
        files = self.folder / "files" / name
        files.mkdir(parents=True, exist_ok=True)
        for file, text in {"arena.toml": "", "unit": name, "rules": ""}.items():
            (files / file).write_text(text)
        line = f"ahdc-fieldkit==0.1.0 --hash=sha256:{bundle.sha256(wheel)}"
        return Release(
            name=name,
            environment=pins.environment_id(line, "3"),
            files=files,
            wheels=wheel.parent,
            requirements=line,
            pip=pip.name,
            pip_sha256=bundle.sha256(pip),
            python=sys.executable,
            arena_hash="abc",
        )

    def deploy(self, release: Release, before: str) -> Outcome:
        steps = plan.deployment(self.target, release, "ready")
        back = lambda: plan.rollback(self.target, before, "ready")  # noqa: E731
        return follow("r06", steps, back, self.run, lambda text: None, release, before)

    def current(self) -> str:
        return (self.base / "current").resolve().name


@pytest.mark.skipif(shutil.which("rsync") is None, reason="copies with rsync: apt-get install rsync")
def test_install_upgrade_failure_tampering_and_removal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(tmp_path, monkeypatch)
    wheel = fake_kit(tmp_path, "arena=abc")
    pip = bundle.pip_wheel(wheel.parent)
    untouched = sorted(computer.root.rglob("*"))

    first = computer.deploy(computer.release("0.1.0-a", wheel, pip), "")
    assert first.ending == "done", first.detail
    assert computer.current() == "0.1.0-a"
    (environment,) = (computer.base / "envs").iterdir()
    assert (computer.root / "etc/systemd/system/ahdc-robot-r06.service").read_text() == "0.1.0-a"
    made = environment.stat().st_ino

    assert computer.deploy(computer.release("0.1.0-b", wheel, pip), "0.1.0-a").ending == "done"
    assert (computer.base / "previous").read_text().strip() == "0.1.0-a"
    assert next((computer.base / "envs").iterdir()).stat().st_ino == made, "the same wheels, the same environment"

    failed = computer.deploy(computer.release("broken-c", wheel, pip), "0.1.0-b")
    assert (failed.ending, "it exploded" in failed.detail) == ("rolled back", True)
    assert computer.current() == "0.1.0-b"

    assert computer.deploy(computer.release("0.1.0-d", wheel, pip), "0.1.0-b").ending == "done"
    assert sorted(path.name for path in (computer.base / "releases").iterdir()) == ["0.1.0-b", "0.1.0-d"]

    tampered = computer.release("0.1.0-e", wheel, pip)._replace(environment="other")
    pip.write_bytes(pip.read_bytes() + b"x")
    refused = computer.deploy(tampered, "0.1.0-d")
    assert (refused.ending, "hash differs, refused" in refused.detail) == ("failed", True)
    assert computer.current() == "0.1.0-d"

    for step in plan.removal(computer.target):
        assert computer.run(step)[0] == 0
    left = {path for path in computer.root.rglob("*") if path.is_file()} - set(untouched)
    assert {path.name for path in left} == {"systemctl.log"}
    assert not (computer.root / "opt/ahdc").exists()


def test_a_first_release_that_fails_leaves_nothing_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(tmp_path, monkeypatch)
    release = Release("broken-a", "e", tmp_path / "files", tmp_path / "wheels", "", "", "", "", "")
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "unit").write_text("broken-a")
    (tmp_path / "files" / "rules").write_text("")
    (tmp_path / "wheels").mkdir()
    steps = [
        step for step in plan.deployment(computer.target, release, "ready") if step.name not in ("install", "check")
    ]
    outcome = follow(
        "r06", steps, lambda: plan.rollback(computer.target, "", "ready"), computer.run, print, release, ""
    )
    assert outcome.ending == "rolled back"
    assert not list((computer.root / "etc/systemd/system").iterdir())
    assert not (computer.base / "current").is_symlink()


def test_the_station_can_only_deploy_what_is_installed(tmp_path: Path) -> None:
    digest = hashlib.sha256(bundle.pip_wheel(tmp_path).read_bytes()).hexdigest()
    assert hashlib.sha256(bundle.pip_wheel(tmp_path / "again").read_bytes()).hexdigest() == digest
