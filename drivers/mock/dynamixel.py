"""Two emulated Dynamixel X-series servos on one line (ROBOTIS e-Manual, Protocol 2.0 and XL330 control table)."""

import math
import struct
from binascii import unhexlify
from collections import Counter

from contract.messages import MotorSample
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.motor import Shaft
from drivers.serial.dynamixel import Options

MARK = unhexlify("fffffd00")
RPM_PER_UNIT = 0.229
NEVER_STUFFED = b"\xff\xff\xfd"
CLEAR_TURNS = b"\x01DXL\x22"


def checksum(data: bytes) -> int:
    """CRC-16 with polynomial 0x8005, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1) ^ 0x8005 if value & 0x8000 else value << 1
            value &= 0xFFFF
    return value


class Servo:
    """One servo's control table and motor."""

    def __init__(self, name: str, device: int, shaft: Shaft, model: int = 1190) -> None:
        self.name = name
        self.device = device
        self.shaft = shaft
        self.table = bytearray(256)
        self.table[0:2] = struct.pack("<H", model)
        self.table[6] = 45
        self.table[7] = device
        self.table[9] = 250
        self.table[11] = 3
        self.table[68] = 2
        self.fed_ns = 0
        self.tripped = False
        self.registered: tuple[int, bytes] | None = None
        """Of REG WRITE, until ACTION."""
        self.cleared_turns = 0
        self.decivolts = 50

    @property
    def expiry_ns(self) -> int | None:
        counts = self.table[98]
        return None if self.tripped or not counts or not self.table[64] else self.fed_ns + counts * 20_000_000

    def refresh(self) -> None:
        """Bring the read-only registers up to date."""
        speed = round(self.shaft.turns_per_s * 60.0 / RPM_PER_UNIT)
        counts = math.floor((self.shaft.turns - self.cleared_turns) * 4096)
        position = (counts + 2**31) % 2**32 - 2**31
        self.table[128:136] = struct.pack("<ii", speed, position)
        self.table[144:146] = struct.pack("<H", self.decivolts)
        self.table[146] = 30
        if self.tripped:
            self.table[98] = 0xFF

    def write(self, address: int, data: bytes) -> int:
        """The error number of the status packet, 0 for accepted."""
        if address + len(data) > 146 or 70 <= address < 72 or address >= 120:
            return 7
        if address < 64 and self.table[64]:
            return 7
        if address == 98 and len(data) == 1:
            if data[0] > 127:
                return 4
            self.tripped = False
        elif self.tripped and 100 <= address < 120:
            return 4
        self.table[address : address + len(data)] = data
        self._act(address)
        return 0

    def _act(self, address: int) -> None:
        if not self.table[64]:
            self.shaft.wheel.release()
        elif self.table[11] == 1 and (address in (64, 104)):
            goal = struct.unpack("<i", self.table[104:108])[0]
            self.shaft.drive(goal * RPM_PER_UNIT / 60.0)


class EmulatedDynamixel:
    """:class:`drivers.mock.controller.EmulatedController`."""

    def __init__(self, options: Options, wheels: Wheels) -> None:
        self.wheels = wheels
        self.counters: Counter[str] = Counter()
        self.hung = False
        self.log = SampleLog(wheels)
        gear = options.gear_ratio
        self.servos = (
            Servo("left", options.left, Shaft(wheels.left, gear, options.left_inverted)),
            Servo("right", options.right, Shaft(wheels.right, gear, options.right_inverted)),
        )
        self._buffer = bytearray()
        self._now_ns: int | None = None

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.advance(now_ns)
        if self.hung:
            return b""
        self._buffer += data
        output = b""
        while (whole := self._cut()) is not None:
            if whole:
                output += self._obey(whole, now_ns)
        return output

    def advance(self, now_ns: int) -> bytes:
        if self._now_ns is None:
            self._now_ns = now_ns
        released_ns = None
        for servo in self.servos:
            due_ns = servo.expiry_ns
            if not self.hung and due_ns is not None and due_ns <= now_ns:
                self._roll(due_ns)
                servo.tripped = True
                servo.shaft.wheel.release()
                self.counters["watchdog_expired"] += 1
                released_ns = due_ns
        if released_ns is not None:
            self.log.both(released_ns, False, released=True)
        self._roll(now_ns)
        return b""

    def next_due_ns(self) -> int | None:
        times = [servo.expiry_ns for servo in self.servos if servo.expiry_ns is not None and not self.hung]
        return min(times, default=None)

    def take_samples(self) -> list[MotorSample]:
        return self.log.take()

    def brown_out(self, on: bool) -> None:
        """Hardware error "input voltage", latched until a reboot; torque goes off."""
        for servo in self.servos:
            servo.decivolts = 30 if on else 50
            if on:
                servo.table[70], servo.table[64] = 0x01, 0
                servo.shaft.wheel.release()

    def set_sensor_sign(self, sign: float) -> None:
        for servo in self.servos:
            servo.shaft.sensor_sign = sign

    def _cut(self) -> bytes | None:
        """The next whole packet; empty for a damaged one, None if more bytes are needed."""
        start = self._buffer.find(MARK)
        if start != 0:
            skipped = start if start > 0 else max(0, len(self._buffer) - 3)
            if skipped:
                self.counters["garbage_byte"] += skipped
                del self._buffer[:skipped]
            if start < 0:
                return None
        if len(self._buffer) < 7:
            return None
        total = 7 + self._buffer[5] + 256 * self._buffer[6]
        if total < 10 or total > 300:
            self.counters["bad_length"] += 1
            del self._buffer[:4]
            return b""
        if len(self._buffer) < total:
            return None
        whole = bytes(self._buffer[:total])
        if checksum(whole[:-2]) != whole[-2] + 256 * whole[-1]:
            self.counters["bad_crc"] += 1
            del self._buffer[:4]
            return b""
        del self._buffer[:total]
        return whole

    def _obey(self, whole: bytes, now_ns: int) -> bytes:
        device, instruction = whole[4], whole[7]
        parameters = whole[8:-2].replace(NEVER_STUFFED + b"\xfd", NEVER_STUFFED)
        for servo in self.servos:
            servo.fed_ns = now_ns
            servo.refresh()
        addressed = [servo for servo in self.servos if device in (servo.device, 0xFE)]
        if instruction == 0x83:
            self._sync_write(parameters, now_ns)
            return b""
        if instruction in (0x82, 0x8A):
            return self._read_many(_sync_wishes(parameters), fast=instruction == 0x8A)
        if instruction in (0x92, 0x9A):
            return self._read_many(_bulk_wishes(parameters), fast=instruction == 0x9A)
        if instruction == 0x93:
            self._bulk_write(parameters, now_ns)
            return b""
        output = b""
        for servo in addressed:
            output += self._single(servo, instruction, parameters, now_ns, answer=device != 0xFE or instruction == 1)
        if not addressed:
            self.counters["foreign_packet"] += 1
        return output

    def _single(self, servo: Servo, instruction: int, parameters: bytes, now_ns: int, answer: bool) -> bytes:
        error, data = 0, b""
        if instruction == 1:
            data = bytes(servo.table[0:2]) + bytes(servo.table[6:7])
        elif instruction == 2 and len(parameters) == 4:
            address, length = struct.unpack("<HH", parameters)
            error, data = (0, bytes(servo.table[address : address + length])) if address + length <= 256 else (4, b"")
        elif instruction == 3 and len(parameters) > 2:
            error = self._write(servo, parameters[0] + 256 * parameters[1], parameters[2:], now_ns)
        elif instruction == 4 and len(parameters) > 2:
            servo.registered = parameters[0] + 256 * parameters[1], parameters[2:]
            servo.table[69] = 1
        elif instruction == 5:
            if servo.registered is not None:
                error = self._write(servo, *servo.registered, now_ns)
            servo.registered, servo.table[69] = None, 0
        elif instruction == 16 and parameters == CLEAR_TURNS:
            servo.cleared_turns = math.floor(servo.shaft.turns)
        elif instruction == 8:
            servo.table[70] = servo.table[64] = 0
            servo.shaft.wheel.release()
        else:
            self.counters["unknown_instruction"] += 1
            error = 2
        return self._status(servo, error, data) if answer else b""

    def _write(self, servo: Servo, address: int, data: bytes, now_ns: int) -> int:
        error = servo.write(address, data)
        if address == 104 and not error:
            self.log.one(servo.name, now_ns, bool(servo.table[64]))
        return error

    def _read_many(self, wishes: list[tuple[int, int, int]], fast: bool) -> bytes:
        """One status packet a servo, or (fast) one of all: each adds error, id, data and the checksum so far."""
        if not wishes:
            self.counters["short_packet"] += 1
            return b""
        known = {servo.device: servo for servo in self.servos}
        found = [(known[device], bytes(known[device].table[a : a + n])) for device, a, n in wishes if device in known]
        if not fast:
            return b"".join(self._status(servo, 0, data) for servo, data in found)
        if len(found) < len(wishes):
            return b""
        length = 1 + sum(len(data) + 4 for _, data in found)
        whole = MARK + b"\xfe" + struct.pack("<H", length) + b"\x55"
        for servo, data in found:
            whole += bytes((0x80 if servo.table[70] else 0, servo.device)) + data
            whole += struct.pack("<H", checksum(whole))
        return whole

    def _bulk_write(self, parameters: bytes, now_ns: int) -> None:
        """Each device its own registers: like a sync write of one device after the other."""
        start = 0
        while start + 5 <= len(parameters):
            device, address, length = struct.unpack_from("<BHH", parameters, start)
            data = parameters[start + 5 : start + 5 + length]
            self._sync_write(struct.pack("<HH", address, length) + bytes((device,)) + data, now_ns)
            start += 5 + length

    def _sync_write(self, parameters: bytes, now_ns: int) -> None:
        if len(parameters) < 4:
            self.counters["short_packet"] += 1
            return
        address, length = struct.unpack("<HH", parameters[:4])
        known = {servo.device: servo for servo in self.servos}
        told: list[Servo] = []
        for start in range(4, len(parameters) - length, length + 1):
            servo = known.get(parameters[start])
            if servo is None:
                self.counters["foreign_packet"] += 1
            elif servo.write(address, parameters[start + 1 : start + 1 + length]):
                self.counters["refused_write"] += 1
            elif address == 104:
                told.append(servo)
        if len(told) == 2:
            self.log.both(now_ns, all(servo.table[64] for servo in told))
        else:
            for servo in told:
                self.log.one(servo.name, now_ns, bool(servo.table[64]))

    def _status(self, servo: Servo, error: int, data: bytes) -> bytes:
        alert = 0x80 if servo.table[70] else 0
        body = (bytes((0x55, error | alert)) + data).replace(NEVER_STUFFED, NEVER_STUFFED + b"\xfd")
        whole = MARK + bytes((servo.device,)) + struct.pack("<H", len(body) + 2) + body
        return whole + struct.pack("<H", checksum(whole))

    def _roll(self, now_ns: int) -> None:
        if self._now_ns is not None and now_ns > self._now_ns:
            self.wheels.advance((now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns


def _sync_wishes(parameters: bytes) -> list[tuple[int, int, int]]:
    """Device, address, length of each part of a sync read."""
    if len(parameters) < 5:
        return []
    address, length = struct.unpack("<HH", parameters[:4])
    return [(device, address, length) for device in parameters[4:]]


def _bulk_wishes(parameters: bytes) -> list[tuple[int, int, int]]:
    """The same of a bulk read."""
    return [struct.unpack_from("<BHH", parameters, start) for start in range(0, len(parameters) - 4, 5)]


def emulate(options: Options, wheels: Wheels) -> EmulatedDynamixel:
    """The servos the options describe."""
    return EmulatedDynamixel(options, wheels)
