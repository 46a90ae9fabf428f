"""Two VESCs on one CAN bus, speed control by electrical rpm.

There is no enable command: any setpoint drives, current zero releases. Below ``s_pid_min_erpm``
the controller applies no current, so a zero is sent as a brake current, which holds the wheel.
Status messages 1 and 5 are off by default and carry no fault code. The time-out is set in VESC
Tool; ``watchdog_s`` states it.
"""

from collections.abc import Sequence
from functools import partial
from typing import Literal

from drivers.base import STANDSTILL, Site, WheelSpeeds
from drivers.can import vesc_codec as codec
from drivers.can.family import CanDrive, CanOptions, open_port
from drivers.can.frame import CanFrame
from drivers.family import WheelMotor
from drivers.ports import FramePort
from drivers.vesc_motor import (
    WATCHDOG_TEXT,
    Amperes,
    Controller,
    MinErpm,
    PolePairs,
    Seconds,
    Setpoint,
    check,
    dead_zone_radps,
    motor_of,
)

__all__ = ["Drive", "Options", "check", "open_port"]


class Options(CanOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "vesc", ... }``"""

    kind: Literal["vesc"]
    left: Controller
    right: Controller
    pole_pairs: PolePairs
    min_erpm: MinErpm = 900.0
    brake_a: Amperes = 5.0
    watchdog_s: Seconds | None = None


class Drive(CanDrive[Options, WheelMotor]):
    """:class:`drivers.base.DiffDrive` for two VESCs."""

    IDENTIFY_S = 0.5
    EXTENDED = True
    POSITION_EACH_SAMPLE = False

    def __init__(self, robot: str, options: Options, site: Site, port: FramePort) -> None:
        gear, pairs = options.gear_ratio, options.pole_pairs
        left = motor_of("left", options.left, pairs, gear, options.left_inverted)
        right = motor_of("right", options.right, pairs, gear, options.right_inverted)
        super().__init__("VESC", robot, options, site, port, left, right)
        self._left, self._right = [self._setpoint(motor) for motor in self.motors]

    @property
    def dead_zone_radps(self) -> float:
        return dead_zone_radps(self.motors[0], self.options.min_erpm)

    def cycle(self) -> Sequence[CanFrame]:
        return [
            frame
            for motor in self.motors
            for frame in (
                codec.set_rpm(motor.device, 0),
                CanFrame(codec.STATUS_1 << 8 | motor.device, bytes(8), True),
                CanFrame(codec.STATUS_5 << 8 | motor.device, bytes(8), True),
            )
        ]

    def configure(self) -> None:
        self.accept_watchdog(self.options.watchdog_s, WATCHDOG_TEXT)
        self.open()
        self.line.wait_until(lambda: all(m.moved and m.radps is not None for m in self.motors), self.IDENTIFY_S)
        for motor in self.motors:
            missing = [n for n, seen in ((1, motor.radps is not None), (5, motor.moved)) if not seen]
            if missing:
                self.close()
                raise self.line.lost(
                    f"no status message {' and '.join(map(str, missing))} from {motor.name} (id {motor.device})",
                    "Check power, ids, bitrate and termination; enable CAN status messages 1 and 5 in VESC Tool",
                )

    def activate(self, now_ns: int) -> None:
        for motor in self.motors:
            motor.restart()
        self.active = True
        self.write(STANDSTILL, now_ns)

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        if self.active:
            left_radps, right_radps = speeds
            self.line.send((self._left.of(left_radps), self._right.of(right_radps)))
        else:
            self.line.send([codec.set_current(motor.device, 0.0) for motor in self.motors])

    def sender(self, can_id: int) -> int:
        return codec.split_id(can_id)[1]

    def take(self, motor: WheelMotor, frame: CanFrame) -> str:
        command = frame.can_id >> 8
        if command == codec.STATUS_1:
            status = codec.decode_status_1(frame.data)
            return "bad_status" if status is None else motor.take_speed(status.erpm)
        if command != codec.STATUS_5:
            return "unused_frame"
        position = codec.decode_status_5(frame.data)
        if position is None or not 0.0 <= position.volts <= 100.0:
            return "bad_status"
        motor.take_position(position.tachometer)
        self.bus_v = position.volts
        return ""

    def _setpoint(self, motor: WheelMotor) -> Setpoint[CanFrame]:
        brake = codec.set_brake(motor.device, self.options.brake_a)
        speed = partial(codec.set_rpm, motor.device)
        return Setpoint(motor, self.options.min_erpm, speed, brake, self.line.counters)
