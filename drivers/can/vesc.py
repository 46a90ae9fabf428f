"""Two VESCs on one CAN bus, speed control by electrical rpm.

There is no enable command: any setpoint drives, current zero releases. Below ``s_pid_min_erpm``
the controller applies no current, so a zero is sent as a brake current, which holds the wheel.
Status messages 1 and 5 are off by default and carry no fault code. The time-out is set in VESC
Tool; ``watchdog_s`` states it.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault, show
from drivers.base import STANDSTILL, Site, WheelSpeeds
from drivers.can import vesc_codec as codec
from drivers.can.frame import CanFrame
from drivers.can.line import CanLine
from drivers.conversion import Odometer, WheelScale
from drivers.options import WheelOptions
from drivers.ports import FramePort

Controller = Annotated[int, Meta(ge=0, le=codec.MAX_ID, description="VESC id, App Settings > General")]
Seconds = Annotated[
    float,
    Meta(
        ge=0.0,
        le=2.0,
        description="App Settings > General > Timeout, as set in VESC Tool (1 s by default: lower it); "
        "0 accepts that a hung computer leaves the wheels turning",
    ),
]
WATCHDOG_TEXT = (
    "set App Settings > General > Timeout in VESC Tool and write the same seconds here "
    "(0 accepts the risk of a robot without one)"
)


class Options(WheelOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "vesc", ... }``"""

    kind: Literal["vesc"]
    channel: Annotated[
        str, Meta(min_length=1, max_length=200, description="CAN interface (can0), or the adapter's tty for slcan")
    ]
    interface: Annotated[Literal["socketcan", "slcan"], Meta(description="python-can interface")] = "socketcan"
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000, description="bit/s; slcan only, else set it on the link")] = (
        500_000
    )
    left: Controller
    right: Controller
    pole_pairs: Annotated[int, Meta(ge=1, le=100, description="of the motor: electrical turns per shaft turn")]
    min_erpm: Annotated[
        float,
        Meta(ge=0.0, le=100_000.0, description="s_pid_min_erpm; slower commands get no current"),
    ] = 900.0
    brake_a: Annotated[float, Meta(gt=0.0, le=200.0, description="current that brakes and holds a zero")] = 5.0
    watchdog_s: Seconds | None = None


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


class _Motor:
    """What one wheel's controller last said."""

    def __init__(self, name: str, device: int, pole_pairs: int, gear_ratio: float, inverted: bool) -> None:
        self.name = name
        self.device = device
        self.erpm = WheelScale.of(60.0 * pole_pairs, gear_ratio, inverted)
        self.steps = WheelScale.of(float(codec.TACHO_STEPS_PER_ERPM_TURN * pole_pairs), gear_ratio, inverted)
        self.odometer = Odometer(self.steps, 32)
        self.radps: float | None = None
        self.moved = False


class Drive:
    """:class:`drivers.base.DiffDrive` for two VESCs."""

    IDENTIFY_S = 0.5

    def __init__(self, robot: str, options: Options, site: Site, port: FramePort) -> None:
        self.robot = robot
        self.options = options
        self._site = site
        self._line = CanLine(f"VESC of {robot}", port, self._take)
        gear, pairs = options.gear_ratio, options.pole_pairs
        self._motors = (
            _Motor("left", options.left, pairs, gear, options.left_inverted),
            _Motor("right", options.right, pairs, gear, options.right_inverted),
        )
        self._by_id = {motor.device: motor for motor in self._motors}
        self._bus_v: float | None = None
        self._active = False

    @property
    def counters(self) -> Mapping[str, int]:
        return self._line.total()

    def configure(self) -> None:
        declared, limit = self.options.watchdog_s, self._site.safety.watchdog_s
        if declared is None or declared > limit:
            raise self._line.refused(
                f"the time-out of {declared} s exceeds safety.watchdog_s = {limit:g} s", WATCHDOG_TEXT
            )
        self._line.open()
        for motor in self._motors:
            motor.radps, motor.moved = None, False
        self._line.wait_until(lambda: all(m.moved and m.radps is not None for m in self._motors), self.IDENTIFY_S)
        for motor in self._motors:
            missing = [n for n, seen in ((1, motor.radps is not None), (5, motor.moved)) if not seen]
            if missing:
                self.close()
                raise self._line.lost(
                    f"no status message {' and '.join(map(str, missing))} from {motor.name} (id {motor.device})",
                    "Check power, ids, bitrate and termination; enable CAN status messages 1 and 5 in VESC Tool",
                )

    def activate(self, now_ns: int) -> None:
        for motor in self._motors:
            motor.odometer = Odometer(motor.steps, 32)
        self._active = True
        self.write(STANDSTILL, now_ns)

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        if self._active:
            self._line.send([self._setpoint(*pair) for pair in zip(self._motors, speeds, strict=True)])
        else:
            self._line.send([codec.set_current(motor.device, 0.0) for motor in self._motors])

    def poll(self, now_ns: int) -> None:
        """Status messages are cyclic."""

    def read(self, now_ns: int) -> WheelFeedback | None:
        self._line.drain()
        left, right = self._motors
        if left.radps is None or right.radps is None:
            return None
        feedback = WheelFeedback(
            robot=self.robot,
            stamp_ns=now_ns,
            left_radps=left.radps,
            right_radps=right.radps,
            left_rad=left.odometer.angle_rad,
            right_rad=right.odometer.angle_rad,
            bus_v=self._bus_v,
            enabled=self._active,
        )
        left.radps = right.radps = None
        return feedback

    def stop(self, now_ns: int) -> None:
        self.write(STANDSTILL, now_ns)

    def deactivate(self, now_ns: int) -> None:
        self._active = False
        self.write(STANDSTILL, now_ns)

    def clear_errors(self, now_ns: int) -> None:
        """A VESC clears its faults by itself."""

    def close(self) -> None:
        self._active = False
        self._line.port.close()

    def fileno(self) -> int | None:
        return self._line.port.fileno()

    def _setpoint(self, motor: _Motor, radps: float) -> CanFrame:
        erpm = motor.erpm.to_device(radps)
        if abs(erpm) < max(self.options.min_erpm, 0.5):
            if radps != 0.0:
                self._line.counters["below_min_erpm"] += 1
            return codec.set_brake(motor.device, self.options.brake_a)
        return codec.set_rpm(motor.device, round(max(-2e9, min(2e9, erpm))))

    def _take(self, frame: CanFrame) -> str:
        """Handle one frame; the counter to raise if it was refused."""
        command, device = codec.split_id(frame.can_id)
        motor = self._by_id.get(device)
        if motor is None or not frame.extended:
            return "foreign_frame"
        if frame.remote:
            return "remote_frame"
        if command == codec.STATUS_1:
            status = codec.decode_status_1(frame.data)
            if status is None:
                return "bad_status"
            radps = motor.erpm.to_wheel(status.erpm)
            if abs(radps) > 200.0:
                return "implausible_speed"
            motor.radps = radps
        elif command == codec.STATUS_5:
            position = codec.decode_status_5(frame.data)
            if position is None or not 0.0 <= position.volts <= 100.0:
                return "bad_status"
            motor.odometer.update(position.tachometer)
            motor.moved = True
            self._bus_v = position.volts
        else:
            return "unused_frame"
        return ""
