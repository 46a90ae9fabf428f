"""Sources to machine code beside them, by mypyc and the C compiler of this machine.

gcc compiles twice: the first time with counters, which a few missions fill, and the second time for the branches that
those missions took. Sums stay what they are in the sources: no multiplication is fused with an addition.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

FLAGS = ("-DNDEBUG", "-fwrapv", "-fno-semantic-interposition", "-ffp-contract=off")
COUNT = ("-fprofile-generate", "-fprofile-update=single")
USE = ("-fprofile-use", "-fprofile-correction", "-Wno-missing-profile")
MISSIONS = tuple(
    ["simulate", "--runs", "2", "--workers", "1", *words.split()]
    for words in (
        "--conditions ideal --robots 6 --targets 19",
        "--conditions ideal --robots 6 --targets 19 --wire",
        "--conditions field --robots 6 --targets 19",
        "--conditions field --robots 9 --targets 27",
    )
)
"""Played between the two."""
SHOW_S = 2.0
"""On a terminal; elsewhere a line now and then is enough."""
LINE_S = 15.0


class CompileError(Exception):
    """It cannot be compiled here; the text says why and what to do."""


def look_for_tools() -> None:
    """:raises CompileError: a package, the C compiler or Python's headers are missing."""
    for package in ("mypyc", "setuptools"):
        if importlib.util.find_spec(package) is None:
            raise CompileError(f"{package} is not installed; remedy: pip install mypy setuptools (./kit has both)")
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    if shutil.which(_compiler()) is None or not header.is_file():
        raise CompileError("no C compiler, or no headers of Python; remedy: sudo apt-get install gcc python3-dev")


def learns() -> bool:
    """Whether the C compiler is gcc: others keep what they count elsewhere."""
    said = subprocess.run([_compiler(), "--version"], capture_output=True, text=True, check=False).stdout
    return "Free Software Foundation" in said


def compile_all(work: Path, chosen: tuple[str, ...], quick: bool) -> None:
    """Compile modules, named by their paths from ``work``, which holds all sources; once if ``quick``.

    :raises CompileError: the compiler refuses, or what it has made does not work.
    """
    flags: tuple[str, ...] = FLAGS
    if not quick and learns():
        _mypyc(work, chosen, (*FLAGS, *COUNT), f"compiling {len(chosen)} modules, first of two times")
        _play(work)
        for path in (*work.rglob("*.so"), *(work / "build").rglob("*.o")):
            path.unlink()
        flags = (*FLAGS, *USE)
    _mypyc(work, chosen, flags, f"compiling {len(chosen)} modules")
    for module in (chosen[0], chosen[-1]):
        _check(work, module)


def _compiler() -> str:
    return str(sysconfig.get_config_var("CC") or "cc").split()[0]


def _mypyc(work: Path, chosen: tuple[str, ...], flags: tuple[str, ...], what: str) -> None:
    command = [sys.executable, "-m", "mypyc", "--config-file=", "--ignore-missing-imports", *chosen]
    environment = {
        **os.environ, "MYPYC_DEBUG_LEVEL": "0", "PYTHONPATH": "", "CFLAGS": " ".join(flags),
        "LDFLAGS": " ".join(flag for flag in flags if flag in COUNT),
    }  # fmt: skip
    said = _run(command, work, environment, what)
    if said is not None:
        errors = [line for line in said.splitlines() if "error" in line.lower()]
        raise CompileError("mypyc refuses:\n  " + "\n  ".join(errors[:10]))


def _play(work: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(work), "AHDC_COMPILED": "0"}
    for words in MISSIONS:
        said = _run([sys.executable, "-P", "-m", "groundstation", *words], work, environment, "playing missions")
        if said is not None:
            raise CompileError(f"missions fail with what was compiled first: {said[-300:]}")
    if not any((work / "build").rglob("*.gcda")):
        raise CompileError("the missions left no counts; remedy: --quick")


def _run(command: list[str], work: Path, environment: dict[str, str], what: str) -> str | None:
    """What a command said that failed, None where it did not; its progress is shown."""
    began_s = time.monotonic()
    with (work / "log").open("w") as log:
        process = subprocess.Popen(command, cwd=work, env=environment, stdout=log, stderr=log)
        try:
            while process.poll() is None:
                try:
                    process.wait(SHOW_S if sys.stderr.isatty() else LINE_S)
                except subprocess.TimeoutExpired:
                    _show(f"{what}: {time.monotonic() - began_s:.0f} s")
        finally:
            process.kill()
            process.wait()
    _show("")
    return (work / "log").read_text() if process.returncode else None


def _show(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{text:<60}" if text else f"\r{'':<60}\r", end="", file=sys.stderr, flush=True)
    elif text:
        print(text, file=sys.stderr, flush=True)


def _check(work: Path, module: str) -> None:
    """That what was made can be imported, and is machine code."""
    name = module.removesuffix(".py").replace("/", ".")
    look = f"import importlib; print(importlib.import_module({name!r}).__file__)"
    done = subprocess.run(
        [sys.executable, "-c", look], cwd=work, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": ""},
    )  # fmt: skip
    if done.returncode or not done.stdout.strip().endswith(str(sysconfig.get_config_var("EXT_SUFFIX"))):
        raise CompileError(f"{name} does not work as machine code: {(done.stderr or done.stdout).strip()[-300:]}")
