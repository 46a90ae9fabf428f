"""Dynamixel Protocol 2.0: pure encode, and a packet reader.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0" (instruction and status packets, byte stuffing)
and "CRC for Protocol 2.0". ``FF FF FD 00 id length16 instruction parameters crc16``,
little-endian; length counts everything after itself; the CRC (poly 0x8005, start 0, not
reflected) covers the whole packet. Within instruction and parameters FF FF FD becomes FF FF FD FD.
"""

import struct
from collections import Counter
from collections.abc import Sequence

from fastcrc.crc16 import umts as crc16

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
PING, READ, WRITE, REBOOT, STATUS = 0x01, 0x02, 0x03, 0x08, 0x55
SYNC_READ, SYNC_WRITE = 0x82, 0x83
MAX_LENGTH = 250
ALERT = 0x80
"""Bit of a status packet's error byte: look at the hardware error register."""
HEAD_BYTES = 9
"""Of a status packet: header, id, length, instruction, error byte."""
_head_at = struct.Struct("<4sBHBB").unpack_from
_pack_goals = struct.Struct("<BiBi").pack
_pack_crc = struct.Struct("<H").pack
_crc_at = struct.Struct("<H").unpack_from
_STUFFED = b"\xff\xff\xfd\xfd"
ERROR_NAMES = {1: "result fail", 2: "instruction", 3: "crc", 4: "data range", 5: "data length", 6: "limit", 7: "access"}


def packet(device: int, instruction: int, parameters: bytes = b"") -> bytes:
    """An instruction packet, stuffed."""
    body = (bytes((instruction,)) + parameters).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    whole = HEADER + bytes((device,)) + struct.pack("<H", len(body) + 2) + body
    return whole + struct.pack("<H", crc16(whole))


def read(device: int, address: int, length: int) -> bytes:
    return packet(device, READ, struct.pack("<HH", address, length))


def write(device: int, address: int, data: bytes) -> bytes:
    return packet(device, WRITE, struct.pack("<H", address) + data)


def sync_read(devices: Sequence[int], address: int, length: int) -> bytes:
    return packet(BROADCAST, SYNC_READ, struct.pack("<HH", address, length) + bytes(devices))


def sync_write(address: int, length: int, values: Sequence[tuple[int, bytes]]) -> bytes:
    """The same registers of several devices; not answered."""
    parameters = b"".join(bytes((device,)) + data for device, data in values)
    return packet(BROADCAST, SYNC_WRITE, struct.pack("<HH", address, length) + parameters)


class GoalWriter:
    """:func:`sync_write` of one i32 register of two devices; what never changes is packed once."""

    def __init__(self, address: int, left: int, right: int) -> None:
        self._address = address
        self._left, self._right = left, right
        self._head = HEADER + struct.pack("<BHBHH", BROADCAST, 17, SYNC_WRITE, address, 4)

    def packet(self, left: int, right: int) -> bytes:
        """Both values."""
        tail = _pack_goals(self._left, left, self._right, right)
        if b"\xff\xff\xfd" in tail:
            values = [(self._left, tail[1:5]), (self._right, tail[6:])]
            return sync_write(self._address, 4, values)
        whole = self._head + tail
        return whole + _pack_crc(crc16(whole))


Status = tuple[int, int, bytes]
"""A status packet: who, what went wrong, what was read."""


class PacketReader:
    """Status packets from the byte stream; it finds the next header after any damage.

    Stuffed and (as some peers send them) unstuffed packets are both read.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._buffer = b""

    def feed(self, data: bytes) -> list[Status]:
        buffer = self._buffer + data
        packets: list[Status] = []
        at, size = 0, len(buffer)
        while size - at >= HEAD_BYTES:
            header, device, length, instruction, error = _head_at(buffer, at)
            if header != HEADER:
                start = _next_header(buffer, at)
                self.counters["stray_bytes"] += start - at
                at = start
                continue
            if not 4 <= length <= MAX_LENGTH:
                self.counters["bad_length"] += 1
                at += 4
                continue
            end = at + 5 + length
            if size < end + 2:
                break
            if crc16(buffer[at:end]) != _crc_at(buffer, end)[0]:
                self.counters["bad_crc"] += 1
                at += 4
                continue
            if instruction == STATUS:
                body = buffer[at + HEAD_BYTES : end]
                if _STUFFED in body:
                    body = body.replace(_STUFFED, b"\xff\xff\xfd")
                packets.append((device, error, body))
            else:
                self.counters["not_status"] += 1
            at = end + 2
        self._buffer = buffer[at:]
        return packets

    def reset(self) -> None:
        """Forget what has arrived: the port was reopened."""
        self._buffer = b""


def _next_header(buffer: bytes, at: int) -> int:
    """Where behind ``at`` a header stands, or may begin with the last bytes."""
    start = buffer.find(HEADER, at)
    if start >= 0:
        return start
    return len(buffer) - next((n for n in (3, 2, 1) if buffer.endswith(HEADER[:n])), 0)
