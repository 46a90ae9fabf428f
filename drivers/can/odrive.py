"""ODrive over CANSimple: two axes on one bus, one node id a wheel.

Enable order (0.5.6 manual, "CAN Protocol"): controller mode, clear errors, axis state, then the
heartbeat must confirm closed loop. CANSimple cannot reach ``axis.config.watchdog_timeout``: it is
set over USB, and ``watchdog_s`` states what was set.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault, show
from drivers.base import ControllerFault, Site, WheelSpeeds
from drivers.can import odrive_codec as codec
from drivers.can.frame import CanFrame
from drivers.can.line import CanLine
from drivers.conversion import Odometer, WheelScale
from drivers.options import WheelOptions
from drivers.ports import FramePort

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


class Options(WheelOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "odrive", ... }``"""

    kind: Literal["odrive"]
    channel: Annotated[
        str, Meta(min_length=1, max_length=200, description="CAN interface (can0), or the adapter's tty for slcan")
    ]
    interface: Annotated[Literal["socketcan", "slcan"], Meta(description="python-can interface")] = "socketcan"
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000, description="bit/s; slcan only, else set it on the link")] = (
        250_000
    )
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
    faults = []
    if options.left == options.right:
        faults.append(Fault(f"{path}.right", show(options.right), "must differ from left"))
    if options.watchdog_s is None:
        faults.append(Fault(f"{path}.watchdog_s", "", f"missing; {WATCHDOG_TEXT}"))
    return faults


def open_port(options: Options) -> FramePort:
    """The bus by its python-can interface."""
    from drivers.can.bus import can_port

    return can_port(options.interface, options.channel, options.bitrate)


class _Axis:
    """What one wheel's axis last said."""

    def __init__(self, name: str, node: int, scale: WheelScale) -> None:
        self.name = name
        self.node = node
        self.scale = scale
        self.odometer = Odometer(scale)
        self.heartbeat: codec.Heartbeat | None = None
        self.radps = 0.0
        self.fresh = False


class Drive:
    """:class:`drivers.base.DiffDrive` for two ODrive axes."""

    IDENTIFY_S = 0.6
    """Six heartbeats at their default period."""
    ENABLE_S = 0.6
    POLL_AFTER_NS = 60_000_000
    """Estimates are cyclic; one this late is asked for."""
    BUS_PERIOD_NS = 1_000_000_000

    def __init__(self, robot: str, options: Options, site: Site, port: FramePort) -> None:
        self.robot = robot
        self.options = options
        self._site = site
        self._line = CanLine(f"ODrive of {robot}", port, self._take)
        gear = options.gear_ratio
        self._left = _Axis("left", options.left, WheelScale.of(1.0, gear, options.left_inverted))
        self._right = _Axis("right", options.right, WheelScale.of(1.0, gear, options.right_inverted))
        self._axes = (self._left, self._right)
        self._by_node = {axis.node: axis for axis in self._axes}
        self._bus_v: float | None = None
        self._active = False
        self._heard_ns = 0
        self._asked_ns = 0
        self._bus_asked_ns = 0

    @property
    def counters(self) -> Mapping[str, int]:
        return self._line.total()

    def configure(self) -> None:
        declared = self.options.watchdog_s
        if declared is None:
            raise self._line.refused("the device watchdog is unknown", WATCHDOG_TEXT)
        if declared > self._site.safety.watchdog_s:
            raise self._line.refused(
                f"watchdog_s = {declared:g} s exceeds safety.watchdog_s = {self._site.safety.watchdog_s:g} s",
                "Lower axis.config.watchdog_timeout over USB, then watchdog_s here",
            )
        self._line.open()
        for axis in self._axes:
            axis.heartbeat, axis.fresh = None, False
        self._line.wait_until(lambda: all(axis.heartbeat for axis in self._axes), self.IDENTIFY_S)
        silent = [f"{axis.name} (node {axis.node})" for axis in self._axes if axis.heartbeat is None]
        if silent:
            self.close()
            raise self._line.lost(
                f"no heartbeat from {' and '.join(silent)}",
                "Check power, node ids, bitrate, CAN termination, and that nothing else holds the adapter",
            )

    def activate(self, now_ns: int) -> None:
        nodes = [axis.node for axis in self._axes]
        for axis in self._axes:
            axis.heartbeat = None
            axis.odometer = Odometer(axis.scale)
        self._line.send([codec.set_controller_mode(node) for node in nodes])
        self._line.send([codec.set_input_vel(node, 0.0) for node in nodes])
        self._line.send([codec.clear_errors(node) for node in nodes])
        self._line.send([codec.set_axis_state(node, codec.CLOSED_LOOP) for node in nodes])
        zeros = [codec.set_input_vel(node, 0.0) for node in nodes]
        running = self._line.wait_until(lambda: all(_runs(axis.heartbeat) for axis in self._axes), self.ENABLE_S, zeros)
        faults = self._faults()
        if not running:
            self.deactivate(now_ns)
            raise ControllerFault(
                self._line.device,
                self._line.port.name,
                "closed loop not reached: " + (", ".join(faults) or "no heartbeat confirms it"),
                "Calibrate the axis, read its errors over USB, then activate again",
            )
        self._active = True

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        left, right = self._left, self._right
        self._line.send(
            (
                codec.set_input_vel(left.node, speeds.left_radps * left.scale.units_per_rad),
                codec.set_input_vel(right.node, speeds.right_radps * right.scale.units_per_rad),
            )
        )

    def poll(self, now_ns: int) -> None:
        frames = []
        if now_ns - max(self._heard_ns, self._asked_ns) > self.POLL_AFTER_NS:
            self._asked_ns = now_ns
            frames += [codec.request(axis.node, codec.ENCODER_ESTIMATES) for axis in self._axes]
        if now_ns - self._bus_asked_ns > self.BUS_PERIOD_NS:
            self._bus_asked_ns = now_ns
            frames.append(codec.request(self._left.node, codec.GET_BUS))
        if frames:
            self._line.send(frames)

    def read(self, now_ns: int) -> WheelFeedback | None:
        self._line.drain()
        left, right = self._axes
        if not (left.fresh and right.fresh):
            return None
        left.fresh = right.fresh = False
        self._heard_ns = now_ns
        return WheelFeedback(
            robot=self.robot,
            stamp_ns=now_ns,
            left_radps=left.radps,
            right_radps=right.radps,
            left_rad=left.odometer.angle_rad,
            right_rad=right.odometer.angle_rad,
            bus_v=self._bus_v,
            enabled=self._active and _runs(left.heartbeat) and _runs(right.heartbeat),
            faults=self._faults(),
        )

    def stop(self, now_ns: int) -> None:
        self._line.send([codec.set_input_vel(axis.node, 0.0) for axis in self._axes])

    def deactivate(self, now_ns: int) -> None:
        self._active = False
        self._line.send(
            [codec.set_input_vel(axis.node, 0.0) for axis in self._axes]
            + [codec.set_axis_state(axis.node, codec.IDLE) for axis in self._axes]
        )

    def clear_errors(self, now_ns: int) -> None:
        self._line.send([codec.clear_errors(axis.node) for axis in self._axes])

    def close(self) -> None:
        self._active = False
        self._line.port.close()

    def fileno(self) -> int | None:
        return self._line.port.fileno()

    def _take(self, frame: CanFrame) -> str:
        """Handle one frame; the counter to raise if it was refused."""
        axis = self._by_node.get(frame.can_id >> 5)
        if axis is None or frame.extended:
            return "foreign_frame"
        if frame.remote:
            return "remote_frame"
        command = frame.can_id & 0x1F
        if command == codec.ENCODER_ESTIMATES:
            return self._take_estimates(axis, frame.data)
        if command == codec.HEARTBEAT:
            heartbeat = codec.decode_heartbeat(frame.data, self.options.dialect)
            if heartbeat is None:
                return "bad_heartbeat"
            axis.heartbeat = heartbeat
        elif command == codec.GET_BUS:
            bus = codec.decode_bus(frame.data)
            if bus is None or not 0.0 <= bus.volts <= 100.0:
                return "bad_bus"
            self._bus_v = bus.volts
        else:
            return "unused_frame"
        return ""

    def _take_estimates(self, axis: _Axis, data: bytes) -> str:
        estimates = codec.decode_estimates(data)
        if estimates is None:
            return "bad_estimates"
        radps = axis.scale.to_wheel(estimates.velocity_revps)
        if abs(radps) > 200.0:
            return "implausible_speed"
        axis.radps = radps
        axis.odometer.update(estimates.position_rev)
        axis.fresh = True
        return ""

    def _faults(self) -> tuple[str, ...]:
        """In words. Firmware 0.5 lets the watchdog expire while idle, too: no fault before activation."""
        names: list[str] = []
        for axis in self._axes:
            beat = axis.heartbeat
            if beat is None:
                continue
            flags = (beat.motor_fault, beat.encoder_fault, beat.controller_fault)
            error = beat.axis_error
            if not self._active:
                error &= ~codec.WATCHDOG_BIT[self.options.dialect]
            names += [f"{axis.name} {name}" for name in codec.error_names(error, self.options.dialect)]
            names += [
                f"{axis.name} {part} fault"
                for part, wrong in zip(("motor", "encoder", "controller"), flags, strict=True)
                if wrong
            ]
            if self._active and beat.state != codec.CLOSED_LOOP:
                names.append(f"{axis.name} left closed loop")
        return tuple(names)


def _runs(heartbeat: codec.Heartbeat | None) -> bool:
    return heartbeat is not None and heartbeat.state == codec.CLOSED_LOOP and not heartbeat.axis_error
