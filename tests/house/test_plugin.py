"""docs/testing-your-own.md, run against the wheel in a fresh environment outside the checkout."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.house.checkout import ROOT
from tests.house.test_wheel import home, run, wheel

__all__ = ["home", "wheel"]

PAGE = (ROOT / "docs" / "testing-your-own.md").read_text()
FAMILY = """
from drivers.serial.arduino import Drive, check, open_port
from drivers.serial import arduino
from typing import Literal

class Options(arduino.Options, frozen=True, forbid_unknown_fields=True, kw_only=True):
    kind: Literal["mywheels"]
"""


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def installed(folder: Path, name: str, group: str, toml: str) -> None:
    """What pip leaves behind of a distribution whose ``pyproject.toml`` has this entry point."""
    dist = folder / f"{name}-1.dist-info"
    dist.mkdir()
    (dist / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    assert f'entry-points."{group}"' in toml
    (line,) = re.findall(r'^\w+ = ".*"$', toml, re.MULTILINE)
    (dist / "entry_points.txt").write_text(f"[{group}]\n{line.replace(chr(34), '')}\n")


@pytest.mark.timeout(120)
def test_the_pages_tests_and_ci_recipe_pass_with_the_wheel(home: Path, tmp_path: Path) -> None:
    tests, family, law, law_test = blocks("python")
    (tmp_path / "test_wheels.py").write_text(tests + "\n\n" + law_test)
    (tmp_path / "mylaw.py").write_text(law)
    drivers, laws, _ = blocks("toml")
    installed(tmp_path, "mylaw", "ahdc.laws", laws)
    assert max(len(part.strip().splitlines()) for part in tests.split("\n\n")) <= 15
    (recipe,) = blocks("yaml")
    command = re.findall(r"run: (pytest .*)", recipe)[0].split()
    assert re.search(r"run: pip install ahdc-fieldkit pytest", recipe)
    out = run(home / "bin" / "python", "-m", *command, "-q", "-p", "no:cacheprovider", cwd=tmp_path)
    assert "3 passed" in out, out
    package = tmp_path / "mywheels"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "family.py").write_text(family)
    (package / "driver.py").write_text(FAMILY)
    (package / "emulated.py").write_text("from drivers.mock.arduino import emulate\n")
    installed(tmp_path, "mywheels", "ahdc.drivers", drivers)
    listed = subprocess.run(
        [home / "bin" / "python", "-m", "drivers", "list", "mywheels"],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert 'kind = "mywheels"' in listed.stdout, listed.stderr
    assert "auto-stop" in listed.stdout.lower() or "AUTO_STOP" in listed.stdout
    words = ["simulate", "--profile", "straight", "--robots", "2", "--targets", "2", "--runs", "1", "--workers", "1"]
    swept = run(home / "bin" / "python", "-m", "groundstation", *words, "--limit-s", "60", cwd=tmp_path)
    assert "1 of 1" in swept or "completed" in swept, swept
