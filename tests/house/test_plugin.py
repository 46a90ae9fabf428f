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


@pytest.mark.timeout(120)
def test_the_pages_tests_and_ci_recipe_pass_with_the_wheel(home: Path, tmp_path: Path) -> None:
    (tests, family) = blocks("python")
    (tmp_path / "test_wheels.py").write_text(tests)
    assert max(len(part.strip().splitlines()) for part in tests.split("\n\n")) <= 15
    (recipe,) = blocks("yaml")
    command = re.findall(r"run: (pytest .*)", recipe)[0].split()
    assert re.search(r"run: pip install ahdc-fieldkit pytest", recipe)
    out = run(home / "bin" / "python", "-m", *command, "-q", "-p", "no:cacheprovider", cwd=tmp_path)
    assert "2 passed" in out, out
    package = tmp_path / "mywheels"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "family.py").write_text(family)
    (package / "driver.py").write_text(FAMILY)
    (package / "emulated.py").write_text("from drivers.mock.arduino import emulate\n")
    dist = tmp_path / "mywheels-1.dist-info"
    dist.mkdir()
    (dist / "METADATA").write_text("Metadata-Version: 2.1\nName: mywheels\nVersion: 1\n")
    (toml,) = blocks("toml")
    (entry,) = re.findall(r'^(mywheels) = "(.*)"$', toml, re.MULTILINE)
    (dist / "entry_points.txt").write_text(f"[ahdc.drivers]\n{entry[0]} = {entry[1]}\n")
    listed = subprocess.run(
        [home / "bin" / "python", "-m", "drivers", "list", "mywheels"],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert 'kind = "mywheels"' in listed.stdout, listed.stderr
    assert "auto-stop" in listed.stdout.lower() or "AUTO_STOP" in listed.stdout
