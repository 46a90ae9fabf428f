"""What a driver costs per control step, against the bare library calls, family by family, in one run.

    ./kit exec python bench/driver_cost.py [--steps N] [--json FILE]

A step is what a robot does 100 times a second: both wheel speeds out, telemetry asked for, telemetry read.
Bare: the same bytes by ``pyserial`` (write, write, ``in_waiting``, read), or the same frames by ``python-can``'s
slcan bus (send each, receive until empty); nothing is decoded or checked. So the serial sides make equally many
writes and reads of equal bytes: the setpoint, the request, one read of all that came. Both run on ptys whose
other end is the emulated controller in virtual time, outside the timing. ``CPU``: thread time of the step. ``wire``:
from the call to the setpoint's last byte being readable at the other end. Blocks of the two sides alternate; a ratio
is the median over adjacent blocks of the ratio of their medians. The collector is set as a robot's process sets it.
"""

import argparse
import json
import os
import statistics
import sys
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import can
import serial

from contract.arena import Arena, Floor, Robot
from drivers.base import WheelSpeeds
from drivers.can.bus import SlcanPort
from drivers.can.slcan_text import SlcanReader
from drivers.defaults import DEFAULTS
from drivers.gated import GatedDrive
from drivers.mock.host import EmulatedRobot
from drivers.registry import FAMILIES, Family, open_robot
from drivers.serial.port import SerialPort
from onboard.service import quiet

PERIOD_NS = 10_000_000
BLOCK = 50
MIN_BLOCKS = 5
ROBOT = "r01"
SPEEDS = WheelSpeeds(3.0, -2.0)


class Rig:
    """An emulated controller behind a pty, in virtual time; ``pump`` moves bytes, outside every timing."""

    def __init__(self, family: Family) -> None:
        self.ours, theirs = os.openpty()
        tty.setraw(theirs)
        os.set_blocking(self.ours, False)
        self.path = os.ttyname(theirs)
        wheels = {"kind": family.kind, family.port_key: self.path, **DEFAULTS.get(family.kind, {})}
        if "watchdog_s" in wheels:
            wheels["watchdog_s"] = 0.2
        robot = Robot(body=ROBOT, start=(1.0, 1.0), wheels=wheels, emulate=("wheels", "body"))
        self.arena = Arena(arena=Floor(name="bench", size_m=(100.0, 100.0)), robots={ROBOT: robot})
        self.device = EmulatedRobot(self.arena, ROBOT, 0)
        self.now_ns = 1_000_000_000

    def heard(self) -> bytes:
        """Bytes on the wire towards the controller."""
        try:
            return os.read(self.ours, 65536)
        except BlockingIOError:
            return b""

    def pump(self, data: bytes = b"") -> None:
        """Let the controller take what was written, and answer."""
        data += self.heard()
        answer = self.device.controller.receive(data, self.now_ns)
        self.device.controller.take_samples()
        if answer:
            os.write(self.ours, answer)

    def pass_time(self, nanoseconds: int) -> None:
        self.now_ns += nanoseconds
        self.pump()


def port_of(rig: Rig, family: Family) -> Any:
    """The real port, whose clock and waiting are the rig's."""
    base: Any = SerialPort if family.port_key == "port" else SlcanPort

    class Virtual(base):  # type: ignore[misc]
        def now_ns(self) -> int:
            return rig.now_ns

        def wait(self, timeout_s: float) -> None:
            rig.pass_time(max(1_000_000, min(int(timeout_s * 1e9), 5_000_000)))

    rate = rig.device.controller.hub.bitrate if family.port_key == "channel" else 115200
    return Virtual(rig.path, rate)


def timed(rig: Rig, command: Callable[[], object], rest: Callable[[], object]) -> tuple[float, float]:
    """(CPU, wire) in us of one step; ``rest`` is run once telemetry is there."""
    begun, cpu = time.perf_counter_ns(), time.thread_time_ns()
    command()
    data = rig.heard()
    wire = time.perf_counter_ns() - begun
    cpu = time.thread_time_ns() - cpu
    rig.pump(data)
    rig.pass_time(PERIOD_NS // 2)
    begun_cpu = time.thread_time_ns()
    rest()
    cpu += time.thread_time_ns() - begun_cpu
    rig.pass_time(PERIOD_NS // 2)
    return cpu / 1e3, wire / 1e3


def ours(rig: Rig, drive: GatedDrive) -> Callable[[], tuple[float, float]]:
    def rest() -> None:
        drive.poll(rig.now_ns)
        drive.read(rig.now_ns)

    return lambda: timed(rig, lambda: drive.write(SPEEDS, rig.now_ns), rest)


def bare_serial(rig: Rig, setpoint: bytes, question: bytes) -> Callable[[], tuple[float, float]]:
    line = serial.Serial(rig.path, 115200, timeout=0)

    def rest() -> None:
        line.write(question)
        line.read(line.in_waiting)

    return lambda: timed(rig, lambda: line.write(setpoint), rest)


def bare_can(rig: Rig, setpoint: bytes) -> Callable[[], tuple[float, float]]:
    bus = can.Bus(interface="slcan", channel=rig.path, bitrate=rig.device.controller.hub.bitrate, sleep_after_open=0)
    frames = SlcanReader().feed(setpoint)
    messages = [can.Message(arbitration_id=f.can_id, data=f.data, is_extended_id=f.extended) for f in frames]

    def command() -> None:
        for message in messages:
            bus.send(message)

    def rest() -> None:
        while bus.serialPortOrig.in_waiting or bus._buffer:
            bus.recv(0)

    return lambda: timed(rig, command, rest)


def recorded(rig: Rig, drive: GatedDrive) -> tuple[bytes, bytes]:
    """The bytes of one setpoint and of one request for telemetry."""
    rig.pump()
    drive.write(SPEEDS, rig.now_ns)
    setpoint = rig.heard()
    rig.pump(setpoint)
    drive.poll(rig.now_ns)
    question = rig.heard()
    rig.pump(question)
    return setpoint, question


def measure(family: Family, steps: int) -> dict[str, float]:
    """Medians and their ratios of one family."""
    rig, other = Rig(family), Rig(family)
    drive = open_robot(rig.arena, ROBOT, port=port_of(rig, family))
    drive.configure()
    drive.activate(rig.now_ns)
    for _ in range(20):
        ours(rig, drive)()
    setpoint, question = recorded(rig, drive)
    is_serial = family.port_key == "port"
    sides = (ours(rig, drive), bare_serial(other, setpoint, question) if is_serial else bare_can(other, setpoint))
    blocks = [[medians(side) for side in sides] for _ in range(max(MIN_BLOCKS, steps // BLOCK))]
    drive.close()
    median = statistics.median
    return {
        "blocks": len(blocks),
        "cpu_us": median(ours.cpu_us for ours, _ in blocks),
        "bare_cpu_us": median(bare.cpu_us for _, bare in blocks),
        "cpu_ratio": median(ours.cpu_us / bare.cpu_us for ours, bare in blocks),
        "wire_us": median(ours.wire_us for ours, _ in blocks),
        "bare_wire_us": median(bare.wire_us for _, bare in blocks),
        "wire_ratio": median(ours.wire_us / bare.wire_us for ours, bare in blocks),
    }


class Cost(NamedTuple):
    """Of a step."""

    cpu_us: float
    wire_us: float


def medians(step: Callable[[], tuple[float, float]]) -> Cost:
    """Of one block."""
    return Cost(*map(statistics.median, zip(*(step() for _ in range(BLOCK)), strict=True)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1000, help="of each side and family (default 1000)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    quiet()
    results = {family.kind: measure(family, args.steps) for family in FAMILIES}
    print(f"{'family':<12} {'CPU us':>8} {'bare':>8} {'ratio':>6}   {'wire us':>8} {'bare':>8} {'ratio':>6}")
    for kind, row in results.items():
        left = f"{kind:<12} {row['cpu_us']:>8.1f} {row['bare_cpu_us']:>8.1f} {row['cpu_ratio']:>6.2f}"
        print(f"{left}   {row['wire_us']:>8.1f} {row['bare_wire_us']:>8.1f} {row['wire_ratio']:>6.2f}")
    if args.json is not None:
        args.json.write_text(json.dumps(results, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
