"""A running fleet for tests, and what its recordings say of a robot that was cut off."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from contract import network
from contract.messages import Message, MotorBatch, MotorSample, RobotReport
from groundstation import runfolder
from groundstation.files import RECORDING
from groundstation.fleet_operator import PATIENCE_S, Operator
from groundstation.metrics import Metrics
from groundstation.recording import Recording
from groundstation.weather import Weather
from tests.house.checkout import ROOT

HOLD_NS = 450_000_000
"""From the cut until a robot holds: poses silent for 0.15 s, a step, the motor's bus, the relay's 50 ms; and room."""


class Fleet(Operator):
    """A running fleet with its station."""

    missions = 1

    def cut(self, robot: str, seconds: float) -> tuple[int, int]:
        """Let nothing of the robot through the radio for so long; from and until when, site time ns."""
        self.site.weather(Weather(cut=(robot,)))
        began_ns = time.monotonic_ns()
        time.sleep(seconds)
        ended_ns = time.monotonic_ns()
        self.site.weather(Weather())
        return began_ns, ended_ns

    def next_mission(self) -> Path:
        """Begin another mission; where it is recorded."""
        self.again()
        self.missions += 1
        return self.folder

    @property
    def folder(self) -> Path:
        """The recording of this mission."""
        out = self.site.out
        return out if self.missions == 1 else out.with_name(f"{out.name}-{self.missions}")

    def attack(self, place: str, holder: str, **attempt: Any) -> "subprocess.Popen[bytes]":
        """An intruder with a holder's certificate, as a process of its own, in a member's namespace."""
        link = self.site.arena.link
        who = network.identity(link.keys, holder)
        assert who is not None
        words = {"endpoint": link.router, "files": list(who), "timeout_s": PATIENCE_S, **attempt}
        command = [*self.site.network.inside(place), sys.executable, "-m", "tests.root.intruder", json.dumps(words)]
        return subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def told(folder: Path) -> Iterator[Message]:
    """Everything recorded, in order."""
    return (entry.message for entry in Recording(folder / "run.mcap").messages() if entry.message is not None)


def commands(folder: Path, robot: str, began_ns: int, ended_ns: int) -> list[MotorSample]:
    """What the emulated motors decoded in that time; they are recorded over the wire."""
    mine = (batch for batch in told(folder) if isinstance(batch, MotorBatch) and batch.robot == robot)
    return [sample for batch in mine for sample in batch.samples if began_ns <= sample.stamp_ns <= ended_ns]


def assert_at_zero(samples: list[MotorSample]) -> None:
    assert samples, "the motors heard of it"
    moving = [sample for sample in samples if (sample.left_radps or sample.right_radps) and not sample.released]
    assert not moving


def reports_of(folder: Path, robot: str) -> list[RobotReport]:
    return [message for message in told(folder) if isinstance(message, RobotReport) and message.robot == robot]


def judged(folder: Path) -> Metrics:
    """What the mission came to; its network never split and nobody touched another."""
    metrics = runfolder.read(folder).metrics
    assert metrics is not None
    assert (metrics.disconnected_frames, metrics.collisions) == (0, 0)
    return metrics


def settled(folder: Path) -> None:
    """Until the recorder has written all that has been said so far: that is its second commit from now."""
    file, deadline = folder / RECORDING, time.monotonic() + PATIENCE_S
    for _ in range(2):
        size = file.stat().st_size
        while file.stat().st_size == size:
            assert time.monotonic() < deadline, f"nothing more is written into {file}"
            time.sleep(0.05)


def secrets_of(folder: Path) -> list[bytes]:
    """A line of every private key below it."""
    return [path.read_bytes().splitlines()[1] for path in folder.rglob("private.key")]


def written(folder: Path) -> bytes:
    """All that a mission leaves for others to read: its logs, its arena file, its recording uncompressed."""
    parts = [path.read_bytes() for path in (*folder.glob("logs/*"), folder / "config.toml")]
    for record in Recording(folder / "run.mcap").opened():
        parts.append(repr(record).encode())
    return b"".join(parts)
