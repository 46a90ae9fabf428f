"""Two Dynamixel servos in velocity mode (X series control table, ROBOTIS e-Manual).

The Bus Watchdog (register 98, 20 ms a count, off by default) is set and read back. Once tripped
its register reads -1 and goals are refused until 0 is written: ``activate`` does that. The Return
Delay (register 9, 0.5 ms by default before every reply) is set to 0. A goal beyond the Velocity
Limit (register 44) is refused without a word by a servo that goes on turning as it was told before,
so the limit must allow ``control.max_speed_mps``: XL330-M077 manages 0.8 m/s on 30 mm wheels; XC330
and XL430 do not.
"""

import math
import struct
from itertools import cycle
from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault
from drivers.base import STANDSTILL, Site, WheelSpeeds
from drivers.conversion import WheelScale
from drivers.family import WheelMotor, pair_faults
from drivers.ports import BytePort
from drivers.serial import dynamixel_codec as codec
from drivers.serial.family import Baud, SerialDrive, SerialOptions, open_port

__all__ = ["Drive", "Options", "check", "open_port"]

RETURN_DELAY, OPERATING_MODE, VELOCITY_LIMIT, TORQUE_ENABLE, HARDWARE_ERROR, BUS_WATCHDOG = 9, 11, 44, 64, 70, 98
GOAL_VELOCITY, PRESENT_VELOCITY, INPUT_VOLTAGE = 104, 128, 144
VELOCITY_MODE = 1
WATCHDOG_STEP_S = 0.02
COUNTS_PER_TURN = 4096
VELOCITY_UNIT_RPM = 0.229
HARDWARE_ERRORS = {0x1: "input voltage", 0x4: "overheating", 0x8: "encoder", 0x10: "electrical shock", 0x20: "overload"}
Servo = Annotated[int, Meta(ge=0, le=252, description="servo id")]


class Options(SerialOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "dynamixel", ... }``"""

    kind: Literal["dynamixel"]
    baud: Baud = 1_000_000
    left: Servo
    right: Servo


def check(options: Options, path: str) -> list[Fault]:
    """What no single key shows."""
    return pair_faults(options.left, options.right, path)


_motion = struct.Struct("<ii").unpack


class _Servo(WheelMotor):
    """One wheel's servo and what it last said."""

    def __init__(self, name: str, device: int, gear_ratio: float, inverted: bool) -> None:
        goal = WheelScale.of(60.0 / VELOCITY_UNIT_RPM, gear_ratio, inverted)
        super().__init__(name, device, goal, WheelScale.of(COUNTS_PER_TURN, gear_ratio, inverted), 32)
        self.alert = False
        self.hardware_error = 0


class Drive(SerialDrive[Options]):
    """:class:`drivers.base.DiffDrive` for two Dynamixel servos on one line."""

    CYCLE_BYTES = 24 + 16 + 2 * 19
    """Sync write of two goals, sync read of two present speeds and positions, two replies."""
    VOLTAGE_EVERY = 50
    """In polls."""

    def __init__(self, robot: str, options: Options, site: Site, port: BytePort) -> None:
        self._reader = codec.PacketReader()
        super().__init__("Dynamixel", robot, options, site, port, self._reader)
        self._servos = (
            _Servo("left", options.left, options.gear_ratio, options.left_inverted),
            _Servo("right", options.right, options.gear_ratio, options.right_inverted),
        )
        self._goals = codec.GoalWriter(GOAL_VELOCITY, options.left, options.right)
        self._left_units, self._right_units = (servo.speed.units_per_rad for servo in self._servos)
        self._by_id = {servo.device: servo for servo in self._servos}
        motion = codec.sync_read(tuple(self._by_id), PRESENT_VELOCITY, 8)
        voltage = codec.read(options.left, INPUT_VOLTAGE, 2)
        self._requests = cycle([motion + voltage, *[motion] * (self.VOLTAGE_EVERY - 1)])
        self._alert = False

    def configure(self) -> None:
        counts = int(self.site.safety.watchdog_s / WATCHDOG_STEP_S + 1e-9)
        self.open()
        self._reader.reset()
        try:
            for servo in self._servos:
                self._identify(servo, min(counts, 127))
        except Exception:
            self.close()
            raise

    def activate(self, now_ns: int) -> None:
        for servo in self._servos:
            servo.restart()
            watchdog = self._read(servo, BUS_WATCHDOG, 1)
            counts = min(int(self.site.safety.watchdog_s / WATCHDOG_STEP_S + 1e-9), 127)
            self._write(servo, BUS_WATCHDOG, b"\0")
            self._write(servo, GOAL_VELOCITY, bytes(4))
            self._write(servo, BUS_WATCHDOG, bytes((counts,)))
            self._write(servo, TORQUE_ENABLE, b"\1")
            hardware = self._read(servo, HARDWARE_ERROR, 1)
            if watchdog is None or hardware is None or self._read(servo, TORQUE_ENABLE, 1) != b"\1":
                self.deactivate(now_ns)
                names = _hardware_names(servo.name, hardware[0]) if hardware else ()
                raise self.line.faulty(
                    f"{servo.name} torque does not switch on: {', '.join(names) or 'no answer'}",
                    "Remove the cause, clear errors (reboots the servo), activate again",
                )
            servo.alert, servo.hardware_error = False, 0
        self.active = True

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        left, right = speeds if self.active else STANDSTILL
        self.line.send(self._goals.packet(round(left * self._left_units), round(right * self._right_units)))

    def poll(self, now_ns: int) -> None:
        request = next(self._requests)
        if self._alert:
            for servo in self._servos:
                if servo.alert and not servo.hardware_error:
                    request += codec.read(servo.device, HARDWARE_ERROR, 1)
                    break
        self.line.send(request)

    def read(self, now_ns: int) -> WheelFeedback | None:
        for device, error, data in self._reader.feed(self.line.receive()):
            self._take(device, error, data)
        left, right = self._servos
        self._alert = alert = left.alert or right.alert
        if left.radps is None or right.radps is None:
            return None
        sample = self.feedback(
            now_ns,
            (left.radps, left.angle_rad),
            (right.radps, right.angle_rad),
            enabled=not alert,
            faults=_faults(left) + _faults(right) if alert else (),
        )
        left.radps = right.radps = None
        return sample

    def deactivate(self, now_ns: int) -> None:
        self.active = False
        self.write(STANDSTILL, now_ns)
        off = [(servo.device, b"\0") for servo in self._servos]
        self.line.send(codec.sync_write(TORQUE_ENABLE, 1, off))

    def clear_errors(self, now_ns: int) -> None:
        """A latched hardware error clears only by a reboot of the servo."""
        for servo in self._servos:
            if servo.alert:
                self.line.send(codec.packet(servo.device, codec.REBOOT))
                servo.alert, servo.hardware_error = False, 0

    def _identify(self, servo: _Servo, counts: int) -> None:
        if self._read(servo, OPERATING_MODE, 1) is None:
            raise self.line.lost(
                f"no answer from the {servo.name} servo, id {servo.device}, at {self.options.baud} baud"
            )
        self._write(servo, TORQUE_ENABLE, b"\0")
        if self._read(servo, RETURN_DELAY, 1) != b"\0":
            self._write(servo, RETURN_DELAY, b"\0")
        self._write(servo, OPERATING_MODE, bytes((VELOCITY_MODE,)))
        if self._read(servo, OPERATING_MODE, 1) != bytes((VELOCITY_MODE,)):
            raise self.line.refused(f"the {servo.name} servo does not take velocity mode", "Use an X-series servo")
        self._check_speed(servo)
        self._write(servo, BUS_WATCHDOG, b"\0")
        self._write(servo, BUS_WATCHDOG, bytes((counts,)))
        seen = self._read(servo, BUS_WATCHDOG, 1)
        if seen != bytes((counts,)):
            raise self.line.refused(
                f"Bus Watchdog of the {servo.name} servo set to {counts} reads back {seen[0] if seen else 'nothing'}",
                "Check safety.watchdog_s and the firmware; without it a hung computer leaves the wheels turning",
            )

    def _check_speed(self, servo: _Servo) -> None:
        """No command that passes the gate, and then the robot's calibration, may exceed the servo's limit.

        :raises Refused: one could.
        """
        limit = int.from_bytes(self._read(servo, VELOCITY_LIMIT, 4) or b"", "little")
        options = self.options
        radps, wanted = limit / abs(servo.speed.units_per_rad), self.site.max_wheel_radps
        wanted *= max(1.0, options.wheel_separation_multiplier)
        wanted /= min(options.left_wheel_radius_multiplier, options.right_wheel_radius_multiplier)
        if radps < wanted:
            mps = math.floor(100.0 * self.site.max_speed_mps * radps / wanted) / 100.0
            raise self.line.refused(
                f"the {servo.name} servo turns its wheel at {radps:.1f} rad/s at most (Velocity Limit {limit}), "
                f"control.max_speed_mps = {self.site.max_speed_mps:g} needs {wanted:.1f}; it would ignore faster goals",
                f"Set control.max_speed_mps to {mps:.2f} or less, or fit a faster servo",
            )

    def _read(self, servo: _Servo, address: int, length: int) -> bytes | None:
        return self._ask(servo, codec.read(servo.device, address, length), length)

    def _write(self, servo: _Servo, address: int, data: bytes) -> None:
        self._ask(servo, codec.write(servo.device, address, data), 0)

    def _ask(self, servo: _Servo, request: bytes, length: int) -> bytes | None:
        answers: list[bytes] = []

        def parse(data: bytes) -> bool:
            for device, _, content in self._reader.feed(data):
                if device == servo.device and len(content) == length:
                    answers.append(content)
            return bool(answers)

        return answers[0] if self.line.answer(request, parse, 0.2) else None

    def _take(self, device: int, error: int, data: bytes) -> None:
        servo = self._by_id.get(device)
        if servo is None:
            self.line.counters["foreign_packet"] += 1
            return
        servo.alert = error >= codec.ALERT
        if error & 0x7F:
            name = codec.ERROR_NAMES.get(error & 0x7F, str(error & 0x7F))
            self.line.counters["refused_" + name.replace(" ", "_")] += 1
        elif len(data) == 8:
            refusal = servo.take_motion(*_motion(data))
            if refusal:
                self.line.counters[refusal] += 1
        elif len(data) == 2:
            self.bus_v = min(int.from_bytes(data, "little") * 0.1, 100.0)
        elif len(data) == 1:
            servo.hardware_error = data[0]


def _faults(servo: _Servo) -> tuple[str, ...]:
    if not servo.alert:
        return ()
    return _hardware_names(servo.name, servo.hardware_error) or (f"{servo.name} hardware alert",)


def _hardware_names(wheel: str, bits: int) -> tuple[str, ...]:
    return tuple(f"{wheel} {name}" for bit, name in HARDWARE_ERRORS.items() if bits & bit)
