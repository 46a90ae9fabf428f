"""What a driver costs per control step, against the bare library calls, family by family, in one run.

    ./kit exec python bench/driver_cost.py [--steps N] [--json FILE]

A step is what a robot does 100 times a second: both wheel speeds out, telemetry asked for, telemetry read.
Bare: the same bytes by ``pyserial`` (write, write, ``in_waiting``, read), or the same frames by ``python-can``'s
slcan bus (send each, receive until empty), ready made before the run; nothing is encoded, decoded or checked. So the
serial sides make equally many writes and reads of equal bytes: the setpoint, the request, one read of all that came.
The commands differ from step to step, and the gate must let every one pass as it is. Both sides run on ptys whose
other end is the emulated controller in virtual time, outside the timing.

``CPU``: thread time of the step, the calls in full. ``wire``, in steps of its own: from the call until the setpoint's
last byte was read at the other end, at once after the write(2) that carried it; what either side does after its last
write (our bookkeeping, pyserial's ``select``, python-can's wait for the line to drain) is no part of it, nor is the
reading of any write but the last. Of that, ``kernel`` is from the last write(2) on: on a serial line the same call with
the same bytes on both sides, 6 us or 15 by the core that happens to serve the pty, and which one that is may stay for a
whole run. So there the median over both sides counts for both; each side's own is told beside it.

Blocks of the two sides alternate and are short, so that both see the same phase of the machine; a ratio is the median
over adjacent blocks of the ratio of their medians. The collector is set as a robot's process sets it.
"""

import argparse
import itertools
import json
import os
import statistics
import sys
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import can
import serial

from contract.arena import Arena, Floor, Robot
from drivers.base import WheelSpeeds
from drivers.can.bus import SlcanPort
from drivers.can.frame import CanFrame
from drivers.can.slcan_text import SlcanReader
from drivers.defaults import DEFAULTS
from drivers.gated import GatedDrive
from drivers.mock.host import EmulatedRobot
from drivers.registry import FAMILIES, Family, open_robot
from drivers.serial.port import SerialPort
from onboard.service import quiet

PERIOD_NS = 10_000_000
BLOCK = 10
MIN_BLOCKS = 25
ROBOT = "r01"
COMMANDS = tuple(WheelSpeeds(3.0 + 0.011 * step, -2.0 - 0.007 * step) for step in (*range(20), *range(20, 0, -1)))
write = os.write


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


class Tap:
    """Stands in for ``os.write`` while a command runs: reads each write's bytes at the other end at once."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self.data = b""
        self.written_ns = 0
        """When the last write(2) so far began."""
        self.end_ns = 0
        """When its last byte had been read."""
        self._aside_ns = 0
        self._last_read_ns = 0

    def __call__(self, fd: int, data: bytes) -> int:
        begun_ns = time.perf_counter_ns()
        count = write(fd, data)
        read_ns = time.perf_counter_ns()
        self.data += self._rig.heard()
        self.end_ns = time.perf_counter_ns()
        self.written_ns = begun_ns
        self._aside_ns += self._last_read_ns
        self._last_read_ns = self.end_ns - read_ns
        return count

    def before_ns(self, begun_ns: int) -> int:
        """From there to the last write(2), reads left out."""
        return self.written_ns - begun_ns - self._aside_ns


class Side:
    """One way to do a step: ``command`` puts the next setpoint on the wire, ``rest`` asks for and takes telemetry."""

    def __init__(self, rig: Rig, commands: Sequence[Callable[[], object]], rest: Callable[[], object]) -> None:
        self._rig = rig
        self._commands = itertools.cycle(commands)
        self._rest = rest

    def cpu_us(self) -> float:
        """Of one step."""
        command = next(self._commands)
        begun = time.thread_time_ns()
        command()
        spent = time.thread_time_ns() - begun
        self._rig.pass_time(PERIOD_NS // 2)
        begun = time.thread_time_ns()
        self._rest()
        spent += time.thread_time_ns() - begun
        self._rig.pass_time(PERIOD_NS // 2)
        return spent / 1e3

    def wire_us(self) -> tuple[float, float]:
        """Of one step: up to the last write(2), and from then on."""
        command = next(self._commands)
        os.write = tap = Tap(self._rig)  # type: ignore[assignment]
        begun = time.perf_counter_ns()
        try:
            command()
        finally:
            os.write = write
        self._rig.pump(tap.data)
        self._rig.pass_time(PERIOD_NS // 2)
        self._rest()
        self._rig.pass_time(PERIOD_NS // 2)
        return tap.before_ns(begun) / 1e3, (tap.end_ns - tap.written_ns) / 1e3


def ours(rig: Rig, drive: GatedDrive) -> Side:
    def rest() -> None:
        drive.poll(rig.now_ns)
        drive.read(rig.now_ns)

    return Side(rig, [lambda speeds=speeds: drive.write(speeds, rig.now_ns) for speeds in COMMANDS], rest)


def bare_serial(rig: Rig, setpoints: Sequence[bytes], question: bytes) -> Side:
    line = serial.Serial(rig.path, 115200, timeout=0)

    def rest() -> None:
        line.write(question)
        line.read(line.in_waiting)

    return Side(rig, [lambda packet=packet: line.write(packet) for packet in setpoints], rest)


def bare_can(rig: Rig, setpoints: Sequence[bytes]) -> Side:
    bus = can.Bus(interface="slcan", channel=rig.path, bitrate=rig.device.controller.hub.bitrate, sleep_after_open=0)

    def send(messages: list[can.Message]) -> None:
        for message in messages:
            bus.send(message)

    def rest() -> None:
        while bus.serialPortOrig.in_waiting or bus._buffer:
            bus.recv(0)

    turns = [[message(frame) for frame in SlcanReader().feed(setpoint)] for setpoint in setpoints]
    return Side(rig, [lambda messages=messages: send(messages) for messages in turns], rest)


def message(frame: CanFrame) -> can.Message:
    return can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=frame.extended)


def recorded(rig: Rig, drive: GatedDrive) -> tuple[list[bytes], bytes]:
    """The bytes of every setpoint, and of one request for telemetry."""
    rig.pump()
    setpoints = []
    for speeds in COMMANDS:
        drive.write(speeds, rig.now_ns)
        setpoints.append(rig.heard())
        rig.pump(setpoints[-1])
        rig.pass_time(PERIOD_NS)
        drive.read(rig.now_ns)
    drive.poll(rig.now_ns)
    question = rig.heard()
    rig.pump(question)
    return setpoints, question


def measure(family: Family, steps: int) -> dict[str, float]:
    """Medians and their ratios of one family."""
    rig, other = Rig(family), Rig(family)
    drive = open_robot(rig.arena, ROBOT, port=port_of(rig, family))
    drive.configure()
    drive.activate(rig.now_ns)
    while drive.gate.permit(COMMANDS[0], rig.now_ns, rig.now_ns) != COMMANDS[0]:
        rig.pass_time(PERIOD_NS)
    setpoints, question = recorded(rig, drive)
    is_serial = family.port_key == "port"
    bare = bare_serial(other, setpoints, question) if is_serial else bare_can(other, setpoints)
    sides = (ours(rig, drive), bare)
    for side in sides:
        cost(side, len(COMMANDS))
    drive.gate.counters.clear()
    blocks = [paired(*(cost(side, BLOCK) for side in sides), is_serial) for _ in range(max(MIN_BLOCKS, steps // BLOCK))]
    if drive.gate.counters:
        raise RuntimeError(f"{family.kind}: the gate changed commands: {dict(drive.gate.counters)}")
    drive.close()
    return {"blocks": len(blocks), **{name: statistics.median(block[name] for block in blocks) for name in blocks[0]}}


class Cost(NamedTuple):
    """Of a step, medians."""

    cpu_us: float
    before_us: float
    """Up to the last write(2)."""
    kernel_us: tuple[float, ...]
    """From then on, of every step."""


def cost(side: Side, steps: int) -> Cost:
    """Of so many steps each."""
    cpu_us, wire_us = zip(*((side.cpu_us(), side.wire_us()) for _ in range(steps)), strict=True)
    before_us, kernel_us = zip(*wire_us, strict=True)
    return Cost(statistics.median(cpu_us), statistics.median(before_us), kernel_us)


def paired(ours: Cost, bare: Cost, same_bytes: bool) -> dict[str, float]:
    """Figures of two adjacent blocks.

    :param same_bytes: the last write(2) of both sides is the same.
    """
    kernel_us, bare_kernel_us = statistics.median(ours.kernel_us), statistics.median(bare.kernel_us)
    wire_us, bare_wire_us = ours.before_us + kernel_us, bare.before_us + bare_kernel_us
    if same_bytes:
        both_us = statistics.median((*ours.kernel_us, *bare.kernel_us))
        wire_us, bare_wire_us = ours.before_us + both_us, bare.before_us + both_us
    return {
        "cpu_us": ours.cpu_us,
        "bare_cpu_us": bare.cpu_us,
        "cpu_ratio": ours.cpu_us / bare.cpu_us,
        "wire_us": wire_us,
        "bare_wire_us": bare_wire_us,
        "wire_ratio": wire_us / bare_wire_us,
        "kernel_us": kernel_us,
        "bare_kernel_us": bare_kernel_us,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1000, help="of each side and family (default 1000)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    quiet()
    results = {family.kind: measure(family, args.steps) for family in FAMILIES}
    wire = f"{'wire us':>8} {'bare':>8} {'ratio':>6}   {'kernel us':>9} {'bare':>8}"
    print(f"{'family':<12} {'CPU us':>8} {'bare':>8} {'ratio':>6}   {wire}")
    for kind, row in results.items():
        left = f"{kind:<12} {row['cpu_us']:>8.1f} {row['bare_cpu_us']:>8.1f} {row['cpu_ratio']:>6.2f}"
        right = f"{row['wire_us']:>8.1f} {row['bare_wire_us']:>8.1f} {row['wire_ratio']:>6.2f}"
        print(f"{left}   {right}   {row['kernel_us']:>9.1f} {row['bare_kernel_us']:>8.1f}")
    if args.json is not None:
        args.json.write_text(json.dumps(results, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
