"""What the service manager hears, read from a socket of our own; when the watchdog is petted, state by state."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.safety import POWERED, STATES
from onboard.service import Service
from onboard.vitals import MOTORS_ON, PATIENCE_S, Vitals, stale
from tests.house.checkout import ROOT

SECOND = 1_000_000_000
LONG = int(PATIENCE_S * SECOND)
START = 1000 * SECOND


class Manager:
    """systemd's end of the notification socket."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.setblocking(False)
        self.environment = {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": "2000000", "AHDC_RELEASE": "0.1.0-abc"}

    def heard(self) -> list[str]:
        found = []
        while True:
            try:
                found.append(self.socket.recv(4096).decode())
            except BlockingIOError:
                return found


@pytest.fixture
def manager(tmp_path: Path) -> Manager:
    return Manager(tmp_path / "notify")


def vitals(run: str, frame_ns: int = 0, feedback_ns: int = 0, reason: str = "") -> Vitals:
    return Vitals(run, reason, frame_ns, feedback_ns)  # type: ignore[arg-type]


def test_the_powered_states_are_the_supervisors() -> None:
    assert MOTORS_ON == POWERED


@pytest.mark.parametrize("run", STATES)
@pytest.mark.parametrize("pose", [True, False])
@pytest.mark.parametrize("motors", [True, False])
def test_fresh_means_something_else_in_each_state(run: str, pose: bool, motors: bool) -> None:
    now = START + LONG + SECOND
    of = vitals(run, now if pose else START, now if motors else START)
    words = stale(of, now, START)
    assert bool(words) == (run in POWERED and not (pose and motors))
    if words:
        assert ("pose frame" if not pose else "wheel feedback") in words


@given(st.integers(0, 2 * LONG), st.integers(0, 2 * LONG), st.integers(0, 2 * LONG))
def test_what_was_missing_before_the_motors_were_on_does_not_count(frame: int, feedback: int, powered: int) -> None:
    now = START + 2 * LONG
    words = stale(vitals("armed", START + frame, START + feedback), now, START + powered)
    assert bool(words) == (now - START - max(powered, min(frame, feedback)) > LONG)


def test_a_robot_without_motion_capture_is_never_restarted(manager: Manager) -> None:
    service = Service(manager.environment)
    said = []
    for turn in range(200):
        assert service.beat(vitals("disarmed", reason="no pose frame arrives"), START + turn * SECOND) == ""
        said += manager.heard()
    assert len(said) == 200
    assert all(text.startswith("WATCHDOG=1") for text in said)
    assert "STATUS=disarmed: no pose frame arrives [0.1.0-abc]" in said[0]


def test_a_powered_robot_that_hears_nothing_is_given_up_once_and_says_why_once(manager: Manager) -> None:
    service = Service(manager.environment)
    for turn in range(20):
        now = START + turn * SECOND
        assert service.beat(vitals("running", now, now), now) == ""
        manager.heard()
    last = START + 19 * SECOND
    told, petted = [], 0
    for turn in range(1, 15):
        told.append(service.beat(vitals("running", last, last + turn * SECOND), last + turn * SECOND))
        petted += len(manager.heard())
    assert [text for text in told if text] == ["running, and no pose frame for 10 s"]
    assert petted == 10


def test_arming_begins_a_new_patience(manager: Manager) -> None:
    service = Service(manager.environment)
    for turn in range(100):
        service.beat(vitals("disarmed"), START + turn * SECOND)
    assert service.beat(vitals("armed"), START + 100 * SECOND) == ""
    assert service.beat(vitals("armed"), START + 109 * SECOND) == ""
    assert service.beat(vitals("armed"), START + 110 * SECOND)


def test_petting_is_four_times_as_often_as_asked_and_not_more(manager: Manager) -> None:
    service = Service(manager.environment)
    said = 0
    for turn in range(1000):
        service.beat(vitals("disarmed"), START + turn * SECOND // 100)
        said += len(manager.heard())
    assert 20 <= said <= 21


def test_ready_waiting_and_stopping_are_datagrams(manager: Manager) -> None:
    service = Service(manager.environment)
    service.waiting("waits for the router")
    service.ready("disarmed\nand well")
    service.stopping()
    assert manager.heard() == [
        "STATUS=waits for the router [0.1.0-abc]",
        "READY=1\nSTATUS=disarmed and well [0.1.0-abc]",
        "STOPPING=1",
    ]


def test_a_managed_robot_checks_its_computer_before_anything_else(manager: Manager, tmp_path: Path) -> None:
    wheels = f'{{ kind = "ros_arduino", port = "{tmp_path}/none", counts_per_revolution = 2048, watchdog_s = 0.2 }}'
    (tmp_path / "a.toml").write_text(
        '[arena]\nname = "a"\nsize_m = [4.0, 4.0]\n[link]\nrouter = "tcp/127.0.0.1:1"\n'
        f'[robots.r06]\nbody = "r06"\nstart = [1.0, 1.0]\nwheels = {wheels}\n'
    )
    command = [sys.executable, "-m", "onboard", "run", "--arena", str(tmp_path / "a.toml"), "--robot", "r06"]
    with subprocess.Popen(
        command, cwd=ROOT, env={**os.environ, **manager.environment}, stderr=subprocess.PIPE, text=True
    ) as robot:
        assert robot.stderr is not None
        assert robot.stderr.readline().startswith("self-check: ")
        robot.kill()


def test_without_a_manager_or_with_one_that_is_gone_nothing_happens(tmp_path: Path) -> None:
    assert not Service({}).managed
    service = Service({"NOTIFY_SOCKET": str(tmp_path / "gone"), "WATCHDOG_USEC": "100"})
    service.ready("x")
    assert service.beat(vitals("running", START, START), START) == ""


def test_an_abstract_address_is_heard() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind("\0ahdc-test-notify")
        Service({"NOTIFY_SOCKET": "@ahdc-test-notify"}).ready("up")
        assert ear.recv(100) == b"READY=1\nSTATUS=up"
