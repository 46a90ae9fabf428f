"""The lock file: complete, hashed, silent about hosts, and small enough for a robot."""

import re
import tomllib

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement

from tests.house.checkout import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = (ROOT / "requirements.lock").read_text()
BLOCKS = re.findall(r"^([a-z0-9][^\\\n]*)\\\n((?: +--hash=.*\n)+)", LOCK, re.MULTILINE)
PYTHONS = ("3.11", "3.12", "3.13")


def pins(python: str, machine: str) -> dict[str, str]:
    """Locked name to version for one Python and processor on Linux."""
    environment = {
        **default_environment(),
        "python_version": python,
        "python_full_version": f"{python}.0",
        "platform_machine": machine,
        "sys_platform": "linux",
    }
    wanted = [Requirement(head.strip()) for head, _ in BLOCKS]
    chosen = [r for r in wanted if r.marker is None or r.marker.evaluate(environment)]
    names = [r.name for r in chosen]
    assert len(names) == len(set(names)), "one version a package"
    return {r.name: str(r.specifier).removeprefix("==") for r in chosen}


def asked() -> list[Requirement]:
    extras = PROJECT["optional-dependencies"].values()
    return [Requirement(text) for text in [*PROJECT["dependencies"], *(t for extra in extras for t in extra)]]


def test_every_pin_has_hashes_and_nothing_else_is_in_the_file() -> None:
    assert len(BLOCKS) > 40
    rest = re.sub(r"^([a-z0-9][^\\\n]*)\\\n((?: +--hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)", "", LOCK, flags=re.MULTILINE)
    assert all(line.startswith("#") for line in rest.splitlines() if line.strip())


def test_lock_names_no_host() -> None:
    assert "://" not in LOCK


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
@pytest.mark.parametrize("python", PYTHONS)
def test_lock_satisfies_the_project_file(python: str, machine: str) -> None:
    locked = pins(python, machine)
    for requirement in asked():
        if requirement.marker and not requirement.marker.evaluate({"platform_machine": machine}):
            assert requirement.name not in locked
            continue
        assert requirement.specifier.contains(locked[requirement.name]), requirement.name


def test_oldest_python_gets_a_numpy_that_supports_it() -> None:
    major, minor = map(int, pins("3.11", "aarch64")["numpy"].split(".")[:2])
    assert (major, minor) < (2, 5)


def test_robot_needs_none_of_the_extras() -> None:
    core = {Requirement(text).name for text in PROJECT["dependencies"]}
    extras = {Requirement(t).name for extra in PROJECT["optional-dependencies"].values() for t in extra}
    assert core == {"eclipse-zenoh", "fastcrc", "mcap", "msgspec", "numpy", "pyserial", "python-can"}
    assert not core & extras
