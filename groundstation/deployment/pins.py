"""Which locked packages a robot needs, for its processor and Python. Pure."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

DISTRIBUTION = "ahdc-fieldkit"
NEWEST_TAG = 39
USUAL_GLIBC = 31
"""Of the oldest system that is likely on a robot (Debian 11); wheels for it run on newer ones."""


class Pin(NamedTuple):
    """One package of the lock file: a version and the hashes of all its files."""

    requirement: Requirement
    hashes: tuple[str, ...]

    @property
    def name(self) -> str:
        return canonicalize_name(self.requirement.name)

    def line(self) -> str:
        """As a requirements file has it, marker left off."""
        hashes = "".join(f" --hash=sha256:{digest}" for digest in self.hashes)
        return f"{self.name}{self.requirement.specifier}{hashes}"


class PinError(ValueError):
    """The lock file does not say what a robot needs."""


def read(lock: str) -> list[Pin]:
    """The pins of a lock file."""
    blocks = re.findall(r"^([A-Za-z0-9][^\\\n]*)\\\n((?: +--hash=.*\n?)+)", lock, re.MULTILINE)
    return [Pin(Requirement(head.strip()), tuple(re.findall(r"sha256:([0-9a-f]{64})", tail))) for head, tail in blocks]


def environment(python: str, machine: str) -> dict[str, str]:
    """Values of the markers on a robot: CPython ``python`` (such as 3.11) on Linux."""
    values = {name: str(value) for name, value in default_environment().items()}
    return values | {
        "implementation_name": "cpython",
        "os_name": "posix",
        "platform_machine": machine,
        "platform_python_implementation": "CPython",
        "platform_system": "Linux",
        "python_full_version": f"{python}.0",
        "python_version": python,
        "sys_platform": "linux",
    }


def closure(
    pins: Iterable[Pin], needs: Mapping[str, Iterable[str]], extras: Iterable[str], where: Mapping[str, str]
) -> list[Pin]:
    """The pins a robot needs, in order of name.

    :param needs: package name to its requirements (``Requires-Dist``), as far as known.
    :param extras: of the field kit.
    :param where: values of the markers (:func:`environment`).
    :raises PinError: something that is needed is not in the lock file, or the file gives it two versions.
    """
    locked: dict[str, Pin] = {}
    for pin in pins:
        if pin.requirement.marker is None or pin.requirement.marker.evaluate(dict(where)):
            if pin.name in locked:
                raise PinError(f"{pin.name}: two versions in the lock file for {where['platform_machine']}")
            locked[pin.name] = pin
    found: dict[str, Pin] = {}
    todo = [(DISTRIBUTION, frozenset({"", *extras}))]
    while todo:
        name, wanted = todo.pop()
        for text in needs.get(name, ()):
            requirement = Requirement(text)
            marker = requirement.marker
            if marker and not any(marker.evaluate({**where, "extra": extra}) for extra in wanted):
                continue
            other = canonicalize_name(requirement.name)
            if other not in locked:
                raise PinError(f"{other}, which {name} needs, is not in the lock file; ./kit lock")
            if other not in found:
                found[other] = locked[other]
                todo.append((other, frozenset({"", *requirement.extras})))
    return [found[name] for name in sorted(found)]


def platforms(machine: str, glibc: tuple[int, ...]) -> list[str]:
    """Platform tags of wheels that run there, newest first, the legacy name of 2.17 at the end."""
    newest = min(glibc[1], NEWEST_TAG) if len(glibc) > 1 and glibc[0] == 2 else 17
    return [f"manylinux_2_{minor}_{machine}" for minor in range(newest, 16, -1)] + [f"manylinux2014_{machine}"]


def extras(kinds: Iterable[str]) -> set[str]:
    """Extras of the field kit that wheel families need."""
    return {"canopen"} if "cia402" in kinds else set()


def environment_id(requirements: str, python: str) -> str:
    """Names an environment by all that is in it."""
    return hashlib.sha256(f"{python}\n{requirements}".encode()).hexdigest()[:12]
