"""An emulated RoboClaw: packet serial from the device's end.

Written from the RoboClaw Series User Manual (pp. 58-59, 66-97), apart from the driver's codec. A packet
with a bad CRC is ignored; a gap above 10 ms inside a packet discards it; the serial time-out (command
14) releases the motors. That it is off by default and that any valid packet feeds it, reads included,
is the worse reading of a manual that does not say.
"""

import math
import struct
from collections import Counter
from collections.abc import Callable

from contract.messages import MotorSample
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.motor import Shaft
from drivers.serial.roboclaw import Options

GAP_NS = 10_000_000
FULL_DUTY = 32767

WRITES = {
    0: ">B",
    1: ">B",
    4: ">B",
    5: ">B",
    6: ">B",
    7: ">B",
    14: ">B",
    20: "",
    22: ">i",
    23: ">i",
    28: ">IIII",
    29: ">IIII",
    32: ">h",
    33: ">h",
    34: ">hh",
    35: ">i",
    36: ">i",
    37: ">ii",
    38: ">Ii",
    39: ">Ii",
    40: ">Iii",
    50: ">IiIi",
    52: ">hI",
    53: ">hI",
    54: ">hIhI",
    200: "",
}
"""Data of every command that is answered by FF."""
READS = {15, 16, 17, 18, 19, 21, 24, 25, 30, 31, 47, 48, 49, 55, 56, 78, 79, 82, 83, 90}
BOTH = {34, 37, 40, 50, 54}
FIRST = {0, 1, 6, 32, 35, 38, 52}
SECOND = {4, 5, 7, 33, 36, 39, 53}
"""Commands that drive both motors, the first, the second."""


def _crc_table() -> list[int]:
    table = []
    for index in range(256):
        value = index << 8
        for _ in range(8):
            value = ((value << 1) ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
        table.append(value)
    return table


_CRC_TABLE = _crc_table()


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x1021 and start value 0, byte by byte."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFFFF) ^ _CRC_TABLE[value >> 8 ^ byte]
    return value


class EmulatedRoboclaw:
    """:class:`drivers.mock.controller.EmulatedController`."""

    def __init__(self, options: Options, wheels: Wheels, start_counts: int = 0) -> None:
        self.wheels = wheels
        self.counters: Counter[str] = Counter()
        self.hung = False
        self.log = SampleLog(wheels)
        self.status = 0
        self.battery_v = 12.0
        self.version = "USB Roboclaw 2x7a v4.2.8\n"
        self.timeout_tenths = 0
        self._address = options.address
        self._counts = options.counts_per_revolution
        self._offsets = [start_counts, start_counts]
        left = Shaft(wheels.left, options.gear_ratio, options.left_inverted)
        right = Shaft(wheels.right, options.gear_ratio, options.right_inverted)
        self._shafts = (left, right) if options.left == 1 else (right, left)
        self._pid = [(0x10000, 0x8000, 0x4000, 44000), (0x10000, 0x8000, 0x4000, 44000)]
        self._buffer = b""
        self._byte_ns = 0
        self._fed_ns: int | None = None
        self._now_ns: int | None = None
        self._handlers: dict[int, Callable[..., None]] = {
            14: self._set_timeout,
            20: self._reset_encoders,
            22: lambda value: self._set_encoder(0, value),
            23: lambda value: self._set_encoder(1, value),
            28: lambda *values: self._set_pid(0, values),
            29: lambda *values: self._set_pid(1, values),
            32: lambda duty: self._duty(0, duty),
            33: lambda duty: self._duty(1, duty),
            34: self._duty_both,
            35: lambda speed: self._speed(0, speed),
            36: lambda speed: self._speed(1, speed),
            37: self._speed_both,
            38: lambda growth, speed: self._speed(0, speed, growth),
            39: lambda growth, speed: self._speed(1, speed, growth),
            40: lambda growth, m1, m2: self._speed_both(m1, m2, growth, growth),
            50: lambda growth_1, m1, growth_2, m2: self._speed_both(m1, m2, growth_1, growth_2),
            52: lambda duty, growth: self._duty(0, duty),
            53: lambda duty, growth: self._duty(1, duty),
            54: lambda m1, growth_1, m2, growth_2: self._duty_both(m1, m2),
            0: lambda value: self._duty(0, value * FULL_DUTY // 127),
            1: lambda value: self._duty(0, -value * FULL_DUTY // 127),
            4: lambda value: self._duty(1, value * FULL_DUTY // 127),
            5: lambda value: self._duty(1, -value * FULL_DUTY // 127),
            6: lambda value: self._duty(0, (value - 64) * FULL_DUTY // 64),
            7: lambda value: self._duty(1, (value - 64) * FULL_DUTY // 64),
            200: self._reset_estop,
        }

    @property
    def released(self) -> bool:
        """Neither motor is held."""
        return not (self.wheels.left.powered or self.wheels.right.powered)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        output = self.advance(now_ns)
        if self.hung:
            return output
        if self._buffer and now_ns - self._byte_ns > GAP_NS:
            self.counters["gap"] += 1
            self._buffer = b""
        self._byte_ns = now_ns
        self._buffer += data
        while True:
            answer = self._packet(now_ns)
            if answer is None:
                return output
            output += answer

    def advance(self, now_ns: int) -> bytes:
        if self._now_ns is None:
            self._now_ns = self._fed_ns = now_ns
        expiry_ns = self._expiry_ns()
        if not self.hung and expiry_ns is not None and expiry_ns <= now_ns:
            self._roll(expiry_ns)
            self._fed_ns = None
            if not self.released:
                for wheel in self.wheels:
                    wheel.release()
                self.counters["watchdog_expired"] += 1
                self.log.both(expiry_ns, False, released=True)
        self._roll(now_ns)
        return b""

    def next_due_ns(self) -> int | None:
        return None if self.hung else self._expiry_ns()

    def take_samples(self) -> list[MotorSample]:
        return self.log.take()

    def brown_out(self, on: bool) -> None:
        self.battery_v = 5.5 if on else 12.0
        self.status = self.status | 0x4000 if on else self.status & ~0x4000
        if on:
            for wheel in self.wheels:
                wheel.release()

    def set_sensor_sign(self, sign: float) -> None:
        for shaft in self._shafts:
            shaft.sensor_sign = sign

    def _expiry_ns(self) -> int | None:
        if self._fed_ns is None or not self.timeout_tenths:
            return None
        return self._fed_ns + self.timeout_tenths * 100_000_000

    def _roll(self, now_ns: int) -> None:
        if self._now_ns is not None and now_ns > self._now_ns:
            self.wheels.advance((now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns

    def _packet(self, now_ns: int) -> bytes | None:
        """Consume one packet; its answer, or None if the buffer holds no whole packet."""
        while self._buffer and self._buffer[0] != self._address:
            self.counters["foreign_byte"] += 1
            self._buffer = self._buffer[1:]
        if len(self._buffer) < 2:
            return None
        command = self._buffer[1]
        if command in READS:
            self._buffer = self._buffer[2:]
            self._fed_ns = now_ns
            data = self._answer(command)
            crc = crc16(bytes((self._address, command)) + data)
            return data + struct.pack(">H", crc)
        if command not in WRITES:
            self.counters["unknown_command"] += 1
            self._buffer = b""
            return None
        layout = WRITES[command]
        length = 2 + struct.calcsize(layout) + 2
        if len(self._buffer) < length:
            return None
        packet, self._buffer = self._buffer[:length], self._buffer[length:]
        if crc16(packet[:-2]) != struct.unpack(">H", packet[-2:])[0]:
            self.counters["bad_crc"] += 1
            return b""
        self._fed_ns = now_ns
        self._handlers[command](*struct.unpack(layout, packet[2:-2]))
        if command in BOTH:
            self.log.both(now_ns, not self.released)
        elif command in FIRST or command in SECOND:
            self.log.one("left" if command in FIRST else "right", now_ns, not self.released)
        return b"\xff"

    def _answer(self, command: int) -> bytes:
        if command == 15:
            return bytes((self.timeout_tenths,))
        if command in (16, 17):
            speed = self._qpps(command - 16)
            return struct.pack(">IB", self._encoder(command - 16), 2 if speed < 0 else 0)
        if command in (18, 19, 30, 31):
            speed = self._qpps(command % 2 if command in (30, 31) else command - 18)
            return struct.pack(">IB", abs(speed), 1 if speed < 0 else 0)
        if command == 21:
            return self.version.encode() + b"\0"
        if command == 24:
            return struct.pack(">H", round(self.battery_v * 10))
        if command == 25:
            return struct.pack(">H", 50)
        if command == 47:
            return b"\x80\x80"
        if command == 48:
            return struct.pack(">hh", *(round(self._share(shaft) * FULL_DUTY) for shaft in self._shafts))
        if command == 49:
            return struct.pack(">hh", 10, 10)
        if command in (55, 56):
            proportional, integral, derivative, qpps = self._pid[command - 55]
            return struct.pack(">IIII", proportional, integral, derivative, qpps)
        if command == 78:
            return struct.pack(">II", self._encoder(0), self._encoder(1))
        if command == 79:
            return struct.pack(">ii", self._qpps(0), self._qpps(1))
        if command in (82, 83):
            return struct.pack(">H", 305)
        return struct.pack(">I", self.status)

    def _encoder(self, channel: int) -> int:
        return (math.floor(self._shafts[channel].turns * self._counts) + self._offsets[channel]) % (1 << 32)

    def _qpps(self, channel: int) -> int:
        return round(self._shafts[channel].turns_per_s * self._counts)

    def _set_timeout(self, tenths: int) -> None:
        self.timeout_tenths = tenths

    def _reset_encoders(self) -> None:
        self._set_encoder(0, 0)
        self._set_encoder(1, 0)

    def _set_encoder(self, channel: int, value: int) -> None:
        self._offsets[channel] = value - math.floor(self._shafts[channel].turns * self._counts)

    def _set_pid(self, channel: int, values: tuple[int, int, int, int]) -> None:
        derivative, proportional, integral, qpps = values
        self._pid[channel] = (proportional, integral, derivative, qpps)

    def _speed(self, channel: int, qpps: int, qpps_per_s: int | None = None) -> None:
        """:param qpps_per_s: growth of the speed; None: as fast as the motor can."""
        shaft = self._shafts[channel]
        wheel = shaft.wheel
        wheel.acceleration_radps2 = wheel.limits.acceleration_radps2
        if qpps_per_s is not None:
            wheel.acceleration_radps2 = max(qpps_per_s / abs(self._counts * shaft.turns_per_rad), 1e-3)
        if self.status & 0x4001:
            wheel.release()
        else:
            self._shafts[channel].drive(qpps / self._counts)

    def _speed_both(self, m1: int, m2: int, growth_1: int | None = None, growth_2: int | None = None) -> None:
        self._speed(0, m1, growth_1)
        self._speed(1, m2, growth_2)

    def _share(self, shaft: Shaft) -> float:
        """Of full speed."""
        top = shaft.wheel.limits.max_radps * abs(shaft.turns_per_rad)
        return max(-1.0, min(1.0, shaft.turns_per_s / top))

    def _duty(self, channel: int, duty: int) -> None:
        wheel = self._shafts[channel].wheel
        if duty == 0 or self.status & 1:
            wheel.release()
        else:
            self._shafts[channel].drive(
                duty / FULL_DUTY * wheel.limits.max_radps * abs(self._shafts[channel].turns_per_rad)
            )

    def _duty_both(self, m1: int, m2: int) -> None:
        self._duty(0, m1)
        self._duty(1, m2)

    def _reset_estop(self) -> None:
        self.status &= ~1


def emulate(options: Options, wheels: Wheels, start_counts: int = 0) -> EmulatedRoboclaw:
    """The device the options describe."""
    return EmulatedRoboclaw(options, wheels, start_counts)
