"""VESC packets on a UART: pure encode, and a reader that resynchronises.

Source: vedderb/bldc ``comm/packet.c`` (``02 length8 payload crc16 03``, ``03 length16 ...`` above 255;
CRC-16/XMODEM over the payload, big-endian), ``datatypes.h`` (command numbers), ``comm/commands.c``
(payloads; bits of the mask of COMM_GET_VALUES_SELECTIVE). The other VESC is reached through the first
by COMM_FORWARD_CAN.
"""

import struct
from binascii import crc_hqx
from collections import Counter
from typing import NamedTuple

SET_CURRENT, SET_BRAKE, SET_RPM = 6, 7, 8
FORWARD_CAN = 34
GET_VALUES_SELECTIVE = 50
RPM_BIT, VOLTS_BIT, TACHOMETER_BIT, FAULT_BIT, ID_BIT = 7, 8, 13, 15, 17
MASK = 1 << RPM_BIT | 1 << VOLTS_BIT | 1 << TACHOMETER_BIT | 1 << FAULT_BIT | 1 << ID_BIT
MAX_PAYLOAD = 512
FAULTS = {
    1: "over-voltage",
    2: "under-voltage",
    3: "gate driver",
    4: "over-current",
    5: "over-temperature of the controller",
    6: "over-temperature of the motor",
}
"""``mc_fault_code`` of ``datatypes.h``."""

_VALUES = struct.Struct(">BIihiBB")


class Values(NamedTuple):
    """Electrical rpm, V, tachometer steps (6 an electrical turn), fault code, controller id."""

    erpm: int
    volts: float
    tachometer: int
    fault: int
    device: int


def packet(payload: bytes) -> bytes:
    """The shortest form that holds the payload."""
    length = len(payload)
    head = bytes((2, length)) if length < 256 else struct.pack(">BH", 3, length)
    return head + payload + struct.pack(">HB", crc_hqx(payload, 0), 3)


def command(number: int, value: int, forward_to: int | None = None) -> bytes:
    """A command with one i32, for the VESC on the line or one behind it.

    :param value: electrical rpm for ``SET_RPM``, mA for ``SET_CURRENT`` and ``SET_BRAKE``.
    """
    return packet(_forwarded(struct.pack(">Bi", number, value), forward_to))


def ask_values(forward_to: int | None = None) -> bytes:
    """Request of :class:`Values`."""
    return packet(_forwarded(struct.pack(">BI", GET_VALUES_SELECTIVE, MASK), forward_to))


def decode_values(payload: bytes) -> Values | None:
    """None for anything but an answer to :func:`ask_values`."""
    if len(payload) != _VALUES.size:
        return None
    number, mask, erpm, decivolts, tachometer, fault, device = _VALUES.unpack(payload)
    if number != GET_VALUES_SELECTIVE or mask != MASK:
        return None
    return Values(erpm, decivolts / 10.0, tachometer, fault, device)


def _forwarded(payload: bytes, device: int | None) -> bytes:
    return payload if device is None else bytes((FORWARD_CAN, device)) + payload


class PacketReader:
    """Payloads from the byte stream; damage is counted by name and skipped."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._buffer = b""

    def reset(self) -> None:
        """Forget what has arrived: the port was reopened."""
        self._buffer = b""

    def feed(self, data: bytes) -> list[bytes]:
        self._buffer += data
        payloads: list[bytes] = []
        while self._buffer:
            start = self._buffer[0]
            if start not in (2, 3):
                self._skip("stray_bytes")
                continue
            head = start
            if len(self._buffer) < head:
                break
            length = int.from_bytes(self._buffer[1:head], "big")
            if not 0 < length <= MAX_PAYLOAD or (start == 3 and length < 256):
                self._skip("bad_length")
                continue
            if len(self._buffer) < head + length + 3:
                break
            payload, tail = self._buffer[head : head + length], self._buffer[head + length : head + length + 3]
            if tail != struct.pack(">HB", crc_hqx(payload, 0), 3):
                self._skip("bad_crc")
                continue
            self._buffer = self._buffer[head + length + 3 :]
            payloads.append(payload)
        return payloads

    def _skip(self, counter: str) -> None:
        self.counters[counter] += 1
        self._buffer = self._buffer[1:]
