"""Every mutant of the control law that mutmut makes is found out by the tests of its room, or explained.

Those that no test can or should find out are in ``law_equivalent.txt``, each with its reason; one that is found out
after all is an error there. The settings are in pyproject.toml; it takes hours, on all cores.
"""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from tests.house.checkout import ROOMS, ROOT
from tests.prove.law_mutants import changed, endings, function_of

EXPLAINED = Path(__file__).parent / "law_equivalent.txt"
TAKEN = (*ROOMS, "bench", "docs", "tests", "README.md", "CHANGELOG.md", "kit", "pyproject.toml")
TELL_S = 30.0

Change = tuple[str, str, str]
"""Function, lines before, lines after."""


def explained(text: str) -> Iterator[Change]:
    """Every line ``FUNCTION: BEFORE => AFTER  # REASON``."""
    for line in text.splitlines():
        if line.strip():
            said, _, reason = line.rpartition("  # ")
            function, _, change = said.partition(": ")
            before, arrow, after = change.partition(" => ")
            assert reason.strip(), line
            assert arrow, line
            yield function, before.strip(), after.strip()


def test_every_explanation_can_be_read() -> None:
    assert list(explained("m f: a = 1 => a = 2  # twice  # never\n\nm g: x =>   # gone")) == [
        ("m f", "a = 1", "a = 2  # twice"), ("m g", "x", ""),
    ]  # fmt: skip
    for function, before, _ in explained(EXPLAINED.read_text(encoding="utf-8")):
        source = (ROOT / Path(*function.split()[0].split("."))).with_suffix(".py").read_text(encoding="utf-8")
        lines = {line.strip() for line in source.splitlines()} - {""}
        assert any(before.startswith(line) for line in lines), f"{function} has no more: {before}"


def test_what_mutmut_keeps_is_read(tmp_path: Path) -> None:
    folder = tmp_path / "mutants" / "onboard"
    folder.mkdir(parents=True)
    codes = {
        "m.x_f__mutmut_1": 1, "m.x_f__mutmut_2": 0, "m.x_f__mutmut_3": -24, "m.xǁCǁ_g__mutmut_1": 33,
        "m.x__h__mutmut_9": None,
    }  # fmt: skip
    (folder / "m.py.meta").write_text(json.dumps({"exit_code_by_key": codes}))
    assert [(function_of(name), ending) for name, ending in endings(tmp_path)] == [
        ("m f", "killed"), ("m f", "survived"), ("m f", "timeout"), ("m C._g", "no tests"), ("m _h", "not run"),
    ]  # fmt: skip
    assert changed("--- a\n+++ b\n@@\n def f():\n-    a = 1\n-    b\n+    a = 2\n") == ("a = 1 / b", "a = 2")


def copied(folder: Path) -> Path:
    for name in TAKEN:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__", "mutants"))
        else:
            shutil.copy2(source, folder / name)
    return folder


@pytest.mark.timeout(0)
def test_no_mutant_of_the_law_is_left_unexplained(tmp_path: Path) -> None:
    copy = copied(tmp_path)
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", str(os.cpu_count() or 1)]
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "AHDC_FRESH")}
    with (copy / "log").open("w") as log:
        process = subprocess.Popen(command, cwd=copy, stdout=log, stderr=log, env=environment)
        try:
            while process.poll() is None:
                with suppress(json.JSONDecodeError):  # a file that is just being written
                    counts = Counter(ending for _, ending in endings(copy))
                    print(", ".join(f"{count} {ending}" for ending, count in sorted(counts.items())), flush=True)
                try:
                    process.wait(TELL_S)
                except subprocess.TimeoutExpired:
                    continue
        finally:
            process.kill()
            process.wait()
    look = [sys.executable, "-m", "tests.prove.law_mutants", str(copy)]
    found = json.loads(subprocess.check_output(look, cwd=ROOT, text=True))
    print(found["counts"], flush=True)
    assert found["counts"].get("killed", 0) > 1000, (copy / "log").read_text(errors="replace")[-3000:]
    alive = Counter(map(tuple, found["alive"]))
    known = Counter(explained(EXPLAINED.read_text(encoding="utf-8")))
    left, gone = alive - known, known - alive
    for title, those in (("alive, unexplained", left), ("explained, but found out", gone)):
        for function, before, after in sorted(those):
            print(f"{title}: {function}: {before} => {after}", flush=True)
    assert not left
    assert not gone
