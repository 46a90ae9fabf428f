"""Composes the processes of a mock arena: resolves the arena file, starts everything, ends everything.

Demo, benches and fault injection all stand on it. Every process reads the same resolved
``DIR/config.toml``: free ports and pty paths are written there, so nothing is overridden elsewhere.
"""

import math
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import tomlkit

from contract.arena import Arena, ArenaError, load, parse, table_of
from contract.tables import Fault
from drivers.defaults import DEFAULTS
from drivers.registry import family_of, wheel_faults
from groundstation.ports import free_ports
from groundstation.processes import Child, Family

ARENAS = Path(__file__).parent / "arenas"
READY_S = 40.0
GRID_M = 0.4
MOST_ROBOTS = 100
REALTIME_NICENESS = -10
"""Where the kernel allows it: on a busy machine a robot starved for 0.2 s is cut by its device watchdog."""
HARDWARE_NICENESS = -15
"""Motors and cameras do not wait for a robot's computer."""
NICENESS = {"recorder": 0, "mock_arena": HARDWARE_NICENESS}

ENDS = {"recorder": 1, "bridge": 2}
"""The recorder hears the robots' last words; the router goes with the bridge."""


class Changes(NamedTuple):
    """What a command line changes in an arena file."""

    robots: int | None = None
    targets: int | None = None
    seed: int | None = None


AS_WRITTEN = Changes()


def find_arena(name: str) -> Path:
    """The file itself, or the example arena of that name.

    :raises ArenaError: neither exists.
    """
    path = Path(name)
    if path.exists() or path.suffix == ".toml" or "/" in name:
        return path
    example = ARENAS / f"{name}.toml"
    if example.exists():
        return example
    known = ", ".join(sorted(entry.stem for entry in ARENAS.glob("*.toml")))
    raise ArenaError(
        name, [Fault("file", name, f"no such file, and no example arena of this name; there are: {known}")]
    )


def mock_arena(source: Path, out: Path, changes: Changes = AS_WRITTEN) -> Arena:
    """The arena with all hardware emulated, on free loopback ports and ptys below ``out``.

    :raises ArenaError: the file, or what the changes make of it, has faults.
    """
    table = table_of(load(source, wheel_faults))
    if changes.robots is not None:
        table["robots"] = _some_robots(table, changes.robots)
    if changes.targets is not None:
        table["targets"] |= {"count": changes.targets, "points": []}
    if changes.seed is not None:
        table["targets"] |= {"seed": changes.seed, "points": []}
    tcp, command, data = free_ports(3)
    table["link"] = {"router": f"tcp/127.0.0.1:{tcp}"}
    table["mocap"] |= {
        "source": "natnet",
        "server": "127.0.0.1",
        "local_address": "127.0.0.1",
        "multicast_group": "",
        "command_port": command,
        "data_port": data,
    }
    for name, robot in table["robots"].items():
        robot["emulate"] = ["wheels", "body"]
        robot["wheels"] = _on_pty(robot["wheels"], out.resolve() / "ports" / name)
    return parse(table, str(source), wheel_faults)


def _some_robots(table: dict[str, Any], count: int) -> dict[str, Any]:
    """The first ``count`` robots of the file, more like them on a grid where it has fewer."""
    if not 1 <= count <= MOST_ROBOTS:
        raise ArenaError("robots", [Fault("robots", str(count), f"a whole number from 1 to {MOST_ROBOTS}")])
    robots: dict[str, Any] = dict(list(table["robots"].items())[:count])
    kinds = [robot["wheels"] for robot in table["robots"].values()]
    columns = math.ceil(math.sqrt(count))
    cells = ((0.35 + GRID_M * (i % columns), 0.35 + GRID_M * (i // columns)) for i in range(4 * count))
    number = 0
    while len(robots) < count:
        number += 1
        name = f"r{number:02d}"
        if name in robots:
            continue
        taken = [robot["start"] for robot in robots.values()]
        start = next(cell for cell in cells if all(math.dist(cell, other) >= 0.9 * GRID_M for other in taken))
        robots[name] = {"body": name, "start": list(start), "wheels": dict(kinds[len(robots) % len(kinds)])}
    return robots


def _on_pty(wheels: dict[str, Any], port: Path) -> dict[str, Any]:
    family = family_of(wheels["kind"])
    assert family is not None, "the file was checked"
    if family.port_key == "channel":
        wheels = {**wheels, "interface": "slcan"}
    return {**DEFAULTS.get(family.kind, {}), **wheels, family.port_key: str(port)}


def write_config(arena: Arena, path: Path) -> None:
    """The resolved arena as TOML, top-level keys first."""
    table = table_of(arena)
    ordered = {key: value for key, value in table.items() if not isinstance(value, dict)}
    path.write_text(tomlkit.dumps(ordered | table), encoding="utf-8")


class Rig:
    """The processes of one arena. Leaving the ``with`` block ends them and removes the ptys' links."""

    def __init__(self, arena: Arena, out: Path, record: bool = True) -> None:
        self.arena = arena
        self.out = out
        self.config = out / "config.toml"
        self.family = Family()
        self._record = record

    def __enter__(self) -> "Rig":
        (self.out / "logs").mkdir(parents=True, exist_ok=True)
        shutil.rmtree(self.out / "ports", ignore_errors=True)
        write_config(self.arena, self.config)
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()

    def start(self, robots: Iterable[str] | None = None) -> None:
        """Start everything and wait until all works; the recorder before the robots, which makes the run replayable.

        :raises groundstation.processes.ChildError: naming what did not start, with its last words.
        """
        self.start_one("bridge")
        if self._record:
            self.start_one("recorder")
            self.family.wait_ready(READY_S)
        self.start_one("mock_arena")
        for name in self.arena.robots if robots is None else robots:
            self.start_robot(name)
        self.family.wait_ready(READY_S)

    def start_robot(self, name: str) -> Child:
        """One robot's process, not waited for."""
        return self._child(name, "onboard", "run", "--robot", name)

    def start_one(self, name: str) -> Child:
        """The process of that name, a robot's by the robot's; not waited for."""
        match name:
            case "bridge":
                return self._child(name, "mocap_bridge", "run")
            case "recorder":
                return self._child(name, "groundstation", "record", "--out", str(self.out))
            case "mock_arena":
                return self._child(name, "groundstation.mock_arena")
        return self.start_robot(name)

    def start_again(self, name: str) -> None:
        """A process that has ended, anew; returns once it works.

        :raises groundstation.processes.ChildError: it does not start.
        """
        self.family.forget(name)
        self.start_one(name)
        self.family.wait_ready(READY_S)

    def end(self) -> dict[str, int | None]:
        """End all processes; exit codes by name."""
        codes = self.family.end()
        shutil.rmtree(self.out / "ports", ignore_errors=True)
        return codes

    def _child(self, name: str, module: str, *arguments: str) -> Child:
        verb, rest = list(arguments[:1]), list(arguments[1:])
        command = [*verb, "--arena", str(self.config), *rest]
        niceness = NICENESS.get(name, REALTIME_NICENESS)
        log = self.out / "logs" / f"{name}.log"
        return self.family.start(name, module, command, log, niceness, ENDS.get(name, 0))
