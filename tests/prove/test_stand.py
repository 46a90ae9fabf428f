"""Real-time missions by the arena file alone: a robot on a stand among emulated ones, tracked beside virtual bodies."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import tomlkit

from contract.arena import table_of
from drivers.registry import family_of
from groundstation import rig
from groundstation.emulated import EmulatedPort
from tests.arena.conftest import ROOT, Running


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


class Mixed(Running):
    """The first robot is tracked by cameras that another program has, its wheels are real, so far as we know."""

    def __init__(self, out: Path) -> None:
        super().__init__(out, robots=3, targets=3)
        self.name = next(iter(self.arena.robots))
        robot = self.arena.robots[self.name]
        replace = msgspec.structs.replace
        theirs = replace(self.arena, robots={self.name: robot})
        self.arena = replace(self.arena, robots={**self.arena.robots, self.name: replace(robot, emulate=())})
        self.rig = rig.Rig(self.arena, out, record=False)
        self.file = out.parent / "cameras" / "config.toml"
        self.file.parent.mkdir()
        self.file.write_text(tomlkit.dumps(table_of(theirs)), encoding="utf-8")
        self.cameras: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "Mixed":
        command = [sys.executable, "-m", "groundstation.mock_arena", "--arena", str(self.file)]
        self.cameras = subprocess.Popen(command, cwd=ROOT)
        try:
            super().__enter__()
        except BaseException:
            self.cameras.kill()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        super().__exit__(*exception)
        assert self.cameras is not None
        self.cameras.terminate()
        self.cameras.wait(10.0)


@pytest.mark.timeout(240)
def test_a_mission_completes_with_tracked_and_virtual_bodies(tmp_path: Path) -> None:
    with Mixed(tmp_path / "run") as running:
        assert set(running.arena.virtual_beside_tracked()) == set(running.arena.robots) - {running.name}
        far = dict.fromkeys(running.arena.robots, 0.0)

        def over() -> bool:
            for name, batch in running.motors.items():
                far[name] = max(far[name], abs(batch.true_speed_mps))
            return running.session.phase == "completed"

        running.until(over, "the mission completes", 120.0)
        assert min(far.values()) > 0.05, far
        assert running.health is not None
        assert {body.robot for body in running.health.bodies if body.valid} == set(running.arena.robots)
