"""The demo in real time with every controller family in turn, and with six families on six robots at once."""

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomlkit

from drivers.defaults import DEFAULTS
from drivers.registry import FAMILIES
from groundstation.rig import find_arena

SIX = ("odrive", "vesc", "cia402", "roboclaw", "dynamixel", "ros_arduino")
ALONE = {"vesc": {"watchdog_s": 0.2, "min_erpm": 100.0}, "ros_arduino": {"watchdog_s": 0.2}}
"""Options without which the family is not fit for this platform."""
ALONE["vesc_uart"] = ALONE["vesc"]


def wheels_of(kind: str) -> dict[str, Any]:
    family = next(family for family in FAMILIES if family.kind == kind)
    return {"kind": kind, family.port_key: "can0", **DEFAULTS[kind], **ALONE.get(kind, {})}


@pytest.mark.timeout(300)
@pytest.mark.parametrize("kinds", [*((family.kind,) for family in FAMILIES), SIX], ids=lambda kinds: "-".join(kinds))
def test_the_demo_completes(kinds: tuple[str, ...], tmp_path: Path) -> None:
    table = tomllib.loads(find_arena("experiment2").read_text(encoding="utf-8"))
    for index, robot in enumerate(table["robots"].values()):
        robot["wheels"] = wheels_of(kinds[index % len(kinds)])
        robot.pop("emulate", None)
    arena = tmp_path / "families.toml"
    arena.write_text(tomlkit.dumps(table), encoding="utf-8")
    command = ["-m", "groundstation", "demo", "--headless", "--arena", str(arena), "--out", str(tmp_path / "run")]
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=240)
    print(done.stdout[-600:])
    assert done.returncode == 0, done.stdout + done.stderr
