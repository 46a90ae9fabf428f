"""Machine code of the law plays the very missions that its sources play, and plays them in less time."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from groundstation import compiled

CASES = (
    ("ideal", "6", "19", ()),
    ("field", "6", "19", ()),
    ("field", "10", "40", ()),
    ("field", "3", "9", ("--wire",)),
    ("field", "5", "19", ("--profile", "paper", "--limit-s", "30")),
    ("field", "5", "19", ("--loss", "0.3", "--pose-age-ms", "20:150")),
)
RUNS = "4"


SAVED = ("ideal", "3", "6", ())
RECORDING = "seed-1"


def simulate(path: Path, case: tuple[str, str, str, tuple[str, ...]], machine_code: bool) -> float:
    """The sweep's file, and how long it took, s."""
    conditions, robots, targets, more = case
    command = [sys.executable, "-m", "groundstation", "simulate", "--runs", RUNS, "--robots", robots]
    began = time.monotonic()
    subprocess.run(
        [*command, "--targets", targets, "--conditions", conditions, "--seed", "1", "--json", str(path), *more],
        env={**os.environ, compiled.OFF: "1" if machine_code else "0"}, capture_output=True, check=False,
    )  # fmt: skip
    return time.monotonic() - began


@pytest.mark.timeout(0)
def test_missions_are_the_same_bit_for_bit(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "groundstation", "compile"], check=True)
    assert compiled.current() is not None
    for number, case in enumerate(CASES):
        plain, swift = tmp_path / f"{number}-plain.json", tmp_path / f"{number}-swift.json"
        plain_s, swift_s = simulate(plain, case, machine_code=False), simulate(swift, case, machine_code=True)
        words = re.sub(r"[(),']", "", str(case))
        print(f"{words}: {plain_s:.1f} s, compiled {swift_s:.1f} s, {plain_s / swift_s:.2f} times as fast", flush=True)
        assert plain.read_bytes() == swift.read_bytes(), case
    recordings = []
    for machine_code in (False, True):
        folder = tmp_path / f"saved-{machine_code}"
        case = (*SAVED[:3], ("--runs", "1", "--save", str(folder)))
        simulate(tmp_path / "saved.json", case, machine_code)
        recordings.append((folder / RECORDING / "run.mcap").read_bytes())
    assert recordings[0] == recordings[1]
