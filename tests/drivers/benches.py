"""One robot on the bench: arena table, emulated device, driver, and virtual time or ptys between them."""

import select
import time
from pathlib import Path
from typing import Any

from contract.arena import Arena, parse
from contract.messages import WheelFeedback
from drivers.base import WheelSpeeds
from drivers.can.bus import SlcanPort
from drivers.gated import GatedDrive
from drivers.mock.host import EmulatedWheels
from drivers.mock.wire import VirtualClock
from drivers.registry import open_robot, wheel_faults
from drivers.serial.port import SerialPort

WHEELS: dict[str, dict[str, Any]] = {
    "odrive": {"channel": "/dev/null", "interface": "slcan", "left": 4, "right": 5, "watchdog_s": 0.2},
    "roboclaw": {"port": "/dev/null", "counts_per_revolution": 2048},
    "dynamixel": {"port": "/dev/null", "left": 1, "right": 2, "gear_ratio": 1.25},
    "vesc": {
        "channel": "/dev/null",
        "interface": "slcan",
        "left": 10,
        "right": 11,
        "pole_pairs": 7,
        "min_erpm": 0.0,
        "watchdog_s": 0.2,
    },
    "vesc_uart": {"port": "/dev/null", "left": 10, "right": 11, "pole_pairs": 7, "min_erpm": 0.0, "watchdog_s": 0.2},
    "cia402": {"channel": "/dev/null", "interface": "slcan", "left": 4, "right": 5, "counts_per_revolution": 4096},
    "ros_arduino": {"port": "/dev/null", "counts_per_revolution": 2048, "watchdog_s": 0.2},
}
COMMON = {"gear_ratio": 7.0, "right_inverted": True}
ROBOT = "r06"


def arena_of(
    kind: str, safety: dict[str, Any] | None = None, control: dict[str, Any] | None = None, **wheels: Any
) -> Arena:
    table = {
        "arena": {"name": "bench", "size_m": [40.0, 40.0]},
        "safety": safety or {},
        "robots": {
            ROBOT: {
                "body": "a",
                "start": [20.0, 20.0],
                "emulate": ["wheels", "body"],
                "wheels": {"kind": kind, **COMMON, **WHEELS[kind], **wheels},
            }
        },
    }
    return parse(table, "bench", wheel_faults)


class Bench:
    """Virtual time: nothing passes unless ``run`` lets it."""

    def __init__(self, kind: str, safety: dict[str, Any] | None = None, seed: int = 0, **wheels: Any) -> None:
        self.kind = kind
        self.arena = arena_of(kind, safety, **wheels)
        self.clock = VirtualClock(10_000_000_000)
        self.host = EmulatedWheels(self.arena, seed=seed)
        self.drive: GatedDrive = open_robot(self.arena, ROBOT, port=self.host.wire(ROBOT, self.clock))
        self.samples: list[Any] = []

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns

    @property
    def device(self) -> Any:
        return self.host.robots[ROBOT].controller

    @property
    def device_counters(self) -> dict[str, int]:
        return self.host.batch(ROBOT, self.now_ns).counters

    @property
    def x_m(self) -> float:
        return self.host.pose(ROBOT)[0]

    def start(self) -> None:
        self.drive.configure()
        self.drive.activate(self.now_ns)
        self.run(0.1, (0.0, 0.0))

    def run(
        self, seconds: float, speeds: tuple[float, float] | None = None, period_s: float = 0.008
    ) -> WheelFeedback | None:
        """Control steps for a while; without speeds the computer is silent. The last sample read."""
        newest, period_s = None, 0.008
        for _ in range(round(seconds / period_s)):
            if speeds is not None:
                self.drive.write(WheelSpeeds(*speeds), self.now_ns)
            self._pass(0.25 * period_s)
            if speeds is not None:
                self.drive.poll(self.now_ns)
            self._pass(0.75 * period_s)
            if speeds is not None:
                newest = self.drive.read(self.now_ns) or newest
        return newest

    def _pass(self, seconds: float) -> None:
        self.clock.let_pass(seconds)
        self.host.advance(self.now_ns)
        self.samples += self.host.samples(ROBOT)

    def speeds(self) -> WheelSpeeds:
        return self.host.speeds(ROBOT)


class PumpedSerial(SerialPort):
    """A real serial port on a pty whose waits let the emulated end run."""

    host: EmulatedWheels

    def wait(self, timeout_s: float) -> None:
        pump(self.host, self.fileno(), timeout_s)


class PumpedSlcan(SlcanPort):
    """python-can on a pty whose waits let the emulated end run."""

    host: EmulatedWheels

    def wait(self, timeout_s: float) -> None:
        pump(self.host, self.fileno(), timeout_s)


def pump(host: EmulatedWheels, fd: int | None, timeout_s: float) -> None:
    """Serve the emulated end until ``fd`` is readable, by readiness alone."""
    end_ns = time.monotonic_ns() + int(timeout_s * 1e9)
    while True:
        now_ns = time.monotonic_ns()
        host.advance(now_ns)
        due_ns = min(host.next_due_ns() or end_ns, end_ns)
        ready, _, _ = select.select(
            [*host.fds(), *([fd] if fd is not None else [])], [], [], max(0, due_ns - now_ns) * 1e-9
        )
        for entry in ready:
            if entry != fd:
                host.on_readable(entry, time.monotonic_ns())
        if fd in ready or now_ns >= end_ns:
            return


class PtyBench:
    """The same over a real pty, python-can or pyserial opening it."""

    def __init__(self, kind: str, folder: Path, **wheels: Any) -> None:
        path = folder / "wheels"
        key = "channel" if "channel" in WHEELS[kind] else "port"
        self.arena = arena_of(kind, **{key: str(path)}, **wheels)
        self.host = EmulatedWheels(self.arena)
        self.host.plug()
        self.port: PumpedSerial | PumpedSlcan
        if key == "channel":
            self.port = PumpedSlcan(str(path), self.host.robots[ROBOT].controller.hub.bitrate)
        else:
            self.port = PumpedSerial(str(path), 115200)
        self.port.host = self.host
        self.drive = open_robot(self.arena, ROBOT, port=self.port)

    def step(self, left: float, right: float) -> WheelFeedback | None:
        """Control steps, waits served by readiness, until telemetry arrived; None after 40."""
        for _ in range(40):
            self.drive.write(WheelSpeeds(left, right), time.monotonic_ns())
            self.drive.poll(time.monotonic_ns())
            for _ in range(4):
                self.port.wait(0.005)
                sample = self.drive.read(time.monotonic_ns())
                if sample is not None:
                    return sample
        return None

    def counters(self) -> dict[str, int]:
        return self.host.batch(ROBOT, time.monotonic_ns()).counters

    def close(self) -> None:
        self.drive.close()
        self.host.close()
