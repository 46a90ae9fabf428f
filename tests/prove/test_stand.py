"""A robot with wheels of its own (an emulator started by somebody else) under a virtual body, in real time."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from drivers.registry import family_of
from groundstation import rig
from groundstation.emulated import EmulatedPort
from tests.arena.conftest import Running


class OnStand(Running):
    """The first robot's wheels are no part of the rig; the second robot is emulated as usual."""

    def __init__(self, out: Path, wheels: EmulatedPort, kind: str) -> None:
        super().__init__(out, robots=2, targets=2)
        self.name = next(iter(self.arena.robots))
        family = family_of(kind)
        assert family is not None
        table = {"kind": kind, family.port_key: wheels.path, "counts_per_revolution": 2048}
        robot = msgspec.structs.replace(self.arena.robots[self.name], emulate=("body",), wheels=table)
        self.arena = msgspec.structs.replace(self.arena, robots={**self.arena.robots, self.name: robot})
        self.rig = rig.Rig(self.arena, out, record=False)


@pytest.fixture
def stand(tmp_path: Path) -> Iterator[tuple[OnStand, EmulatedPort]]:
    wheels = EmulatedPort("roboclaw", tmp_path, {"counts_per_revolution": 2048})
    with OnStand(tmp_path / "run", wheels, "roboclaw") as running:
        yield running, wheels
    wheels.close()


@pytest.mark.timeout(240)
def test_a_mission_completes_with_one_robot_on_a_stand(stand: tuple[OnStand, EmulatedPort]) -> None:
    running, wheels = stand
    turned = 0.0

    def over() -> bool:
        nonlocal turned
        turned = max(turned, *map(abs, wheels.speeds()))
        return running.session.phase == "completed"

    running.until(over, "the mission completes", 120.0)
    assert running.name not in running.motors, "the mock arena does not have these wheels"
    assert turned > 3.0
    assert any(sample.left_radps or sample.right_radps for sample in wheels.samples())
