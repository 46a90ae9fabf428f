"""VESC packets on a UART: pure encode, and a reader that resynchronises.

Source: vedderb/bldc ``comm/packet.c`` (``02 length8 payload crc16 03``, ``03 length16 ...`` above 255;
CRC-16/XMODEM over the payload, big-endian), ``datatypes.h`` (command numbers), ``comm/commands.c``
(payloads; bits of the mask of COMM_GET_VALUES_SELECTIVE). The other VESC is reached through the first
by COMM_FORWARD_CAN.
"""

import struct
from binascii import crc_hqx
from collections import Counter

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

_pack_value = struct.Struct(">i").pack
_pack_tail = struct.Struct(">HB").pack
_VALUES = struct.Struct(">BIihiBB")


Values = tuple[int, float, int, int, int]
"""Electrical rpm, V, tachometer steps (6 an electrical turn), fault code, controller id."""


def packet(payload: bytes) -> bytes:
    """The shortest form that holds the payload."""
    length = len(payload)
    head = bytes((2, length)) if length < 256 else struct.pack(">BH", 3, length)
    return head + payload + _pack_tail(crc_hqx(payload, 0), 3)


class Command:
    """A command with one i32, for the VESC on the line or one behind it; what never changes is checksummed once."""

    def __init__(self, number: int, forward_to: int | None = None) -> None:
        constant = _forwarded(bytes((number,)), forward_to)
        self._head = bytes((2, len(constant) + 4)) + constant
        self._crc = crc_hqx(constant, 0)

    def packet(self, value: int) -> bytes:
        """:param value: electrical rpm for ``SET_RPM``, mA for ``SET_CURRENT`` and ``SET_BRAKE``."""
        body = _pack_value(value)
        return self._head + body + _pack_tail(crc_hqx(body, self._crc), 3)


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
    return erpm, decivolts / 10.0, tachometer, fault, device


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
        buffer = self._buffer + data
        payloads: list[bytes] = []
        at, size = 0, len(buffer)
        while at < size:
            head = buffer[at]
            if head not in (2, 3):
                self.counters["stray_bytes"] += 1
                at += 1
                continue
            body = at + head
            if size < body:
                break
            length = buffer[at + 1] if head == 2 else buffer[at + 1] << 8 | buffer[at + 2]
            if not 0 < length <= MAX_PAYLOAD or (head == 3 and length < 256):
                self.counters["bad_length"] += 1
                at += 1
                continue
            end = body + length
            if size < end + 3:
                break
            if crc_hqx(buffer[body : end + 2], 0) or buffer[end + 2] != 3:
                self.counters["bad_crc"] += 1
                at += 1
                continue
            at = end + 3
            payloads.append(buffer[body:end])
        self._buffer = buffer[at:]
        return payloads
