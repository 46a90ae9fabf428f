"""Stand-ins for tests: one emulated controller on a pty, and a whole arena in virtual time."""

import os
import select
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from contract import profiles
from contract.arena import Arena, Floor, Robot
from contract.messages import MotorSample
from drivers.base import WheelSpeeds
from drivers.defaults import DEFAULTS
from drivers.mock.faults import FaultKind, FaultSettings
from drivers.mock.host import EmulatedWheels
from drivers.registry import family_of
from groundstation.conditions import FIELD
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from groundstation.wire import Wire

ROBOT = "r01"
WAIT_S = 5.0
FENCE_M = 0.05
"""The floor's edge, for a law nobody here knows."""


class EmulatedPort:
    """One emulated controller served by a thread until :meth:`close`."""

    def __init__(self, kind: str, folder: Path, options: dict[str, Any]) -> None:
        family = family_of(kind)
        if family is None:
            raise ValueError(f"no controller family {kind!r}; see: ahdc-drivers list")
        self.path = str(folder / f"{kind}-{id(self):x}")
        """What the driver under test opens."""
        wheels = {"kind": kind, family.port_key: self.path, **DEFAULTS.get(kind, {}), **options}
        robot = Robot(body=ROBOT, start=(1.0, 1.0), wheels=wheels, emulate=("wheels", "body"))
        self._host = EmulatedWheels(Arena(arena=Floor(name="emulated", size_m=(40.0, 40.0)), robots={ROBOT: robot}))
        self._host.plug()
        self._lock = threading.Lock()
        self._wake, self._stop = os.pipe()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def speeds(self) -> WheelSpeeds:
        """True wheel speeds, rad/s."""
        with self._lock:
            self._host.advance(time.monotonic_ns())
            return self._host.speeds(ROBOT)

    def samples(self) -> list[MotorSample]:
        """Commands it has decoded since the last call."""
        with self._lock:
            return self._host.samples(ROBOT)

    def counters(self) -> dict[str, int]:
        """Bytes and frames it refused, by name."""
        with self._lock:
            return self._host.batch(ROBOT, time.monotonic_ns()).counters

    def fault(self, kind: FaultKind, settings: FaultSettings | None = None) -> None:
        """Inject a fault until :meth:`repair`."""
        with self._lock:
            self._host.fault(ROBOT, kind, settings)

    def repair(self, kind: FaultKind) -> None:
        with self._lock:
            self._host.repair(ROBOT, kind)

    def wait_for(self, what: Callable[[WheelSpeeds], bool], seconds: float = WAIT_S) -> WheelSpeeds:
        """The wheel speeds once they are as wanted.

        :raises AssertionError: they were not within ``seconds``.
        """
        end_ns = time.monotonic_ns() + int(seconds * 1e9)
        while not what(speeds := self.speeds()):
            assert time.monotonic_ns() < end_ns, f"still {speeds} after {seconds:g} s"
            time.sleep(0.005)
        return speeds

    def close(self) -> None:
        os.write(self._stop, b"x")
        self._thread.join(WAIT_S)
        self._host.close()
        os.close(self._wake)
        os.close(self._stop)

    def _serve(self) -> None:
        while True:
            with self._lock:
                fds, due_ns = self._host.fds(), self._host.next_due_ns()
            wait_s = 0.02 if due_ns is None else min(0.02, max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
            try:
                ready, _, _ = select.select([*fds, self._wake], [], [], wait_s)
            except (OSError, ValueError):
                continue
            if self._wake in ready:
                return
            with self._lock:
                now_ns = time.monotonic_ns()
                for fd in set(ready) & set(self._host.fds()):
                    self._host.on_readable(fd, now_ns)
                self._host.advance(now_ns)


class MockArena:
    """A mission in virtual time. Nothing passes unless :meth:`run` lets it; same seed, same run."""

    def __init__(
        self,
        robots: int = 6,
        targets: int = 19,
        seed: int = 1,
        wheels: list[dict[str, Any]] | None = None,
        profile: str = "field",
        law: dict[str, Any] | None = None,
    ) -> None:
        """:param profile: the control law; ``law`` is what ``[control.law]`` says to one of your own."""
        arena = arena_for(Job(robots, targets, seed, profile, "field", 600.0, wired=True))
        control = msgspec.structs.replace(arena.control, law=law or {})
        floor = arena.arena if profile in profiles.OURS else msgspec.structs.replace(arena.arena, fence_m=FENCE_M)
        arena = msgspec.structs.replace(arena, arena=floor, control=control)
        if wheels is not None:
            changed = {
                name: msgspec.structs.replace(robot, wheels=wheels[index % len(wheels)])
                for index, (name, robot) in enumerate(arena.robots.items())
            }
            arena = msgspec.structs.replace(arena, robots=changed)
        self.world = World(arena, scenario(robots, targets, seed), FIELD, seed, 600.0, wired=True)
        self._passed_s = 0.0

    @property
    def robots(self) -> list[str]:
        return list(self.world.agents)

    def run(self, seconds: float) -> bool:
        """Let time pass, the mission starting at once; True if all targets are occupied."""
        self._passed_s += seconds
        return self.world.until(self._passed_s)

    def pose(self, robot: str) -> tuple[float, float, float]:
        """True x in m, y in m, heading in rad."""
        return self._wire.emulated.pose(robot)

    def speeds(self, robot: str) -> WheelSpeeds:
        """True wheel speeds, rad/s."""
        return self._wire.emulated.speeds(robot)

    def state(self, robot: str) -> str:
        """Run state, such as ``running``, ``stopped`` or ``fault``."""
        return self.world.agents[robot].run_state

    def fault(self, robot: str, kind: FaultKind, settings: FaultSettings | None = None) -> None:
        """Inject a fault into a robot's wheels until :meth:`repair`."""
        self._wire.emulated.fault(robot, kind, settings)

    def repair(self, robot: str, kind: FaultKind) -> None:
        self._wire.emulated.repair(robot, kind)

    @property
    def collisions(self) -> int:
        """Pairs of robots that have touched."""
        return self.world.referee.collisions

    def counters(self, robot: str) -> dict[str, int]:
        """What the robot's agent has refused or caught, by name."""
        return dict(self.world.agents[robot].counters)

    @property
    def split(self) -> bool:
        """The network was not connected at some time."""
        return self.world.referee.disconnected > 0

    @property
    def _wire(self) -> Wire:
        hops = self.world.hops
        assert isinstance(hops, Wire)
        return hops
