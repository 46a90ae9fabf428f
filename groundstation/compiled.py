"""``compile``: machine code of ``onboard``, of lockstep and of its real bytes for long sweeps, by mypyc, from the very
sources: the same missions.

``simulate`` takes it where it is there and no source has changed since; robots, tests and everything else never do.
It is kept in the environment, in a folder for one version of the sources.
"""

import argparse
import hashlib
import importlib.metadata
import importlib.util
import os
import shutil
import sys
import sysconfig
import tempfile
import time
from pathlib import Path

import groundstation
from groundstation.compiler import CompileError, compile_all, look_for_tools

ROOMS = ("contract", "drivers", "groundstation", "mocap_bridge", "onboard")
"""Whose sources the machine code is of."""
WHOLE = ("drivers", "mocap_bridge", "onboard")
"""Rooms that are taken from there with their sources beside the machine code."""
SHELLS = ("checkup", "cli", "computer", "doctor", "network", "runtime", "service", "site_time", "switches")
"""Modules of ``onboard`` that no simulated robot needs."""
WORLD = ("grid", "hops", "lockstep", "plant", "referee", "scoring", "vicinity", "wire")
"""Modules of ``groundstation`` that play a mission."""
BYTES = {
    "drivers": ("gate", "gated", "health", "lifecycle", "line"),
    "drivers/can": ("line", "odrive_codec", "slcan_text"),
    "drivers/mock": (
        "adapter", "body", "controller", "faults", "host", "motor", "odrive", "roboclaw", "roboclaw_channel",
        "roboclaw_packets", "slcan", "wire",
    ),
    "drivers/serial": ("line", "roboclaw_codec"),
    "mocap_bridge": ("steady",),
    "mocap_bridge/mock": ("bodies",),
    "mocap_bridge/natnet": ("frame", "frame_encode"),
}  # fmt: skip
"""What takes most of the time of ``--wire``. None has a Struct, whose keywords mypyc drops without a word, or a class
that families of drivers, which are not compiled, inherit from."""
JOINT = '''"""Machine code of some modules; the others are where the sources are."""
from importlib.util import find_spec
from pathlib import Path
__path__.append(str(Path(find_spec("contract").origin).parent.parent / "groundstation"))
'''
"""What a process to come takes for the package ``groundstation``."""
OFF = "AHDC_COMPILED"
"""Set to 0, this variable of the environment keeps ``simulate`` from taking machine code."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Compile the control law for simulate: the same missions, bit for bit, in less time. Takes five to fifteen "
        "minutes and a C compiler; to be done again when the sources have changed. Robots never run it. "
        f"{OFF}=0 in the environment makes simulate do without."
    )
    parser.add_argument("--force", action="store_true", help="compile although it is there already")
    parser.add_argument(
        "--quick", action="store_true", help="compile once, in half the time, instead of twice with missions in between"
    )


def run(args: argparse.Namespace) -> int:
    """Exit code 1 where it cannot be compiled."""
    if current() is not None and not args.force:
        print("already compiled; simulate takes it")
        return 0
    began_s = time.monotonic()
    try:
        folder = build(sources(), home(), args.quick)
    except CompileError as error:
        print(f"compile: {error}", file=sys.stderr)
        return 1
    print(f"compiled in {time.monotonic() - began_s:.0f} s, into {folder}; simulate takes it from now on")
    return 0


def sources() -> Path:
    """The folder that holds the rooms."""
    found = importlib.util.find_spec("contract")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).parent.parent


def home() -> Path:
    """Where machine code is kept."""
    return Path(sys.prefix) / "ahdc-compiled"


def modules(folder: Path) -> list[str]:
    """Paths, from there, of what is compiled."""
    left = {*SHELLS, "__init__", "__main__"}
    law = [path for path in (folder / "onboard").rglob("*.py") if path.stem not in left]
    world = [folder / "groundstation" / f"{name}.py" for name in WORLD]
    wire = [folder / room / f"{name}.py" for room, names in BYTES.items() for name in names]
    return sorted(str(path.relative_to(folder)) for path in (*law, *world, *wire))


def version_of(folder: Path) -> str:
    """Changes with every source that goes in and with what makes machine code of it."""
    said = hashlib.sha256(f"{sysconfig.get_config_var('EXT_SUFFIX')} {sys.version} {_mypy()}".encode())
    for room in ROOMS:
        for path in sorted((folder / room).rglob("*.py")):
            said.update(f"\n{path.relative_to(folder)} {path.stat().st_size}\n".encode() + path.read_bytes())
    return said.hexdigest()[:16]


def current() -> Path | None:
    """The folder of machine code of the sources as they are, None without."""
    folder = home() / version_of(sources())
    return folder if folder.is_dir() else None


def take() -> bool:
    """Import what is compiled from machine code from now on, also in processes to come; False where it cannot be."""
    late = any(name in sys.modules for name in (*WHOLE, *(f"groundstation.{name}" for name in WORLD)))
    if late or os.environ.get(OFF) == "0" or not home().is_dir():
        return False
    folder = current()
    if folder is not None:
        sys.path.insert(0, str(folder))
        groundstation.__path__.insert(0, str(folder / "groundstation"))
    return folder is not None


def build(source: Path, target: Path, quick: bool = False) -> Path:
    """Compile into a folder of ``target``, named after the version, that is there whole or not at all.

    :raises CompileError: a tool is missing, or the compiler refuses.
    """
    look_for_tools()
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target) as name:
        work = Path(name)
        for room in ROOMS:
            shutil.copytree(source / room, work / room, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        folder = target / version_of(work)
        compile_all(work, tuple(modules(work)), quick)
        _join(work / "groundstation")
        for part in ("build", "contract", ".mypy_cache", "log"):
            path = work / part
            path.unlink() if path.is_file() else shutil.rmtree(path, ignore_errors=True)
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(work, folder.with_suffix(".new"), dirs_exist_ok=True)
        folder.with_suffix(".new").rename(folder)
    for old in target.iterdir():
        if old != folder:
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _join(package: Path) -> None:
    """Leave nothing but the machine code in there, and the way to the rest."""
    for path in package.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.suffix != ".so":
            path.unlink()
    (package / "__init__.py").write_text(JOINT, encoding="utf-8")


def _mypy() -> str:
    try:
        return importlib.metadata.version("mypy")
    except importlib.metadata.PackageNotFoundError:
        return ""
