"""An emulated RoboClaw: packet serial from the device's end.

Written from the RoboClaw Series User Manual (pp. 58-59, 66-97), apart from the driver's codec. A packet
with a bad CRC is ignored; a gap above 10 ms inside a packet discards it; the serial time-out (command
14) releases the motors. That it is off by default and that any valid packet feeds it, reads included,
is the worse reading of a manual that does not say.
"""

import struct
from collections import Counter
from collections.abc import Callable

from contract.messages import MotorSample
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.motor import Shaft
from drivers.mock.roboclaw_channel import FULL_DUTY, Channel
from drivers.mock.roboclaw_packets import BOTH, FIRST, READS, SECOND, WRITES, crc16
from drivers.mock.roboclaw_settings import READ_COMMANDS, WRITE_LAYOUTS, Settings
from drivers.serial.roboclaw import Options

GAP_NS = 10_000_000


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
        left = Shaft(wheels.left, options.gear_ratio, options.left_inverted)
        right = Shaft(wheels.right, options.gear_ratio, options.right_inverted)
        shafts = (left, right) if options.left == 1 else (right, left)
        self.channels = tuple(Channel(shaft, options.counts_per_revolution, start_counts) for shaft in shafts)
        self._mixed: dict[str, int] = {}
        """Forward and turning of the mixed commands, -127 to 127, as far as they were given."""
        self._settings = Settings()
        self._buffer = b""
        self._byte_ns = 0
        self._fed_ns: int | None = None
        self._now_ns: int | None = None
        self._handlers: dict[int, Callable[..., None]] = {
            14: self._set_timeout,
            20: self._reset_encoders,
            22: self.channels[0].set_encoder,
            23: self.channels[1].set_encoder,
            28: self.channels[0].set_gains,
            29: self.channels[1].set_gains,
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
            8: lambda value: self._mix("forward", value),
            9: lambda value: self._mix("forward", -value),
            10: lambda value: self._mix("turn", value),
            11: lambda value: self._mix("turn", -value),
            12: lambda value: self._mix("forward", 2 * value - 128),
            13: lambda value: self._mix("turn", 2 * value - 128),
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
        if not self._buffer:
            return output
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
        for channel in self.channels:
            channel.shaft.sensor_sign = sign

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
        values = struct.unpack(layout, packet[2:-2])
        if command in WRITE_LAYOUTS:
            self._settings.write(command, values)
        else:
            self._handlers[command](*values)
        if command in BOTH:
            self.log.both(now_ns, not self.released)
        elif command in FIRST or command in SECOND:
            self.log.one("left" if command in FIRST else "right", now_ns, not self.released)
        return b"\xff"

    def _answer(self, command: int) -> bytes:
        if command in READ_COMMANDS:
            return self._settings.read(command)
        if command == 15:
            return bytes((self.timeout_tenths,))
        first, second = self.channels
        if command in (16, 17):
            channel = self.channels[command - 16]
            return struct.pack(">IB", channel.encoder, 2 if channel.qpps < 0 else 0)
        if command in (18, 19, 30, 31):
            speed = self.channels[command % 2].qpps
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
            return struct.pack(">hh", first.pwm, second.pwm)
        if command == 49:
            return struct.pack(">hh", 10, 10)
        if command in (55, 56):
            return struct.pack(">IIII", *self.channels[command - 55].gains)
        if command == 78:
            return struct.pack(">II", first.encoder, second.encoder)
        if command in (79, 108):
            return struct.pack(">ii", first.qpps, second.qpps)
        if command in (111, 114):
            return bytes(8)
        if command in (82, 83):
            return struct.pack(">H", 305)
        return struct.pack(">I", self.status)

    def _set_timeout(self, tenths: int) -> None:
        self.timeout_tenths = tenths

    def _reset_encoders(self) -> None:
        for channel in self.channels:
            channel.set_encoder(0)

    def _speed(self, channel: int, qpps: int, qpps_per_s: int | None = None) -> None:
        if self.status & 0x4001:
            self.channels[channel].duty(0)
        else:
            self.channels[channel].speed(qpps, qpps_per_s)

    def _speed_both(self, m1: int, m2: int, growth_1: int | None = None, growth_2: int | None = None) -> None:
        self._speed(0, m1, growth_1)
        self._speed(1, m2, growth_2)

    def _duty(self, channel: int, duty: int) -> None:
        self.channels[channel].duty(0 if self.status & 1 else duty)

    def _duty_both(self, m1: int, m2: int) -> None:
        self._duty(0, m1)
        self._duty(1, m2)

    def _mix(self, part: str, value: int) -> None:
        """Manual p. 62: nothing moves before both parts have been given; right is a turn with M1 faster."""
        self._mixed[part] = max(-127, min(127, value))
        if len(self._mixed) == 2:
            forward, turn = self._mixed["forward"], self._mixed["turn"]
            for channel, share in enumerate((forward + turn, forward - turn)):
                self._duty(channel, max(-127, min(127, share)) * FULL_DUTY // 127)

    def _reset_estop(self) -> None:
        self.status &= ~1


def emulate(options: Options, wheels: Wheels, start_counts: int = 0) -> EmulatedRoboclaw:
    """The device the options describe."""
    return EmulatedRoboclaw(options, wheels, start_counts)
