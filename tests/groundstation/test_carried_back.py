"""A robot that was cut off near the fence may roll beyond it; before the next mission a hand carries it back."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from contract.arena import Arena, parse
from contract.keys import Keys
from contract.messages import Message
from groundstation.faultrig import Stage
from groundstation.mock_arena import FAULTS_FILE, INSIDE_M, MockArena

WHEELS = {"kind": "roboclaw", "counts_per_revolution": 2048}


class Heard:
    """The mock arena's link: what it tells goes to the stage."""

    keys = Keys("floor")

    def __init__(self) -> None:
        self.told: list[Message] = []

    def publish(self, _: str, message: Message, __: str) -> None:
        self.told.append(message)


class Turning(Stage):
    """A stage without a station: time passes in the mock arena alone."""

    def __init__(self, arena: Arena, mock: MockArena, link: Heard, folder: Path) -> None:
        self.arena, self.mock, self.heard = arena, mock, link
        self.rig: Any = SimpleNamespace(out=folder)
        self.session: Any = SimpleNamespace(phase="waiting", detail="")
        self.samples, self.places, self.reports, self.acknowledged_ns = {}, {}, {}, {}

    def turn(self) -> None:
        self.mock._read_faults()
        self.mock._publish(time.monotonic_ns())
        for message in self.heard.told:
            self._hear(message)
        self.heard.told.clear()


@pytest.fixture
def stage(tmp_path: Path) -> Turning:
    robots = {
        name: {"body": name, "start": [1.0 + k, 1.0], "emulate": ["wheels", "body"],
               "wheels": {**WHEELS, "port": str(tmp_path / name)}}
        for k, name in enumerate(("r01", "r02"))
    }  # fmt: skip
    arena = parse({"arena": {"name": "floor", "size_m": [4.0, 3.0], "fence_m": 0.2}, "robots": robots}, "floor")
    link = Heard()
    return Turning(arena, MockArena(arena, link, tmp_path / FAULTS_FILE), link, tmp_path)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("at", "inside"),
    [((3.9, 1.5), (3.8 - INSIDE_M, 1.5)), ((0.1, 2.9), (0.2 + INSIDE_M, 2.8 - INSIDE_M)), ((2.0, 0.1), (2.0, 0.22))],
)
def test_a_robot_beyond_the_fence_is_put_back_by_the_shortest_way(stage: Turning, at: Any, inside: Any) -> None:
    body, other = (robot.body for robot in stage.mock._wheels.robots.values())
    body.place(*at, 0.7)
    stage.turn()
    assert [stage.is_outside(name) for name in stage.arena.robots] == [True, False]
    stage._carry_back(["r01"])
    assert (body.x_m, body.y_m, body.heading_rad) == pytest.approx((*inside, 0.7))
    assert (other.x_m, other.y_m) == (2.0, 1.0)
    assert not any(map(stage.is_outside, stage.arena.robots))
    assert (stage.rig.out / FAULTS_FILE).read_text() == "", "it may be carried again"


def test_nobody_is_carried_who_has_not_been_seen(stage: Turning) -> None:
    assert not stage.is_outside("r01")


def test_a_hand_is_no_fault_of_motion_capture(stage: Turning, capsys: pytest.CaptureFixture[str]) -> None:
    stage.spoil("udp carried", "r03 carried")
    stage.turn()
    assert capsys.readouterr().err.count("is not ROBOT KIND; ignored") == 2
