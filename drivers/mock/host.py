"""Every emulated robot of an arena: its controller, its pty, its motors and its rolling body."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from contract.arena import Arena, Robot
from contract.messages import MotorBatch, MotorSample
from contract.units import metres, radians
from drivers.base import WheelSpeeds
from drivers.mock.body import Body
from drivers.mock.controller import EmulatedController, Wheels
from drivers.mock.faults import FaultKind, FaultSettings, FaultyLine
from drivers.mock.motor import MotorLimits
from drivers.mock.ports import PtyPort
from drivers.mock.wire import VirtualClock, WireFramePort, WirePort
from drivers.registry import port_path, read_options


class EmulatedRobot:
    """One robot's emulated wheels, from the line to the floor."""

    def __init__(self, arena: Arena, name: str, seed: int) -> None:
        robot: Robot = arena.robots[name]
        family, options = read_options(robot.wheels)
        self.name = name
        self.family = family
        self.wheels = Wheels.of(MotorLimits.of(arena.platform))
        self.controller: EmulatedController = importlib.import_module(family.emulator).emulate(options, self.wheels)
        self.body = Body(arena.platform, robot.start, robot.heading_rad)
        self.line = FaultyLine(seed)
        self.port = PtyPort(Path(port_path(robot.wheels)))
        self.samples: list[MotorSample] = []
        self.wires: list[WirePort] = []
        self.jammed = False
        """Nobody reads what the computer writes."""
        self._telemetry = b""

    def on_readable(self, now_ns: int) -> None:
        if self.jammed:
            return
        data = self.line.carry("commands", self.port.read(), now_ns)
        self._answer(self.controller.receive(data, now_ns), now_ns)
        self.deliver()

    def advance(self, now_ns: int) -> None:
        """Let time pass; what the device sends waits for :meth:`deliver`."""
        late = self.line.carry("commands", b"", now_ns)
        self._answer(self.controller.receive(late, now_ns) if late else self.controller.advance(now_ns), now_ns)

    def deliver(self) -> bool:
        """Hand the computer what the device has sent; False: nothing."""
        if not self._telemetry:
            return False
        if self.wires:
            self.wires[-1].deliver(self._telemetry)
        else:
            self.port.write(self._telemetry)
        self._telemetry = b""
        return True

    def roll(self) -> None:
        """Bring the body to where the wheels have turned."""
        self.samples += self.controller.take_samples()
        left, right = self.wheels
        self.body.roll(left.angle_rad, right.angle_rad)

    def _answer(self, data: bytes, now_ns: int) -> None:
        self._telemetry += self.line.carry("telemetry", data, now_ns)
        self.roll()


class EmulatedWheels:
    """All robots of an arena whose ``emulate`` names the wheels.

    Over ptys: ``plug``, then ``on_readable`` and ``advance`` from an event loop. In virtual time:
    ``wire`` gives each driver its port, and ``advance`` follows the clock.
    """

    def __init__(self, arena: Arena, robots: Sequence[str] | None = None, seed: int = 0) -> None:
        emulated = [name for name, robot in arena.robots.items() if "wheels" in robot.emulate]
        self.robots = {
            name: EmulatedRobot(arena, name, seed + index)
            for index, name in enumerate(emulated if robots is None else robots)
        }
        self._by_fd: dict[int, EmulatedRobot] = {}

    def plug(self) -> None:
        """Create every pty under the path its wheels table names.

        :raises ValueError: a wheels table names a kernel CAN interface instead of a path.
        :raises FileExistsError: a real device or file has that name.
        """
        for robot in self.robots.values():
            if robot.port.link is not None and not robot.port.link.is_absolute():
                raise ValueError(
                    f"robots.{robot.name}.wheels.{robot.family.port_key} = {robot.port.link}: emulated wheels need "
                    'an absolute path for their pty (odrive: interface = "slcan")'
                )
            robot.port.plug()
        self._index()

    def fds(self) -> list[int]:
        """Descriptors to wait on; they change when a port is unplugged or plugged."""
        return list(self._by_fd)

    def on_readable(self, fd: int, now_ns: int) -> None:
        robot = self._by_fd.get(fd)
        if robot is not None:
            robot.on_readable(now_ns)

    def advance(self, now_ns: int) -> None:
        """Let time pass for every device, motor and body."""
        self.roll(now_ns)
        self.deliver()

    def roll(self, now_ns: int) -> None:
        """The same, but what the devices send waits for :meth:`deliver`."""
        for robot in self.robots.values():
            robot.advance(now_ns)

    def deliver(self) -> None:
        for robot in self.robots.values():
            robot.deliver()

    def next_due_ns(self) -> int | None:
        """When a device next sends or times out by itself."""
        times = [
            time
            for robot in self.robots.values()
            for time in (robot.controller.next_due_ns(), robot.line.next_due_ns())
            if time is not None
        ]
        return min(times, default=None)

    def wire(self, name: str, clock: VirtualClock) -> Any:
        """A port for the robot's driver in memory, in virtual time."""
        robot = self.robots[name]
        wire = WirePort(robot.controller, clock, robot.line)
        robot.wires.append(wire)
        return wire if robot.family.port_key == "port" else WireFramePort(wire)

    def speeds(self, name: str) -> WheelSpeeds:
        """True wheel speeds."""
        left, right = self.robots[name].wheels
        return WheelSpeeds(left.radps, right.radps)

    def pose(self, name: str) -> tuple[float, float, float]:
        """True x in m, y in m, heading in rad."""
        body = self.robots[name].body
        return body.x_m, body.y_m, body.heading_rad

    def samples(self, name: str) -> list[MotorSample]:
        """Commands decoded since the last call."""
        robot = self.robots[name]
        robot.samples += robot.controller.take_samples()
        taken, robot.samples = robot.samples, []
        return taken

    def batch(self, name: str, now_ns: int) -> MotorBatch:
        """The report on one robot: commands decoded since the last, true pose, everything refused."""
        robot = self.robots[name]
        body, speeds = robot.body, self.speeds(name)
        counters = robot.controller.counters + robot.port.counters + robot.line.counters
        return MotorBatch(
            robot=name,
            samples=tuple(self.samples(name)),
            true_ns=now_ns,
            true_x_m=metres(body.x_m),
            true_y_m=metres(body.y_m),
            true_heading_rad=radians(body.heading_rad),
            true_speed_mps=body.speed_mps(*speeds),
            counters=dict(counters),
        )

    def fault(self, name: str, kind: FaultKind, settings: FaultSettings | None = None) -> None:
        """Inject a fault until ``repair``.

        :raises ValueError: ``bus-off`` on a serial controller.
        """
        settings = FaultSettings() if settings is None else settings
        self._set(self.robots[name], kind, settings, True)

    def repair(self, name: str, kind: FaultKind) -> None:
        self._set(self.robots[name], kind, FaultSettings(), False)

    def close(self) -> None:
        """Remove every pty and link."""
        for robot in self.robots.values():
            robot.port.unplug()
        self._by_fd.clear()

    def _set(self, robot: EmulatedRobot, kind: FaultKind, settings: FaultSettings, on: bool) -> None:
        if kind in ("off", "stuck"):
            for side in settings.wheels:
                motor = getattr(robot.wheels, side)
                if kind == "off":
                    motor.supplied = not on
                else:
                    motor.stuck = on
        elif kind == "frozen":
            for side in settings.wheels:
                motor = getattr(robot.wheels, side)
                motor.frozen_rad = motor.angle_rad if on else None
        elif kind == "brown-out":
            robot.controller.brown_out(on)
        elif kind == "jammed":
            robot.jammed = on
            for wire in robot.wires:
                wire.jammed = on
            self._index()
        elif kind == "wrong":
            robot.controller.set_sensor_sign(-1.0 if on else 1.0)
        elif kind == "hung":
            robot.controller.hung = on
        elif kind == "bus-off":
            if not hasattr(robot.controller, "bus_off"):
                raise ValueError(f"{robot.name}: a {robot.family.kind} has no CAN bus")
            robot.controller.bus_off = on
        elif kind == "unplugged":
            self._plug(robot, not on)
        elif on:
            robot.line.faults[kind] = settings
        else:
            robot.line.faults.pop(kind, None)

    def _plug(self, robot: EmulatedRobot, plugged: bool) -> None:
        for wire in robot.wires:
            wire.plugged = plugged
        if plugged and not robot.wires:
            robot.port.plug()
        else:
            robot.port.unplug()
        self._index()

    def _index(self) -> None:
        self._by_fd = {
            robot.port.fileno(): robot for robot in self.robots.values() if robot.port.plugged and not robot.jammed
        }
