"""An experiment in the mock arena, interrupted in a trial and resumed: every trial judged, the aborted one kept."""

import csv
import json
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.arena.conftest import ROOT

FILE = """
name = "pair"
backend = "mock"
arena = "experiment2"
robots = [2]
targets = [3]
seeds = [1, 2]
timeout_s = 60
"""
PATIENCE_S = 120.0


def heeding() -> None:
    """Also where the proof itself runs in the background of a shell, which then ignores SIGINT for all it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def begin(file: Path, out: Path) -> "subprocess.Popen[bytes]":
    words = [sys.executable, "-m", "groundstation", "experiment", str(file), "--out", str(out)]
    return subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, preexec_fn=heeding)


def until(process: "subprocess.Popen[bytes]", words: bytes) -> bytes:
    """What it has said up to these words."""
    assert process.stdout is not None
    said, deadline = b"", time.monotonic() + PATIENCE_S
    while words not in said and time.monotonic() < deadline:
        if select.select([process.stdout], [], [], 1.0)[0]:
            chunk = os.read(process.stdout.fileno(), 65536)
            if not chunk:
                break
            said += chunk
    assert words in said, said.decode()
    return said


def test_interrupted_and_resumed(tmp_path: Path) -> None:
    file, out = tmp_path / "pair.toml", tmp_path / "out"
    file.write_text(FILE)
    first = begin(file, out)
    until(first, b"running")
    first.send_signal(signal.SIGINT)
    words, _ = first.communicate(timeout=PATIENCE_S)
    assert first.returncode == 130, words.decode()
    assert b"go on with" in words
    second = begin(file, out)
    words, _ = second.communicate(timeout=2 * PATIENCE_S)
    assert second.returncode == 0, words.decode()
    rows = list(csv.DictReader((out / "trials.csv").open()))
    assert [row["ending"] for row in rows] == ["aborted", "completed", "completed"]
    assert rows[0]["folder"].endswith(".aborted-1")
    assert (out / rows[0]["folder"] / "run.mcap").exists(), "aborted runs are kept"
    for row in rows[1:]:
        metrics = json.loads((out / row["folder"] / "metrics.json").read_bytes())
        assert metrics["occupied"] == 3
        assert (out / row["folder"] / "report.html").exists()
    summary = json.loads((out / "summary.json").read_bytes())
    assert summary["trials"] == 2
    third = begin(file, out)
    words, _ = third.communicate(timeout=PATIENCE_S)
    assert third.returncode == 0
    assert b"running" not in words, "nothing is left to run"
