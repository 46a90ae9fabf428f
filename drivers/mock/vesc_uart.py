"""Two emulated VESCs behind one UART, apart from the driver's codec (vedderb/bldc ``packet.c``, ``commands.c``)."""

import math
from collections import Counter

from contract.messages import MotorSample
from drivers.can.frame import CanFrame
from drivers.mock.controller import Wheels
from drivers.mock.vesc import Controller, EmulatedVescs, VescSettings
from drivers.serial.vesc_uart import Options

ON_CAN = {5: 0, 6: 1, 7: 2, 8: 3}
"""Setpoint commands of the UART by their number on the CAN bus: duty, current, brake, rpm."""
SIZES = (2, 2, 4, 4, 4, 4, 2, 4, 2, 4, 4, 4, 4, 4, 4, 1, 4, 1, 6, 4, 4, 1)
"""Bytes of each field of COMM_GET_VALUES, in the order of the mask's bits."""
VERSION = bytes((0, 5, 2)) + b"410\0" + bytes(range(12)) + bytes(3)
"""Reply to COMM_FW_VERSION: major, minor, hardware, unique id, pairing, test version, hardware type."""


def checksum(payload: bytes) -> int:
    """CRC-16 with polynomial 0x1021, bit by bit."""
    value = 0
    for byte in payload:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value


class EmulatedVescUart:
    """:class:`drivers.mock.controller.EmulatedController`: a pair as on the CAN bus, status messages off."""

    def __init__(self, options: Options, wheels: Wheels, settings: VescSettings) -> None:
        self.pair = EmulatedVescs(options, wheels, settings)
        self.wheels = wheels
        self.fault_code = 0
        self._local = options.left if options.local == "left" else options.right
        self._buffer = bytearray()
        self._refused: Counter[str] = Counter()

    @property
    def counters(self) -> Counter[str]:
        return self.pair.counters + self._refused

    @property
    def hung(self) -> bool:
        return self.pair.hung

    @hung.setter
    def hung(self, value: bool) -> None:
        self.pair.hung = value

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.advance(now_ns)
        if self.hung:
            return b""
        self._buffer += data
        output = b""
        while (payload := self._cut()) is not None:
            if payload:
                output += self._obey(self._local, payload, now_ns)
        return output

    def advance(self, now_ns: int) -> bytes:
        self.pair.advance(now_ns)
        return b""

    def next_due_ns(self) -> int | None:
        return self.pair.next_due_ns()

    def take_samples(self) -> list[MotorSample]:
        return self.pair.log.take()

    def set_sensor_sign(self, sign: float) -> None:
        self.pair.set_sensor_sign(sign)

    def brown_out(self, on: bool) -> None:
        """FAULT_CODE_UNDER_VOLTAGE, in every reply."""
        self.pair.brown_out(on)
        self.fault_code = 2 if on else 0

    def _cut(self) -> bytes | None:
        """The next payload; empty for a damaged byte, None if more bytes are needed."""
        if not self._buffer:
            return None
        head = {2: 2, 3: 3}.get(self._buffer[0])
        if head is None:
            return self._refuse("garbage_byte")
        if len(self._buffer) < head:
            return None
        length = sum(byte << 8 * place for place, byte in enumerate(reversed(self._buffer[1:head])))
        if not 1 <= length <= 512:
            return self._refuse("bad_length")
        if len(self._buffer) < head + length + 3:
            return None
        payload = bytes(self._buffer[head : head + length])
        high, low, stop = self._buffer[head + length : head + length + 3]
        if stop != 3 or high * 256 + low != checksum(payload):
            return self._refuse("bad_crc")
        del self._buffer[: head + length + 3]
        return payload

    def _refuse(self, counter: str) -> bytes:
        self._refused[counter] += 1
        del self._buffer[0]
        return b""

    def _obey(self, device: int, payload: bytes, now_ns: int) -> bytes:
        number, rest = payload[0], payload[1:]
        if number == 34 and len(rest) > 1:
            return self._obey(rest[0], rest[1:], now_ns)
        controller = next((entry for entry in self.pair.controllers if entry.device == device), None)
        if controller is None:
            self._refused["foreign_packet"] += 1
        elif number in ON_CAN and len(rest) == 4:
            self.pair.take_frame(CanFrame(ON_CAN[number] * 256 + device, rest, True), now_ns)
        elif number == 0:
            return self._framed(VERSION)
        elif number == 30:
            controller.fed_ns = now_ns
        elif number == 4:
            return self._framed(bytes((4,)) + self._values(controller, (1 << 22) - 1))
        elif number == 50 and len(rest) == 4:
            return self._framed(payload[:5] + self._values(controller, int.from_bytes(rest, "big")))
        else:
            self._refused["unknown_command"] += 1
        return b""

    def _values(self, controller: Controller, mask: int) -> bytes:
        shaft = controller.shaft
        known = {
            7: round(shaft.turns_per_s * 60.0 * controller.pole_pairs),
            8: round(self.pair.settings.volts * 10),
            13: math.floor(shaft.turns * 6.0 * controller.pole_pairs),
            15: self.fault_code,
            17: controller.device,
        }
        return b"".join(
            (known.get(bit, 0) % 256**size).to_bytes(size, "big") for bit, size in enumerate(SIZES) if mask >> bit & 1
        )

    def _framed(self, payload: bytes) -> bytes:
        return bytes((2, len(payload))) + payload + checksum(payload).to_bytes(2, "big") + b"\x03"


def emulate(options: Options, wheels: Wheels) -> EmulatedVescUart:
    """The controllers the options describe, the time-out as declared."""
    timeout_ns = int((options.watchdog_s or 0.0) * 1e9)
    return EmulatedVescUart(options, wheels, VescSettings(0, timeout_ns, options.min_erpm))
