"""A mock arena as a fleet on a network: every process in a network namespace of its own, QUIC or TLS between them.

Router, station, bridge and motion capture are on a wire, the robots behind :mod:`groundstation.relay`. Keys are made
afresh. ``tcp`` has neither keys nor router process, for comparison. Needs root.
"""

import signal
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import msgspec

from contract.arena import Arena, load, parse, table_of
from groundstation import keys, rig
from groundstation.netns import UPLINK, Namespaces
from groundstation.processes import Child
from groundstation.weather import Weather

Protocol = Literal["quic", "tls", "tcp"]
WIRED = ("router", "station", "bridge", "mocap")
PORT = 7447
PLACES = {"router": "router", "bridge": "bridge", "mock_arena": "mocap", "relay": "switch"}
"""Process to member; robots have their own, the rest are the station's."""


def fleet_arena(source: Path, out: Path, protocol: Protocol, changes: rig.Changes = rig.AS_WRITTEN) -> Arena:
    """An emulated arena whose members have addresses, its keys made below ``out``.

    :raises ArenaError: the file, or what the changes make of it, has faults.
    """
    out.mkdir(parents=True, exist_ok=True)
    table = table_of(rig.mock_arena(source, out, changes))
    space = Namespaces(WIRED, list(table["robots"]))
    router = space.address("bridge" if protocol == "tcp" else "router")
    table["link"] = {"router": f"{protocol}/{router}:{PORT}"}
    if protocol == "quic":
        table["link"]["listen"] = [f"{kind}/{router}:{PORT}" for kind in ("quic", "tls")]
    table["link"] |= {"insecure": True} if protocol == "tcp" else {"keys": "keys"}
    table["mocap"] |= {"server": space.address("mocap"), "local_address": space.address("bridge")}
    arena = parse(table, str(source))
    rig.write_config(arena, out / "config.toml")
    if protocol == "tcp":
        return arena
    arena = load(out / "config.toml")
    keys.establish(arena, days=1.0, now=datetime.now(UTC))
    return arena


class FleetRig(rig.Rig):
    """The processes of one fleet. Leaving the ``with`` block ends them, then removes the network."""

    def __init__(self, arena: Arena, out: Path, record: bool = True) -> None:
        super().__init__(arena, out, record)
        self.network = Namespaces(WIRED, list(arena.robots))
        self._weather = out / "weather.json"

    def __enter__(self) -> "FleetRig":
        super().__enter__()
        self.weather(Weather())
        self.network.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        super().__exit__(*exception)
        self.network.remove()

    def weather(self, weather: Weather) -> None:
        """What the radio does from now on (within 50 ms)."""
        fresh = self._weather.with_suffix(".new")
        fresh.write_bytes(msgspec.json.encode(weather))
        fresh.replace(self._weather)

    def start_network(self) -> None:
        """Relay and router; :meth:`start` does the rest."""
        ports = ["--uplink", UPLINK, "--weather", str(self._weather), "--ports", *self.arena.robots]
        self._run("relay", "groundstation.relay", ports)
        if self.arena.link.keys:
            self.start_router()
        self.family.wait_ready(rig.READY_S)

    def start_router(self) -> Child:
        """The router's process, not waited for."""
        return self._child("router", "groundstation", "router")

    def kill_router(self) -> None:
        """As if its computer had lost power, and at once start it again."""
        router = next(child for child in self.family.children if child.name == "router")
        router.signal(signal.SIGKILL)
        router.wait(5.0)
        self.family.children.remove(router)
        router.close()
        self.start_router()
        self.family.wait_ready(rig.READY_S)

    def start_station(self) -> Child:
        """The station's session, not waited for; :meth:`order` tells it what to do."""
        return self._child("session", "groundstation", "session")

    def order(self, *words: str, wait_s: float = 30.0) -> int:
        """A verb of ``ahdc-groundstation`` in the station's namespace, waited for; its exit code, -1: killed."""
        name = f"{words[0]}-{len(self.family.children)}"
        child = self._child(name, "groundstation", *words)
        if not child.wait(wait_s):
            child.signal(signal.SIGKILL)
            child.wait(1.0)
        code = child.code
        self.family.children.remove(child)
        child.close()
        return -1 if code is None or code < 0 else code

    def _child(self, name: str, module: str, *arguments: str) -> Child:
        verb, rest = list(arguments[:1]), list(arguments[1:])
        return self._run(name, module, [*verb, "--arena", str(self.config), *rest])

    def _run(self, name: str, module: str, arguments: list[str]) -> Child:
        member = PLACES.get(name, name if name in self.arena.robots else "station")
        log = self.out / "logs" / f"{name}.log"
        niceness = rig.NICENESS.get(name, rig.REALTIME_NICENESS)
        ends = {**rig.ENDS, "relay": 4, "router": 3}.get(name, 0)
        return self.family.start(name, module, arguments, log, niceness, ends, self.network.inside(member))
