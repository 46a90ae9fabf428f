"""Deployment to a booted Debian: install, mission over QUIC and mTLS, hang, upgrade, rollback, tampering, removal.

Needs root and, once, Debian's packages (tests/guest/robot_computer.py makes the system). Tests build on one another.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from contract import overlay
from contract.arena import load, table_of
from drivers.registry import wheel_faults
from groundstation import rig
from groundstation.conduct import Conductor, new_session
from groundstation.course import Plan
from groundstation.deploy import Deployment
from groundstation.deployment.facts import Facts
from groundstation.deployment.plan import Release, Step
from groundstation.deployment.remote import Ssh
from groundstation.deployment.workshop import Workshop
from groundstation.link import Link
from groundstation.processes import Family
from groundstation.targets import cloud_of
from tests.guest.robot_computer import ADDRESS, STATION, RobotComputer, robot_computer
from tests.house.checkout import ROOMS, ROOT

INSIDE, OUTSIDE = "r06", "r08"
PATIENT = {
    "watchdog_s": 1.5,
    "driver_silence_s": 1.0,
    "heartbeat_timeout_s": 2.0,
    "report_age_s": 2.0,
    "report_silence_s": 10.0,
    "loop_overrun_s": 1.0,
}
"""Time is not what this proves, and a deployment beside the mission holds up everything on two cores."""
UNIT = f"ahdc-robot-{INSIDE}.service"
pytestmark = [pytest.mark.timeout(1800), pytest.mark.skipif(os.geteuid() != 0, reason="needs root")]


def copied(folder: Path) -> Path:
    """The packages and the lock file in a folder of their own."""
    for room in ROOMS:
        shutil.copytree(ROOT / room, folder / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "requirements.lock", folder)
    return folder


class Site:
    """The station's side: arena file, keys, the outside processes, and the deploy command."""

    def __init__(self, computer: RobotComputer, folder: Path) -> None:
        self.computer = computer
        self.folder = folder
        self.arena_file = folder / "lab.toml"
        arena = rig.mock_arena(rig.find_arena("experiment2"), folder, rig.Changes(robots=2, targets=4, seed=3))
        table = table_of(arena)
        table["robots"][INSIDE]["host"] = ADDRESS
        table["robots"][INSIDE]["wheels"]["watchdog_s"] = PATIENT["watchdog_s"]
        table["safety"] |= PATIENT
        table["control"]["max_speed_mps"] = 0.3
        table["link"] = {"router": f"quic/{STATION}:7447", "keys": "keys"}
        self.write(table)
        self.family = Family()
        self.source = copied(folder / "source")
        """What is deployed: a copy, so that a change in the checkout meanwhile is no other release."""

    def write(self, table: dict[str, Any]) -> None:
        whole = {key: value for key, value in table.items() if not isinstance(value, dict)} | table
        self.arena_file.write_text(overlay.text_of(whole))

    def verb(self, *words: str, python_path: Path | None = None) -> tuple[int, str]:
        environment = {**os.environ, "PYTHONPATH": str(python_path or self.source)}
        done = subprocess.run(
            [sys.executable, "-m", "groundstation", *words],
            cwd=python_path or self.source,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        print(done.stdout)
        return done.returncode, done.stdout

    def deploy(self, *words: str, python_path: Path | None = None) -> tuple[int, str]:
        ssh = [f"--ssh={word}" for word in self.computer.ssh]
        return self.verb("deploy", str(self.arena_file), *ssh, *words, python_path=python_path)

    def start(self, name: str, module: str, *arguments: str) -> None:
        verb, rest = list(arguments[:1]), list(arguments[1:])
        command = [*verb, "--arena", str(self.arena_file), *rest]
        self.family.start(name, module, command, self.folder / f"{name}.log", rig.REALTIME_NICENESS)

    def state(self) -> dict[str, str]:
        text = self.computer.shell(f"systemctl show {UNIT} -p ActiveState,StatusText,NRestarts,MainPID,Result")
        return dict(line.split("=", 1) for line in text.splitlines())

    def releases(self) -> list[str]:
        return sorted(self.computer.shell(f"ls /opt/ahdc/{INSIDE}/releases").split())

    def current(self) -> str:
        return self.computer.shell(f"basename $(readlink /opt/ahdc/{INSIDE}/current)").strip()

    def until(self, done: Callable[[], bool], what: str, patience_s: float = 40.0) -> None:
        deadline = time.monotonic() + patience_s
        while not done():
            assert time.monotonic() < deadline, f"not within {patience_s:g} s: {what}: {self.state()}"
            time.sleep(0.2)

    def well(self) -> bool:
        state = self.state()
        return state["ActiveState"] == "active" and state["StatusText"].startswith("disarmed")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Router, bridge, emulated hardware and the second robot here; an untouched computer for the first."""
    folder = Path("/run/ahdc-prove-deploy")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    with robot_computer(tmp_path_factory.mktemp("computer")) as computer:
        computer.share_terminals()
        made = Site(computer, folder)
        try:
            assert made.verb("keys", "init", "--arena", str(made.arena_file))[0] == 0
            assert made.verb("keys", "issue", "--arena", str(made.arena_file))[0] == 0
            made.start("router", "groundstation", "router")
            made.family.wait_ready(40.0)
            made.start("bridge", "mocap_bridge", "run")
            made.start("arena", "groundstation.mock_arena")
            made.family.wait_ready(40.0)
            made.start(OUTSIDE, "onboard", "run", "--robot", OUTSIDE)
            made.family.wait_ready(40.0)
            port = folder / "ports" / INSIDE
            terminal = os.path.realpath(port)
            os.chmod(terminal, 0o666)
            computer.shell(f"mkdir -p {port.parent}; ln -sfn {terminal} {port}")
            yield made
        finally:
            made.family.end()
            shutil.rmtree(folder, ignore_errors=True)


def files(computer: RobotComputer) -> str:
    """Every path of the system that is there to stay, and who may log in."""
    script = "find / -xdev -path /var/log/journal -prune -o -path /tmp -prune -o -path /var/tmp -prune -o -print | sort"
    return computer.shell(f"{script}; cat /etc/passwd /etc/group")


@pytest.fixture(scope="module")
def untouched(site: Site) -> str:
    return files(site.computer)


def test_a_dry_run_changes_nothing(site: Site, untouched: str) -> None:
    code, said = site.deploy("--dry-run")
    assert code == 0
    assert "would: " in said
    assert files(site.computer) == untouched


def test_fresh_install(site: Site, untouched: str) -> None:
    code, said = site.deploy("--only", INSIDE)
    assert code == 0
    assert re.search(rf"{INSIDE} +{ADDRESS} +x86_64 +3\.11\.\d+ +- +0\.\d+\.\d+-[0-9a-f]+ +done", said)
    state = site.state()
    assert state["StatusText"].startswith("disarmed")
    assert f"[{site.current()}]" in state["StatusText"]
    assert "verified" in site.computer.shell(
        f"systemd-analyze verify {UNIT} && systemctl is-enabled {UNIT} && echo verified"
    )
    assert "self-check: chrony: chrony does not run" in site.computer.shell(f"journalctl -u {UNIT} -o cat --no-pager")
    assert "latency_timer" in site.computer.shell(f"cat /etc/udev/rules.d/80-ahdc-{INSIDE}.rules")
    key = f"/opt/ahdc/{INSIDE}/current/keys/{INSIDE}/private.key"
    assert site.computer.shell(f"stat -c '%a %U %G' {key}").split() == ["640", "root", "ahdc"]
    assert site.computer.shell(f"ps -o user= -p {state['MainPID']}").strip() == "ahdc"


def test_a_mission_over_quic_and_mutual_tls_and_no_deployment_meanwhile(site: Site) -> None:
    arena = load(site.arena_file, wheel_faults)
    cloud = cloud_of(arena, "container")
    refused: list[tuple[int, str]] = []
    with Link(arena, "station") as link:
        session = new_session(arena, cloud, Plan(automatic=True, timeout_s=300.0), link)
        conductor = Conductor(arena, session, cloud, link)
        assert conductor.until(lambda: session.phase == "running", 60.0), session.detail
        ssh = [f"--ssh={word}" for word in site.computer.ssh]
        command = [sys.executable, "-m", "groundstation", "deploy", str(site.arena_file), *ssh]
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as other:
            assert conductor.until(lambda: other.poll() is not None, 60.0)
            assert other.stdout is not None
            refused.append((other.returncode, other.stdout.read()))
        assert conductor.until(lambda: session.phase in ("completed", "stopped", "failed"), 320.0)
        assert session.phase == "completed", session.detail
        assert conductor.until(lambda: session.at_rest, 10.0)
        assert session.reports[INSIDE].software
    (ending,) = refused
    assert ending[0] == 1
    assert "is running: software is not changed now" in ending[1]


def test_the_pages_commands_for_a_robot_without_deploy(site: Site) -> None:
    there = f"root@{ADDRESS}"
    site.computer.shell("mkdir -p /etc/ahdc")
    bundle = site.folder / "keys" / f"{INSIDE}.tar"
    subprocess.run(
        ["scp", "-q", *site.computer.ssh, str(site.arena_file), str(bundle), f"{there}:/etc/ahdc/"], check=True
    )
    unpack = ["tar", "-xpf", f"/etc/ahdc/{INSIDE}.tar", "-C", "/etc/ahdc"]
    subprocess.run(["ssh", *site.computer.ssh, there, *unpack], check=True)
    onboard = f"/opt/ahdc/{INSIDE}/current/env/bin/ahdc-onboard"
    site.computer.shell(f"{onboard} check --arena /etc/ahdc/{site.arena_file.name} --robot {INSIDE}")
    assert site.computer.shell("stat -c %a /etc/ahdc/keys/*/private.key").split() == ["600"]
    assert "disarmed" in site.computer.shell(f"systemctl status {UNIT}")
    site.computer.shell("rm -r /etc/ahdc")


def test_a_hung_agent_is_killed_and_comes_back_disarmed(site: Site) -> None:
    site.until(site.well, "disarmed after the mission")
    before = site.state()
    site.computer.shell(f"kill -STOP {before['MainPID']}")
    site.until(lambda: site.state()["NRestarts"] == str(int(before["NRestarts"]) + 1), "a restart")
    site.until(site.well, "disarmed again")
    after = site.state()
    assert after["MainPID"] != before["MainPID"]
    assert "watchdog" in site.computer.shell(f"journalctl -u {UNIT} -o cat --no-pager").lower()


def changed(site: Site, seed: int) -> None:
    """The arena file with something else in it, so that there is another release."""
    table = table_of(load(site.arena_file, wheel_faults))
    table["link"]["keys"] = "keys"
    table["targets"]["seed"] = seed
    site.write(table)


def test_upgrade_and_back_and_forth(site: Site) -> None:
    first = site.current()
    changed(site, 11)
    code, _ = site.deploy()
    assert code == 0
    second = site.current()
    assert second != first
    assert site.releases() == sorted({first, second})
    assert site.deploy("--rollback")[0] == 0
    assert site.current() == first
    assert f"[{first}]" in site.state()["StatusText"]
    assert site.deploy("--rollback")[0] == 0
    assert site.current() == second


def test_an_upgrade_that_fails_is_taken_back(site: Site, tmp_path: Path) -> None:
    before = site.current()
    source = copied(tmp_path / "source")
    runtime = source / "onboard" / "runtime.py"
    broken = runtime.read_text().replace("self._loop()", 'raise RuntimeError("a bug")')
    assert broken != runtime.read_text()
    runtime.write_text(broken)
    code, said = site.deploy(python_path=source)
    assert code == 1
    assert "rolled back" in said
    assert "a bug" in said
    assert site.current() == before
    assert f"[{before}]" in site.state()["StatusText"]
    assert site.well()


def test_a_tampered_wheel_is_refused_before_anything_is_switched(site: Site, tmp_path: Path) -> None:
    before = site.current()
    changed(site, 12)
    arena = load(site.arena_file, wheel_faults)

    class Tampering(Ssh):
        """Swaps a byte of a wheel once it is on the robot."""

        def __call__(self, step: Step) -> tuple[int, str]:
            done = super().__call__(step)
            if step.name == "copy":
                wheel = f"/opt/ahdc/{INSIDE}/wheels/msgspec*.whl"
                site.computer.shell(f"printf X | dd of=$(ls {wheel}) bs=1 seek=5000 conv=notrunc status=none")
            return done

    class Elsewhere(Workshop):
        """Asks for an environment that is not there yet."""

        def release(self, robot: str, facts: Facts) -> Release:
            return super().release(robot, facts)._replace(environment="0" * 12)

    deployment = Deployment(arena, [INSIDE], {INSIDE: Tampering(ADDRESS, "root", 22, tuple(site.computer.ssh))})
    visit = deployment.install(INSIDE, Elsewhere(arena, tmp_path), dry=False)
    assert visit.outcome.ending == "failed"
    assert "hash" in visit.outcome.detail.lower()
    assert site.current() == before
    assert site.well()


def test_removal_leaves_nothing(site: Site, untouched: str) -> None:
    code, _ = site.deploy("--remove")
    assert code == 0
    now = files(site.computer)
    left = sorted(set(now.splitlines()) - set(untouched.splitlines()))
    assert left == []
