"""ODrive over CANSimple: two axes on one bus, one node id a wheel.

Enable order (0.5.6 manual, "CAN Protocol"): controller mode, clear errors, axis state, then the
heartbeat must confirm closed loop. CANSimple cannot reach ``axis.config.watchdog_timeout``: it is
set over USB, and ``watchdog_s`` states what was set.
"""

from collections.abc import Sequence
from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault
from drivers.base import Site, WheelSpeeds
from drivers.can import odrive_codec as codec
from drivers.can.family import CanDrive, CanOptions, open_port
from drivers.can.frame import CanFrame
from drivers.conversion import WheelScale
from drivers.family import WheelMotor, pair_faults, undeclared
from drivers.ports import FramePort

__all__ = ["Drive", "Options", "check", "open_port"]

Node = Annotated[int, Meta(ge=0, le=codec.MAX_NODE, description="axis node id, axis.config.can.node_id")]

Seconds = Annotated[
    float,
    Meta(
        ge=0.0,
        le=2.0,
        description="axis.config.watchdog_timeout as set over USB with enable_watchdog = true; "
        "0 accepts that a hung computer leaves the wheels turning",
    ),
]


class Options(CanOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "odrive", ... }``"""

    kind: Literal["odrive"]
    bitrate: Annotated[
        int,
        Meta(ge=10_000, le=1_000_000, description="bit/s of the bus; a socketcan link must have been set to the same"),
    ] = 250_000
    left: Node
    right: Node
    dialect: Annotated[Literal["0.5", "0.6"], Meta(description="firmware line")] = "0.6"
    watchdog_s: Seconds | None = None


WATCHDOG_TEXT = (
    "CANSimple cannot set the device watchdog: set axis.config.watchdog_timeout and enable_watchdog = true "
    "over USB and write the same seconds here (0 accepts the risk of a robot without one)"
)


def check(options: Options, path: str) -> list[Fault]:
    """What no single key shows."""
    return pair_faults(options.left, options.right, path) + undeclared(options.watchdog_s, path, WATCHDOG_TEXT)


class _Axis(WheelMotor):
    """What one wheel's axis last said."""

    def __init__(self, name: str, node: int, gear_ratio: float, inverted: bool) -> None:
        scale = WheelScale.of(1.0, gear_ratio, inverted)
        super().__init__(name, node, scale, scale, None)

    def forget(self) -> None:
        super().forget()
        self.heartbeat: codec.Heartbeat | None = None


class Drive(CanDrive[Options, _Axis]):
    """:class:`drivers.base.DiffDrive` for two ODrive axes."""

    IDENTIFY_S = 0.6
    """Six heartbeats at their default period."""
    ENABLE_S = 0.6
    POLL_AFTER_NS = 60_000_000
    """Estimates are cyclic; one this late is asked for."""
    BUS_PERIOD_NS = 1_000_000_000

    def __init__(self, robot: str, options: Options, site: Site, port: FramePort) -> None:
        left = _Axis("left", options.left, options.gear_ratio, options.left_inverted)
        right = _Axis("right", options.right, options.gear_ratio, options.right_inverted)
        super().__init__("ODrive", robot, options, site, port, left, right)
        self._heard_ns = 0
        self._asked_ns = 0
        self._bus_asked_ns = 0

    def cycle(self) -> Sequence[CanFrame]:
        """Setpoints and estimates at their default 10 ms, and one heartbeat."""
        frames = [codec.set_input_vel(axis.device, 0.0) for axis in self.motors]
        commands = (codec.ENCODER_ESTIMATES, codec.ENCODER_ESTIMATES, codec.HEARTBEAT)
        return frames + [CanFrame(codec.frame_id(self.motors[0].device, command), bytes(8)) for command in commands]

    def configure(self) -> None:
        self.accept_watchdog(self.options.watchdog_s, WATCHDOG_TEXT)
        self.open()
        self.line.wait_until(lambda: all(axis.heartbeat for axis in self.motors), self.IDENTIFY_S)
        silent = [f"{axis.name} (node {axis.device})" for axis in self.motors if axis.heartbeat is None]
        if silent:
            self.close()
            raise self.line.lost(
                f"no heartbeat from {' and '.join(silent)}",
                "Check power, node ids, bitrate, CAN termination, and that nothing else holds the adapter",
            )

    def activate(self, now_ns: int) -> None:
        nodes = [axis.device for axis in self.motors]
        for axis in self.motors:
            axis.heartbeat = None
            axis.restart()
        self.line.send([codec.set_controller_mode(node) for node in nodes])
        self.line.send([codec.set_input_vel(node, 0.0) for node in nodes])
        self.line.send([codec.clear_errors(node) for node in nodes])
        self.line.send([codec.set_axis_state(node, codec.CLOSED_LOOP) for node in nodes])
        zeros = [codec.set_input_vel(node, 0.0) for node in nodes]
        if not self.line.wait_until(self.enabled, self.ENABLE_S, zeros):
            faults = self.faults()
            self.deactivate(now_ns)
            raise self.line.faulty(
                "closed loop not reached: " + (", ".join(faults) or "no heartbeat confirms it"),
                "Calibrate the axis, read its errors over USB, then activate again",
            )
        self.active = True

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        left, right = self.motors
        self.line.send(
            (
                codec.set_input_vel(left.device, speeds.left_radps * left.speed.units_per_rad),
                codec.set_input_vel(right.device, speeds.right_radps * right.speed.units_per_rad),
            )
        )

    def poll(self, now_ns: int) -> None:
        frames = []
        if now_ns - max(self._heard_ns, self._asked_ns) > self.POLL_AFTER_NS:
            self._asked_ns = now_ns
            frames += [codec.request(axis.device, codec.ENCODER_ESTIMATES) for axis in self.motors]
        if now_ns - self._bus_asked_ns > self.BUS_PERIOD_NS:
            self._bus_asked_ns = now_ns
            frames.append(codec.request(self.motors[0].device, codec.GET_BUS))
        if frames:
            self.line.send(frames)

    def read(self, now_ns: int) -> WheelFeedback | None:
        sample = super().read(now_ns)
        if sample is not None:
            self._heard_ns = now_ns
        return sample

    def deactivate(self, now_ns: int) -> None:
        self.active = False
        self.line.send(
            [codec.set_input_vel(axis.device, 0.0) for axis in self.motors]
            + [codec.set_axis_state(axis.device, codec.IDLE) for axis in self.motors]
        )

    def clear_errors(self, now_ns: int) -> None:
        self.line.send([codec.clear_errors(axis.device) for axis in self.motors])

    def sender(self, can_id: int) -> int:
        return can_id >> 5

    def take(self, motor: _Axis, frame: CanFrame) -> str:
        command = frame.can_id & 0x1F
        if command == codec.ENCODER_ESTIMATES:
            estimates = codec.decode_estimates(frame.data)
            if estimates is None:
                return "bad_estimates"
            return motor.take_motion(estimates.velocity_revps, estimates.position_rev)
        if command == codec.HEARTBEAT:
            heartbeat = codec.decode_heartbeat(frame.data, self.options.dialect)
            if heartbeat is None:
                return "bad_heartbeat"
            motor.heartbeat = heartbeat
        elif command == codec.GET_BUS:
            bus = codec.decode_bus(frame.data)
            if bus is None or not 0.0 <= bus.volts <= 100.0:
                return "bad_bus"
            self.bus_v = bus.volts
        else:
            return "unused_frame"
        return ""

    def enabled(self) -> bool:
        return all(_runs(axis.heartbeat) for axis in self.motors)

    def faults(self) -> tuple[str, ...]:
        """In words. Firmware 0.5 lets the watchdog expire while idle, too: no fault before activation."""
        names: list[str] = []
        for axis in self.motors:
            beat = axis.heartbeat
            if beat is None:
                continue
            flags = (beat.motor_fault, beat.encoder_fault, beat.controller_fault)
            error = beat.axis_error
            if not self.active:
                error &= ~codec.WATCHDOG_BIT[self.options.dialect]
            names += [f"{axis.name} {name}" for name in codec.error_names(error, self.options.dialect)]
            names += [
                f"{axis.name} {part} fault"
                for part, wrong in zip(("motor", "encoder", "controller"), flags, strict=True)
                if wrong
            ]
            if self.active and beat.state != codec.CLOSED_LOOP:
                names.append(f"{axis.name} left closed loop")
        return tuple(names)


def _runs(heartbeat: codec.Heartbeat | None) -> bool:
    return heartbeat is not None and heartbeat.state == codec.CLOSED_LOOP and not heartbeat.axis_error
