"""Robots, session and terminal on computers switched on on other days: every clock is another, site time is one.

At the end the bridge moves to another computer, and with it the time: robots end, to be started anew.
"""

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from contract.messages import MotorBatch, RobotReport, RunStatus
from groundstation import rig
from groundstation.link import Link
from groundstation.processes import Child
from tests.house.checkout import ROOT

DAY_S = 86_400
PATIENCE = 1200
"""Times that something is waited for, 50 ms each."""
AGE_MS = 60.0
"""A pose is younger than that: an offset that was not taken off would make it days."""


def elsewhen(days: int) -> tuple[str, ...]:
    return (sys.executable, str(ROOT / "tests/root/elsewhen.py"), str(days * DAY_S))


class Scattered(rig.Rig):
    """Everything but bridge and emulated hardware keeps a clock of its own."""

    days = 0

    def start_robot(self, name: str) -> Child:
        return self.other_day(name, "onboard", "run", "--arena", str(self.config), "--robot", name)

    def other_day(self, name: str, module: str, *words: str) -> Child:
        self.days += 1
        log = self.out / "logs" / f"{name}.log"
        return self.family.start(name, module, list(words), log, inside=elsewhen(self.days))

    def terminal(self, *words: str) -> None:
        """A verb of the ground station on yet another computer."""
        self.days += 1
        command = [*elsewhen(self.days), sys.executable, "-m", "groundstation", *words, "--arena", str(self.config)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stdout + done.stderr


def test_a_mission_of_computers_with_clocks_of_their_own(tmp_path: Path) -> None:
    arena = rig.mock_arena(rig.find_arena("experiment2"), tmp_path, rig.Changes(robots=2, targets=5))
    reports: dict[str, RobotReport] = {}
    status: list[RunStatus] = []
    moved: set[str] = set()

    with Scattered(arena, tmp_path, record=False) as scattered:
        scattered.start()
        scattered.other_day("session", "groundstation", "session", "--arena", str(scattered.config))
        scattered.family.wait_ready(60.0)
        with Link(arena, "watcher") as link:
            keys = link.keys
            link.subscribe([keys.status, *(key for r in arena.robots for key in (keys.report(r), keys.motor(r)))])

            def until(done: Callable[[], bool], what: str) -> None:
                for _ in range(PATIENCE):
                    for _, message in link.drain():
                        match message:
                            case RobotReport():
                                reports[message.robot] = message
                            case RunStatus():
                                status[:] = [message]
                            case MotorBatch() if abs(message.true_speed_mps) > 0.05:
                                moved.add(message.robot)
                    if done():
                        return
                    scattered.family.check()
                    link.wait(0.05)
                pytest.fail(f"{what}: {status} {reports}")

            until(lambda: bool(status) and status[0].phase == "ready", "ready")
            assert all(report.pose_valid and 0.0 <= report.pose_age_ms < AGE_MS for report in reports.values())
            scattered.terminal("arm")
            scattered.terminal("start")
            until(lambda: status[0].phase == "completed", "completed")
            assert moved == set(arena.robots)
            assert not [name for report in reports.values() for name in report.counters if "time" in name]
            scattered.terminal("stop")
        robots = [child for child in scattered.family.children if child.name in arena.robots]
        assert [child.code for child in robots] == [None, None]
        bridge = next(child for child in scattered.family.children if child.name == "bridge")
        bridge.signal(signal.SIGKILL)
        assert bridge.wait(10.0)
        scattered.family.forget("bridge")
        scattered.other_day("bridge", "mocap_bridge", "run", "--arena", str(scattered.config))
        for child in robots:
            assert child.wait(60.0), child.last_words()
            assert child.code == 1
            assert "the site keeps another time than before; to be started anew" in child.last_words()
