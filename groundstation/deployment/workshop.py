"""Makes each robot's release: wheels for its processor and Python, and the files that are its alone."""

import hashlib
import shutil
import threading
from pathlib import Path

import msgspec

from contract import network, overlay
from contract.arena import Arena, ArenaError, digest, table_of
from contract.checks import CheckResult
from groundstation.deployment import bundle, pins, render
from groundstation.deployment.facts import MACHINES, Facts
from groundstation.deployment.pins import Pin
from groundstation.deployment.plan import Release

KEYS = "keys"
PYTHONS = ("3.11", "3.12", "3.13")


def key_faults(arena: Arena, robot: str) -> list[CheckResult]:
    """Whether the certificates are at hand that the robot is to be given."""
    if not arena.link.keys:
        return []
    try:
        network.identity(arena.link.keys, robot)
    except ArenaError as error:
        words = "; ".join(str(fault) for fault in error.faults)
        remedy = f"ahdc-groundstation keys issue {robot}"
        return [CheckResult(name="certificate", verdict="fail", seen=words[:400], remedy=remedy, subject=robot)]
    return [CheckResult(name="certificate", verdict="pass", seen="at hand", subject=robot)]


class Workshop:
    """Releases of one deployment; what several robots share is made once.

    :param scratch: a folder for what is copied to robots.
    :param source: folder of wheels to take instead of the network's.
    :raises groundstation.deployment.pins.PinError: no lock file, or the field kit is not installed.
    """

    def __init__(self, arena: Arena, scratch: Path, source: Path | None = None, cache: Path | None = None) -> None:
        self._arena = arena
        self._scratch = scratch
        self._source = source
        self._cache = cache or bundle.cache()
        self._lock = threading.Lock()
        self._pins = pins.read(bundle.lock_text())
        self._needs = bundle.needs([pins.DISTRIBUTION, *(pin.name for pin in self._pins)])
        self._shared: dict[tuple[str, str, tuple[int, ...]], tuple[Path, str]] = {}

    def release(self, robot: str, facts: Facts) -> Release:
        """What to install on a computer like that.

        :raises groundstation.deployment.pins.PinError: a wheel cannot be had.
        """
        with self._lock:
            wheels, requirements = self.wheels(facts.minor, facts.machine, facts.glibc)
        (pip,) = wheels.glob("pip-*.whl")
        environment = pins.environment_id(requirements, facts.version)
        files = self._files(robot, environment)
        return Release(
            name=files.name,
            environment=environment,
            files=files,
            wheels=wheels,
            requirements=requirements,
            pip=pip.name,
            pip_sha256=bundle.sha256(pip),
            python=facts.python,
            arena_hash=digest(self._arena),
        )

    def fetch_all(self) -> list[str]:
        """Wheels for every processor and Python there may be; a line each."""
        lines = []
        for machine in MACHINES:
            for python in PYTHONS:
                folder, _ = self.wheels(python, machine, (2, pins.USUAL_GLIBC))
                lines.append(f"Python {python} on {machine}: {len(list(folder.glob('*.whl')))} wheels in {folder}")
        return lines

    def wheels(self, python: str, machine: str, glibc: tuple[int, ...]) -> tuple[Path, str]:
        """A folder with exactly the wheels for such a computer, and the requirements that name and hash them."""
        key = (python, machine, glibc)
        if key not in self._shared:
            self._shared[key] = self._make(*key)
        return self._shared[key]

    def _make(self, python: str, machine: str, glibc: tuple[int, ...]) -> tuple[Path, str]:
        kinds = (str(robot.wheels.get("kind")) for robot in self._arena.robots.values())
        wanted = pins.closure(self._pins, self._needs, pins.extras(kinds), pins.environment(python, machine))
        folder = self._cache / f"cp{python.replace('.', '')}-{machine}"
        found = bundle.present(wanted, folder)
        if set(found) != {pin.name for pin in wanted}:
            bundle.fetch(wanted, python, machine, glibc, folder, self._source)
            found = bundle.present(wanted, folder)
        chosen = bundle.fresh(self._scratch / f"{python}-{machine}-{'.'.join(map(str, glibc))}")
        for path in found.values():
            shutil.copy2(path, chosen)
        bundle.pip_wheel(chosen)
        own = bundle.own_wheel(chosen)
        version = own.name.split("-")[1]
        lines = [exactly(pin, found[pin.name]) for pin in wanted]
        lines.append(f"{pins.DISTRIBUTION}=={version} --hash=sha256:{bundle.sha256(own)}")
        return chosen, "\n".join(lines)

    def _files(self, robot: str, environment: str) -> Path:
        """Folder with what is this robot's alone, named by all that is in it."""
        arena = self._arena
        keys = ""
        files: dict[str, bytes] = {}
        if arena.link.keys:
            keys = KEYS
            folder = Path(arena.link.keys)
            for name in ("ca.pem", f"{robot}/certificate.pem", f"{robot}/private.key"):
                files[f"{KEYS}/{name}"] = (folder / name).read_bytes()
        there = msgspec.structs.replace(arena, link=msgspec.structs.replace(arena.link, keys=keys))
        files["arena.toml"] = overlay.text_of(table_of(there)).encode()
        files["rules"] = render.rules(arena.robots[robot]).encode()
        total = hashlib.sha256(environment.encode())
        for name, data in sorted(files.items()):
            total.update(f"\0{name}\0".encode() + data)
        total.update(render.unit(arena, robot, "").encode())
        release = f"{bundle.own_version()}-{total.hexdigest()[:10]}"
        files["unit"] = render.unit(arena, robot, release).encode()
        base = bundle.fresh(self._scratch / robot / release)
        base.chmod(0o700)
        for name, data in files.items():
            path = base / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch(mode=0o600)
            path.write_bytes(data)
        return base


def exactly(pin: Pin, wheel: Path) -> str:
    """A requirement that only this very wheel meets."""
    return f"{pin.name}{pin.requirement.specifier} --hash=sha256:{bundle.sha256(wheel)}"
