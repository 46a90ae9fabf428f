"""Who may import whom, read from the syntax tree.

``contract`` imports no other room; the four rooms import ``contract`` only, but for single named files. A module is
pure unless it stands in ``SHELLS``: time, sockets, threads, logs and devices are a shell's business.
"""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest
from packaging.requirements import Requirement

from tests.house.checkout import ROOMS, ROOT

EVERY_ROOM = set(ROOMS)
MAY_IMPORT_ROOMS = {
    "onboard/runtime.py": {"contract", "drivers"},
    "groundstation/deploy.py": {"contract", "drivers"},
    "groundstation/emulated.py": EVERY_ROOM,
    "groundstation/faultrows.py": EVERY_ROOM,
    "groundstation/hops.py": EVERY_ROOM,
    "groundstation/lockstep.py": EVERY_ROOM,
    "groundstation/mock_arena.py": EVERY_ROOM,
    "groundstation/plant.py": {"contract", "onboard"},
    "groundstation/replaying.py": {"contract", "onboard"},
    "groundstation/rig.py": EVERY_ROOM,
    "groundstation/stage_mock.py": {"contract", "drivers"},
    "groundstation/stage_robots.py": {"contract", "drivers"},
    "groundstation/wire.py": EVERY_ROOM,
}
"""onboard/runtime.py turns wheels; rig.py and mock_arena.py compose a mission's processes; hops.py, lockstep.py and
wire.py play a mission in one process and virtual time, which takes agents, drivers and motion capture together;
plant.py is its motors and bodies, by the brake model of the law; replaying.py feeds a recording to the very agent."""
DEVICES = {"can", "serial", "socket", "zenoh", "mcap"}
MACHINE = {"asyncio", "logging", "multiprocessing", "select", "selectors", "signal", "subprocess", "threading", "time"}
IMPURE = DEVICES | MACHINE
SPELLED = re.compile(rf"({'|'.join(ROOMS)})(\.[a-z_]+)+")
STATION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["station"]
STATION_ONLY = {Requirement(text).name for text in STATION}
SHELLS = (
    "onboard/computer.py",
    "onboard/jitter.py",
    "onboard/network.py",
    "onboard/runtime.py",
    "onboard/service.py",
    "onboard/site_time.py",
    "drivers/can/bus.py",
    "drivers/serial/port.py",
    "drivers/verbs/*.py",
    "mocap_bridge/bridge.py",
    "mocap_bridge/interfaces.py",
    "mocap_bridge/mock/udp.py",
    "mocap_bridge/network.py",
    "mocap_bridge/router.py",
    "mocap_bridge/sources/*.py",
    "mocap_bridge/timekeeper.py",
    "mocap_bridge/verbs/*.py",
    "groundstation/compiled.py",
    "groundstation/compiler.py",
    "groundstation/conduct.py",
    "groundstation/demo.py",
    "groundstation/deploy.py",
    "groundstation/deployment/bundle.py",
    "groundstation/deployment/remote.py",
    "groundstation/deployment/site.py",
    "groundstation/deployment/workshop.py",
    "groundstation/doctor.py",
    "groundstation/errands.py",
    "groundstation/exclusion.py",
    "groundstation/faultreal.py",
    "groundstation/faultrig.py",
    "groundstation/emulated.py",
    "groundstation/fleet.py",
    "groundstation/fleet_operator.py",
    "groundstation/fleet_rig.py",
    "groundstation/link.py",
    "groundstation/mock_arena.py",
    "groundstation/netns.py",
    "groundstation/network.py",
    "groundstation/orders.py",
    "groundstation/page_client.py",
    "groundstation/page_intake.py",
    "groundstation/page_live.py",
    "groundstation/page_server.py",
    "groundstation/page_web.py",
    "groundstation/ports.py",
    "groundstation/processes.py",
    "groundstation/provenance.py",
    "groundstation/radio.py",
    "groundstation/recorder.py",
    "groundstation/recording.py",
    "groundstation/recover.py",
    "groundstation/relay.py",
    "groundstation/router.py",
    "groundstation/runwriter.py",
    "groundstation/seeding.py",
    "groundstation/simulate.py",
    "groundstation/sweep.py",
    "groundstation/watch.py",
)


def imported(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and dotted name of every import, lazy ones and those spelled as a string ('drivers.can') included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, ("." * node.level) + (node.module or "")
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and SPELLED.fullmatch(node.value):
            yield node.lineno, node.value


def is_shell(path: str) -> bool:
    return any(PurePosixPath(path).match(pattern) for pattern in SHELLS)


def faults(path: str, source: str) -> list[str]:
    """What a module imports and may not; ``path`` is relative to the checkout."""
    room = path.split("/")[0]
    allowed = MAY_IMPORT_ROOMS.get(path, {"contract"}) | {room}
    if room == "contract":
        allowed = {"contract"}
    found = []
    for line, name in imported(ast.parse(source)):
        top = name.split(".")[0]
        where = f"{path}:{line}: imports {name}"
        if name.startswith("."):
            found.append(f"{where}; write the absolute name")
        if top in EVERY_ROOM - allowed:
            found.append(f"{where}; {path} may import only {', '.join(sorted(allowed))}")
        if top in STATION_ONLY and room != "groundstation":
            found.append(f"{where}; only groundstation may need it, a robot computer goes without")
        elif top in IMPURE and not is_shell(path):
            found.append(f"{where}; a pure module may not (take data and time as arguments, or list it in SHELLS)")
    return found


def modules() -> list[str]:
    return [str(path.relative_to(ROOT)) for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]


@pytest.mark.parametrize("room", ROOMS)
def test_room_keeps_the_import_rule(room: str) -> None:
    paths = [path for path in modules() if path.startswith(f"{room}/")]
    assert paths
    found = [fault for path in paths for fault in faults(path, (ROOT / path).read_text())]
    assert not found, "\n".join(found)


def imports_of(path: str) -> set[str]:
    return {name.split(".")[0] for _, name in imported(ast.parse((ROOT / path).read_text()))}


def test_every_exception_is_used() -> None:
    for path in MAY_IMPORT_ROOMS:
        assert imports_of(path) & (EVERY_ROOM - {"contract", path.split("/")[0]}), path


def test_every_shell_is_one() -> None:
    idle = {p for p in SHELLS if not any(imports_of(m) & IMPURE for m in modules() if PurePosixPath(m).match(p))}
    assert not idle, "these need no device, clock or process any more: take them off SHELLS"


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("contract/keys.py", "import onboard"),
        ("contract/keys.py", "from drivers.base import DiffDrive"),
        ("onboard/agent.py", "from drivers import gate"),
        ("onboard/agent.py", "def f():\n    import groundstation.rig"),
        ("onboard/runtime.py", "import mocap_bridge"),
        ("groundstation/report.py", "import importlib\nimportlib.import_module('onboard.agent')"),
        ("drivers/gate.py", "from . import base"),
        ("drivers/gate.py", "from time import monotonic"),
        ("onboard/ahdc/controller.py", "import logging"),
        ("onboard/runtime.py", "import rich"),
        ("mocap_bridge/network.py", "import matplotlib.pyplot"),
    ],
)
def test_rule_refuses(path: str, source: str) -> None:
    assert faults(path, source)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("onboard/runtime.py", "import time, zenoh\nfrom drivers import registry"),
        ("groundstation/rig.py", "import onboard, drivers, mocap_bridge"),
        ("drivers/can/bus.py", "import can"),
        ("onboard/agent.py", '"""See drivers.gate and time."""\nfrom contract import keys'),
    ],
)
def test_rule_allows(path: str, source: str) -> None:
    assert not faults(path, source)


def test_scan_reads_every_room_file() -> None:
    assert Path("contract/messages.py").as_posix() in modules()
