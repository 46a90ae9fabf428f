"""Every locked package has a wheel, with a locked hash, for both processors and every Python from 3.11 to 3.13.

Asks the package index for what pip would install on each; downloads descriptions, installs nothing. Then the
installations that the pages name, in a fresh environment.
"""

import json
import platform
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.house.checkout import ROOT, tracked
from tests.house.test_lock import LOCK, PYTHONS, pins

PLATFORMS = {
    "x86_64": ("manylinux2014_x86_64", "manylinux_2_28_x86_64"),
    "aarch64": ("manylinux2014_aarch64", "manylinux_2_28_aarch64"),
}


@pytest.mark.timeout(900)
@pytest.mark.parametrize("machine", PLATFORMS)
@pytest.mark.parametrize("python", PYTHONS)
def test_every_pin_has_a_locked_wheel(python: str, machine: str, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    wanted = pins(python, machine)
    command = [sys.executable, "-m", "pip", "install", "-qq", "--dry-run", "--no-deps", "--ignore-installed"]
    command += ["--ignore-requires-python", "--only-binary=:all:", f"--python-version={python}"]
    command += [f"--target={tmp_path / 'nowhere'}", *(f"--platform={name}" for name in PLATFORMS[machine])]
    command += [f"--report={report}", *(f"{name}=={version}" for name, version in wanted.items())]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    chosen = json.loads(report.read_text())["install"]
    assert {re.sub(r"[-_.]+", "-", item["metadata"]["name"]).lower() for item in chosen} == set(wanted)
    for item in chosen:
        digest = item["download_info"]["archive_info"]["hashes"]["sha256"]
        assert f"sha256:{digest}" in LOCK, f"{item['metadata']['name']} for {machine}, Python {python}"


def test_this_machine_is_one_of_them() -> None:
    assert platform.machine() in PLATFORMS


def installations() -> list[str]:
    """Every ``pip install`` of the pages, once; the index's own name for the field kit is this checkout here."""
    text = "\n".join(path.read_text() for path in tracked("*.md"))
    found = re.findall(r"pip install (\.|['\"](?:\.|ahdc-fieldkit)\[[a-z,]+\]['\"])", text)
    return sorted(
        {shlex.split(word)[0].replace("ahdc-fieldkit", ".") for word in found}, key=lambda word: (len(word), word)
    )


def test_pages_name_installations() -> None:
    assert {".", ".[station]", ".[station,test,dev]"} <= set(installations())


@pytest.mark.timeout(1800)
def test_every_pip_install_of_the_pages_gives_commands_that_run(tmp_path: Path) -> None:
    clone, home = tmp_path / "clone", tmp_path / "home"
    for path in tracked("."):
        (clone / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, clone / path.relative_to(ROOT))
    subprocess.run([sys.executable, "-m", "venv", str(home)], check=True)
    for what in installations():
        done = subprocess.run(
            [home / "bin" / "pip", "install", "-q", what], cwd=clone, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"pip install {what}\n{done.stderr}"
        for command in ("onboard", "drivers", "mocap-bridge", "groundstation"):
            said = subprocess.run(
                [home / "bin" / f"ahdc-{command}", "--help"], capture_output=True, text=True, check=False
            )
            assert "usage" in said.stdout, f"pip install {what}: ahdc-{command}: {said.stderr}"
