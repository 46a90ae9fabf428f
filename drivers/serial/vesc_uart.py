"""Two VESCs behind one UART: one on the line, the other over the CAN bus between them.

As :mod:`drivers.can.vesc`: no enable command, a zero is a brake current, the time-out is set in VESC
Tool. Telemetry is asked for in every control step; it carries the fault code, which status messages
on the CAN bus do not.
"""

from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from drivers.base import STANDSTILL, Site, WheelSpeeds
from drivers.family import WheelMotor
from drivers.ports import BytePort
from drivers.serial import vesc_packet as codec
from drivers.serial.family import SerialDrive, SerialOptions, open_port
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

ANSWER_S = 0.3


class Options(SerialOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "vesc_uart", ... }``"""

    kind: Literal["vesc_uart"]
    left: Controller
    right: Controller
    local: Annotated[Literal["left", "right"], Meta(description="the wheel whose VESC is on the line")] = "left"
    pole_pairs: PolePairs
    min_erpm: MinErpm = 900.0
    brake_a: Amperes = 5.0
    watchdog_s: Seconds | None = None


class Drive(SerialDrive[Options]):
    """:class:`drivers.base.DiffDrive` for two VESCs on one line."""

    CYCLE_BYTES = (10 + 12) + (10 + 12) + 2 * 22
    """Two setpoints and two requests, one of each forwarded, and two replies."""

    def __init__(self, robot: str, options: Options, site: Site, port: BytePort) -> None:
        self._reader = codec.PacketReader()
        super().__init__("VESC", robot, options, site, port, self._reader)
        self._motors = (
            motor_of("left", options.left, options.pole_pairs, options.gear_ratio, options.left_inverted),
            motor_of("right", options.right, options.pole_pairs, options.gear_ratio, options.right_inverted),
        )
        self._left, self._right = [self._setpoint(motor) for motor in self._motors]
        self._release = b"".join(
            [codec.Command(codec.SET_CURRENT, self._via(motor)).packet(0) for motor in self._motors]
        )
        self._by_id = {motor.device: motor for motor in self._motors}
        self._codes = {motor.device: 0 for motor in self._motors}
        self._request = b"".join([codec.ask_values(self._via(motor)) for motor in self._motors])

    @property
    def dead_zone_radps(self) -> float:
        return dead_zone_radps(self._motors[0], self.options.min_erpm)

    def configure(self) -> None:
        self.accept_watchdog(self.options.watchdog_s, WATCHDOG_TEXT)
        self.open()
        self._reader.reset()
        for motor in self._motors:
            motor.forget()

        def heard(data: bytes) -> bool:
            self._take_all(data)
            return all(motor.moved for motor in self._motors)

        if not self.line.answer(self._request, heard, ANSWER_S):
            silent = [f"{motor.name} (id {motor.device})" for motor in self._motors if not motor.moved]
            self.close()
            raise self.line.lost(
                f"no values from {' and '.join(silent)} at {self.options.baud} baud",
                "Check power, baud, ids, which VESC is on the line (local), and the CAN cable between the two",
            )

    def activate(self, now_ns: int) -> None:
        for motor in self._motors:
            motor.restart()
        self.active = True
        self.write(STANDSTILL, now_ns)

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        if self.active:
            left_radps, right_radps = speeds
            self.line.send(self._left.of(left_radps) + self._right.of(right_radps))
        else:
            self.line.send(self._release)

    def poll(self, now_ns: int) -> None:
        self.line.send(self._request)

    def read(self, now_ns: int) -> WheelFeedback | None:
        self._take_all(self.line.receive())
        left, right = self._motors
        if left.radps is None or right.radps is None:
            return None
        faulty = any(self._codes.values())
        sample = self.feedback(
            now_ns,
            (left.radps, left.angle_rad),
            (right.radps, right.angle_rad),
            enabled=not faulty,
            faults=self._faults() if faulty else (),
        )
        left.radps = right.radps = None
        return sample

    def _setpoint(self, motor: WheelMotor) -> Setpoint[bytes]:
        via = self._via(motor)
        brake = codec.Command(codec.SET_BRAKE, via).packet(round(self.options.brake_a * 1000.0))
        speed = codec.Command(codec.SET_RPM, via).packet
        return Setpoint(motor, self.options.min_erpm, speed, brake, self.line.counters)

    def _via(self, motor: WheelMotor) -> int | None:
        return None if motor.name == self.options.local else motor.device

    def _faults(self) -> tuple[str, ...]:
        return tuple(
            f"{motor.name} {codec.FAULTS.get(code, f'fault {code}')}"
            for motor in self._motors
            if (code := self._codes[motor.device])
        )

    def _take_all(self, data: bytes) -> None:
        for payload in self._reader.feed(data):
            reason = self._take(payload)
            if reason:
                self.line.counters[reason] += 1

    def _take(self, payload: bytes) -> str:
        """Believe one reply; the counter to raise if it was refused."""
        values = codec.decode_values(payload)
        if values is None:
            return "unused_packet"
        erpm, volts, tachometer, fault, device = values
        motor = self._by_id.get(device)
        if motor is None:
            return "foreign_packet"
        if not 0.0 <= volts <= 100.0:
            return "bad_values"
        refusal = motor.take_motion(erpm, tachometer)
        if not refusal:
            self.bus_v = volts
            self._codes[device] = fault
        return refusal
