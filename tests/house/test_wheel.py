"""The wheel, installed away from the checkout: five packages, their data, and every command that teaches itself."""

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.house.checkout import ROOMS, ROOT, tracked

COMMANDS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
EVERY_VERB = """
import contextlib, io, re, sys
from {module} import main
def helped(*words):
    sys.argv = [{command!r}, *words, "--help"]
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        try:
            code = main()
        except SystemExit as end:
            code = end.code
    assert not code and "usage" in out.getvalue(), (words, code, out.getvalue())
    return out.getvalue()
verbs = re.findall(r"^ {{2,4}}([a-z][a-z-]*)(?: {{2,}}|$)", helped(), re.MULTILINE)
for verb in verbs:
    helped(verb)
print(len(verbs))
"""


def run(*command: str | Path, cwd: Path) -> str:
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(list(map(str, command)), cwd=cwd, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", out, cwd=ROOT)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def home(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with the wheel in it; its dependencies come from this one's site-packages."""
    home = tmp_path_factory.mktemp("fresh")
    run(sys.executable, "-m", "venv", "--without-pip", home, cwd=home)
    python = home / "bin" / "python"
    options = ("--no-deps", "--no-index", "--disable-pip-version-check")
    run(sys.executable, "-m", "pip", "--python", python, "install", *options, wheel, cwd=home)
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=home).strip())
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return home


def members(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


def test_wheel_holds_exactly_the_five_packages(wheel: Path) -> None:
    tops = {name.split("/")[0] for name in members(wheel)}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(ROOMS)
    assert not [name for name in members(wheel) if "test" in Path(name).name or "/tests/" in name]


def test_wheel_holds_every_file_of_the_rooms(wheel: Path) -> None:
    there = set(members(wheel))
    assert [p for p in (str(f.relative_to(ROOT)) for f in tracked(*ROOMS)) if p not in there] == []


def test_example_arenas_and_licence_come_along(wheel: Path) -> None:
    names = members(wheel)
    assert [name for name in names if re.fullmatch(r"groundstation/arenas/.*\.toml", name)]
    assert [name for name in names if name.endswith("licenses/LICENSE")]


def test_packages_come_from_the_wheel(home: Path) -> None:
    for room in ROOMS:
        file = run(home / "bin" / "python", "-c", f"import {room}; print({room}.__file__)", cwd=home).strip()
        assert Path(file).is_relative_to(home)


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_command_and_each_verb_explains_itself(home: Path, command: str) -> None:
    assert "usage" in run(home / "bin" / command, "--help", cwd=home)
    module = COMMANDS[command].split(":")[0]
    count = run(home / "bin" / "python", "-c", EVERY_VERB.format(module=module, command=command), cwd=home)
    assert int(count) > 0


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "contract"])
def test_room_runs_as_a_module(home: Path, room: str) -> None:
    assert "usage" in run(home / "bin" / "python", "-m", room, "--help", cwd=home)


def test_version_is_the_projects(home: Path) -> None:
    code = "from importlib.metadata import version; print(version('ahdc-fieldkit'))"
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert run(home / "bin" / "python", "-c", code, cwd=home).strip() == wanted
