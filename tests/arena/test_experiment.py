"""An experiment on running robots: they drive home between the trials, and every trial is a run of its own."""

import csv
import json
import subprocess
import sys
from pathlib import Path

from groundstation import rig
from tests.arena.conftest import ROOT

FILE = """
name = "pair"
backend = "robots"
arena = "config.toml"
targets = [2]
seeds = [1, 2]
timeout_s = 60
"""


def test_two_trials_on_running_robots(tmp_path: Path) -> None:
    arena = rig.mock_arena(rig.find_arena("experiment2"), tmp_path, rig.Changes(robots=2))
    file = tmp_path / "pair.toml"
    file.write_text(FILE)
    out = tmp_path / "out"
    with rig.Rig(arena, tmp_path, record=False) as processes:
        processes.start()
        words = [sys.executable, "-m", "groundstation", "experiment", str(file), "--out", str(out)]
        ended = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=200)
        codes = processes.end()
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert set(codes.values()) == {0}
    rows = list(csv.DictReader((out / "trials.csv").open()))
    assert [(row["trial"], row["ending"], row["robots"], row["profile"]) for row in rows] == [
        ("m2-s1-k1", "completed", "2", "field"),
        ("m2-s2-k1", "completed", "2", "field"),
    ]
    for row in rows:
        folder = out / row["folder"]
        assert json.loads((folder / "metrics.json").read_bytes())["mission_s"] == float(row["mission_s"])
        assert (folder / "manifest.json").exists()
    assert "100% [34%, 100%]" in ended.stdout
