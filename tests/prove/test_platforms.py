"""Every locked package has a wheel, with a locked hash, for both processors and every Python from 3.11 to 3.13.

Asks the package index for what pip would install on each; downloads descriptions, installs nothing.
"""

import json
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

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
