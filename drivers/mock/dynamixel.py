"""Two emulated Dynamixel X-series servos on one line (ROBOTIS e-Manual, Protocol 2.0 and XL330 control table)."""

import math
import struct
from collections import Counter

from contract.messages import MotorSample
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.dynamixel_packets import MARK, Cutter, bulk_wishes, checksum, status, sync_wishes, unstuffed
from drivers.mock.dynamixel_servo import Servo
from drivers.mock.motor import Shaft
from drivers.serial.dynamixel import Options

CLEAR_TURNS = b"\x01DXL\x22"
BACKUPS = (b"\x01CTRL", b"\x02CTRL")
"""Of the control table: store, restore."""
RESETS = {b"\xff": (), b"\x01": (7,), b"\x02": (7, 8)}
"""Factory reset: of everything, of all but the id, of all but id and baud rate."""


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
        self._cutter = Cutter(self.counters)
        self._now_ns: int | None = None

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.advance(now_ns)
        if self.hung:
            return b""
        return b"".join(self._obey(whole, now_ns) for whole in self._cutter.feed(data))

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

    def _obey(self, whole: bytes, now_ns: int) -> bytes:
        device, instruction = whole[4], whole[7]
        parameters = unstuffed(whole[8:-2])
        for servo in self.servos:
            servo.fed_ns = now_ns
            servo.refresh()
        addressed = [servo for servo in self.servos if device in (servo.device, 0xFE)]
        if instruction == 0x83:
            self._sync_write(parameters, now_ns)
            return b""
        if instruction in (0x82, 0x8A):
            return self._read_many(sync_wishes(parameters), fast=instruction == 0x8A)
        if instruction in (0x92, 0x9A):
            return self._read_many(bulk_wishes(parameters), fast=instruction == 0x9A)
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
        elif instruction == 6 and parameters in RESETS:
            servo.reset(RESETS[parameters])
        elif instruction == 32 and parameters in BACKUPS:
            error = servo.back_up(restore=parameters == BACKUPS[1])
        elif instruction == 8:
            servo.table[70] = servo.table[64] = 0
            servo.shaft.wheel.release()
        else:
            self.counters["unknown_instruction"] += 1
            error = 2
        return status(servo.device, error | servo.alert, data) if answer else b""

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
            return b"".join(status(servo.device, servo.alert, data) for servo, data in found)
        if len(found) < len(wishes):
            return b""
        length = 1 + sum(len(data) + 4 for _, data in found)
        whole = MARK + b"\xfe" + struct.pack("<H", length) + b"\x55"
        for servo, data in found:
            whole += bytes((servo.alert, servo.device)) + data
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

    def _roll(self, now_ns: int) -> None:
        if self._now_ns is not None and now_ns > self._now_ns:
            self.wheels.advance((now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns


def emulate(options: Options, wheels: Wheels) -> EmulatedDynamixel:
    """The servos the options describe."""
    return EmulatedDynamixel(options, wheels)
