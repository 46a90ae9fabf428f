"""A whole mock arena in real processes, driven from the test: waits are on conditions, each bounded."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from contract.messages import FeedbackBatch, Message, MocapHealth, MotorBatch, MotorSample, RobotReport, WheelFeedback
from groundstation import rig
from groundstation.conduct import Conductor, new_session
from groundstation.course import Plan
from groundstation.link import Link
from groundstation.targets import cloud_of

ROOT = Path(__file__).parents[2]
PATIENCE_S = 40.0


class Running:
    """An arena of processes, the station in this one, and everything the emulated motors saw."""

    def __init__(
        self, out: Path, robots: int, targets: int, seed: int = 1, record: bool = False, arena: str = "experiment2"
    ) -> None:
        changes = rig.Changes(robots=robots, targets=targets, seed=seed)
        self.arena = rig.mock_arena(rig.find_arena(arena), out, changes)
        self.out = out
        self.rig = rig.Rig(self.arena, out, record=record)
        self.motors: dict[str, MotorBatch] = {}
        self.samples: dict[str, list[MotorSample]] = {name: [] for name in self.arena.robots}
        self.feedback: dict[str, WheelFeedback] = {}
        self.health: MocapHealth | None = None

    def __enter__(self) -> "Running":
        self.rig.__enter__()
        try:
            self.rig.start()
            cloud = cloud_of(self.arena, "test")
            self.link = Link(self.arena, "station").__enter__()
        except BaseException:
            self.rig.end()
            raise
        self.session = new_session(self.arena, cloud, Plan(automatic=True, timeout_s=120.0), self.link)
        self.conductor = Conductor(self.arena, self.session, cloud, self.link)
        self.watcher = Link(self.arena, "watcher").__enter__()
        keys = self.watcher.keys
        self.watcher.subscribe([keys.mocap_health])
        self.watcher.subscribe(key for name in self.arena.robots for key in (keys.motor(name), keys.feedback(name)))
        return self

    def __exit__(self, *exception: object) -> None:
        self.watcher.__exit__()
        self.link.__exit__()
        self.codes = self.rig.end()

    def turn(self) -> None:
        self.rig.family.check()
        self.conductor.turn()
        for _, message in self.watcher.drain():
            self._note(message)

    def _note(self, message: Message) -> None:
        if isinstance(message, MotorBatch):
            self.motors[message.robot] = message
            self.samples[message.robot] += message.samples
        elif isinstance(message, FeedbackBatch):
            self.feedback[message.robot] = message.samples[-1]
        elif isinstance(message, MocapHealth):
            self.health = message

    def until(self, done: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
        """Keep the station going until ``done``; fails naming what did not happen, and how everybody is."""
        deadline = time.monotonic() + patience_s
        while not done():
            if time.monotonic() > deadline:
                reports = "\n".join(
                    f"{name}: {report.run} {report.reason} {report.counters}" for name, report in self.reports.items()
                )
                pytest.fail(
                    f"not within {patience_s:g} s: {what}\n{self.session.phase} {self.session.detail}\n{reports}"
                )
            self.turn()

    @property
    def reports(self) -> dict[str, RobotReport]:
        return self.session.reports

    def moving(self, name: str) -> bool:
        return name in self.motors and abs(self.motors[name].true_speed_mps) > 0.05

    def at_rest(self) -> bool:
        return len(self.motors) == len(self.arena.robots) and all(
            abs(batch.true_speed_mps) < 0.005 for batch in self.motors.values()
        )

    def drop_samples(self) -> None:
        for samples in self.samples.values():
            samples.clear()

    def command(self, *words: str) -> "subprocess.Popen[str]":
        """A verb of the ground station in another process."""
        return subprocess.Popen(
            [sys.executable, "-m", "groundstation", *words],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )


def is_zero(sample: MotorSample) -> bool:
    return sample.left_radps == 0.0 == sample.right_radps


def open_files(pid: int) -> set[str]:
    """What a process has open, links resolved."""
    folder = Path(f"/proc/{pid}/fd")
    found = set()
    for entry in folder.iterdir():
        try:
            found.add(os.readlink(entry))
        except FileNotFoundError:
            continue
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """One robot (odrive over slcan), one target; tests of a module use it in order."""
    with Running(tmp_path_factory.mktemp("one"), robots=1, targets=1) as running:
        yield running


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """An odrive over slcan and a roboclaw over serial."""
    with Running(tmp_path_factory.mktemp("two"), robots=2, targets=12) as running:
        yield running
