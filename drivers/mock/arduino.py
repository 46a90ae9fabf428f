"""An emulated ros_arduino_bridge board (README "Firmware commands" of hbrobotics/ros_arduino_bridge)."""

import math
from collections import Counter

from contract.messages import MotorSample
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.motor import Shaft
from drivers.serial.arduino import Options

LINE_LIMIT = 48


class EmulatedArduino:
    """:class:`drivers.mock.controller.EmulatedController`."""

    def __init__(self, options: Options, wheels: Wheels) -> None:
        self.wheels = wheels
        self.counters: Counter[str] = Counter()
        self.hung = False
        self.log = SampleLog(wheels)
        self.auto_stop_ns = int((options.watchdog_s or 0.0) * 1e9)
        self._counts = options.counts_per_revolution
        self._frame_hz = options.pid_rate_hz
        self._shafts = (
            Shaft(wheels.left, options.gear_ratio, options.left_inverted),
            Shaft(wheels.right, options.gear_ratio, options.right_inverted),
        )
        self._offsets = [0, 0]
        self._line = bytearray()
        self._moved_ns: int | None = None
        self._now_ns: int | None = None

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.advance(now_ns)
        if self.hung:
            return b""
        output = b""
        for byte in data:
            if byte != 13:
                self._line.append(byte)
                if len(self._line) > LINE_LIMIT:
                    self.counters["garbage_line"] += 1
                    self._line.clear()
                continue
            words = bytes(self._line).split()
            self._line.clear()
            output += self._obey(words, now_ns)
        return output

    def advance(self, now_ns: int) -> bytes:
        if self._now_ns is None:
            self._now_ns = now_ns
        due_ns = self.next_due_ns()
        if due_ns is not None and due_ns <= now_ns:
            self._roll(due_ns)
            self._moved_ns = None
            for wheel in self.wheels:
                wheel.release()
            self.counters["watchdog_expired"] += 1
            self.log.both(due_ns, False, released=True)
        self._roll(now_ns)
        return b""

    def next_due_ns(self) -> int | None:
        if self.hung or self._moved_ns is None or not self.auto_stop_ns:
            return None
        return self._moved_ns + self.auto_stop_ns

    def take_samples(self) -> list[MotorSample]:
        return self.log.take()

    def brown_out(self, on: bool) -> None:
        """The board lives on USB; its motors are without power and it does not notice."""
        for wheel in self.wheels:
            wheel.supplied = not on

    def set_sensor_sign(self, sign: float) -> None:
        for shaft in self._shafts:
            shaft.sensor_sign = sign

    def _obey(self, words: list[bytes], now_ns: int) -> bytes:
        if not words:
            return b""
        if words[0] == b"e" and len(words) == 1:
            left, right = (self._count(side) for side in (0, 1))
            return b"%d %d\r\n" % (left, right)
        if words[0] == b"r" and len(words) == 1:
            self._offsets = [self._offsets[side] - self._count(side) for side in (0, 1)]
            return b"OK\r\n"
        if words[0] == b"b" and len(words) == 1:
            return b"57600\r\n"
        if words[0] == b"m" and len(words) == 3 and all(_is_number(word) for word in words[1:]):
            ticks = (int(words[1]), int(words[2]))
            for shaft, value in zip(self._shafts, ticks, strict=True):
                shaft.drive(value * self._frame_hz / self._counts)
            self._moved_ns = now_ns
            self.log.both(now_ns, True)
            return b"OK\r\n"
        self.counters["invalid_command"] += 1
        return b"Invalid Command\r\n"

    def _count(self, side: int) -> int:
        count = math.floor(self._shafts[side].turns * self._counts) + self._offsets[side]
        return (count + 2**31) % 2**32 - 2**31

    def _roll(self, now_ns: int) -> None:
        if self._now_ns is not None and now_ns > self._now_ns:
            self.wheels.advance((now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns


def _is_number(word: bytes) -> bool:
    digits = word.removeprefix(b"-")
    return 0 < len(digits) <= 5 and digits.isdigit()


def emulate(options: Options, wheels: Wheels) -> EmulatedArduino:
    """The board the options describe."""
    return EmulatedArduino(options, wheels)
