"""A process that hung between a command and its bus: what it wrote before is refused as old, whatever time it is."""

from typing import Any

import pytest

from contract.arena import Safety
from drivers.base import STANDSTILL, WheelSpeeds
from drivers.gate import Gate, GateLimits
from drivers.gated import GatedDrive
from drivers.health import Health
from onboard.agent import Agent, Drive
from onboard.runtime import Runtime
from tests.onboard.samples import arena

MS = 1_000_000
SAFETY = Safety()


class Bus:
    """Keeps what would reach the motors."""

    device, port_name, dead_zone_radps = "bus", "nowhere", 0.0

    def __init__(self) -> None:
        self.written: list[WheelSpeeds] = []
        self.counters: dict[str, int] = {}

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        self.written.append(speeds)

    def fileno(self) -> int:
        return 0

    def __getattr__(self, name: str) -> Any:
        return lambda *_: None


class Clock:
    now = 1_000 * MS

    def now_ns(self) -> int:
        return self.now


@pytest.mark.parametrize(("hung_ms", "passes"), [(0, True), (100, True), (101, False), (600, False)])
def test_a_command_from_before_the_process_hung_turns_no_wheel(hung_ms: int, passes: bool) -> None:
    bus, clock, site = Bus(), Clock(), arena()
    gate = Gate(GateLimits(30.0, 1e6, int(SAFETY.command_age_s * 1e9)))
    runtime = Runtime(site, "r01", Agent(site, "r01", 1), GatedDrive(bus, gate, Health(SAFETY)))
    runtime._time = clock
    runtime._wheels.open(clock.now)
    moving = Drive(True, 5.0, 5.0)
    runtime._apply(moving, False, clock.now)
    clock.now += 10 * MS
    runtime._apply(moving, True, clock.now)
    assert bus.written[-1] == (5.0, 5.0)
    turn_ns = clock.now
    clock.now += hung_ms * MS
    runtime._apply(moving, True, turn_ns)
    assert bus.written[-1] == ((5.0, 5.0) if passes else STANDSTILL)
    assert gate.counters["stale"] == (0 if passes else 1)
    runtime._apply(Drive(True, 0.0, 0.0), True, turn_ns)
    assert bus.written[-1] == STANDSTILL
