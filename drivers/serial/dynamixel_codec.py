"""Dynamixel Protocol 2.0: pure encode, and a packet reader.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0" (instruction and status packets, byte stuffing)
and "CRC for Protocol 2.0". ``FF FF FD 00 id length16 instruction parameters crc16``,
little-endian; length counts everything after itself; the CRC (poly 0x8005, start 0, not
reflected) covers the whole packet. Within instruction and parameters FF FF FD becomes FF FF FD FD.
"""

import functools
import struct
from collections import Counter
from collections.abc import Sequence

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
PING, READ, WRITE, REBOOT, STATUS = 0x01, 0x02, 0x03, 0x08, 0x55
SYNC_READ, SYNC_WRITE = 0x82, 0x83
MAX_LENGTH = 250
ALERT = 0x80
"""Bit of a status packet's error byte: look at the hardware error register."""
ERROR_NAMES = {1: "result fail", 2: "instruction", 3: "crc", 4: "data range", 5: "data length", 6: "limit", 7: "access"}


def _crc_tables() -> list[list[int]]:
    """CRC of each byte followed by 0 ... 7 zeros."""
    first = []
    for index in range(256):
        value = index << 8
        for _ in range(8):
            value = (value << 1) ^ (0x8005 if value & 0x8000 else 0)
        first.append(value & 0xFFFF)
    tables = [first]
    for _ in range(7):
        tables.append([(value << 8 & 0xFF00) ^ first[value >> 8] for value in tables[-1]])
    return tables


_T0, _T1, _T2, _T3, _T4, _T5, _T6, _T7 = _crc_tables()
_EIGHT = struct.Struct("8B")


def crc16(data: bytes, value: int = 0) -> int:
    """Eight bytes at a time.

    :param value: of the bytes before ``data``.
    """
    whole = len(data) & ~7
    for a, b, c, d, e, f, g, h in _EIGHT.iter_unpack(data[:whole]):
        value = _T7[a ^ value >> 8] ^ _T6[b ^ value & 0xFF] ^ _T5[c] ^ _T4[d] ^ _T3[e] ^ _T2[f] ^ _T1[g] ^ _T0[h]
    for byte in data[whole:]:
        value = (value << 8 & 0xFF00) ^ _T0[value >> 8 ^ byte]
    return value


_crc_of_head = functools.lru_cache(maxsize=64)(crc16)
"""What comes before the data is the same in every reply."""
HEAD_BYTES = 9


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
    """:func:`sync_write` of one i32 register of two devices; what never changes is checksummed once."""

    def __init__(self, address: int, left: int, right: int) -> None:
        self._address = address
        self._devices = (left, right)
        self._head = HEADER + struct.pack("<BHBHH", BROADCAST, 17, SYNC_WRITE, address, 4)
        self._crc = crc16(self._head)
        self._pack = struct.Struct("<BiBi").pack

    def packet(self, left: int, right: int) -> bytes:
        """Both values."""
        first, second = self._devices
        tail = self._pack(first, left, second, right)
        if b"\xff\xff\xfd" in tail:
            values = [(first, tail[1:5]), (second, tail[6:])]
            return sync_write(self._address, 4, values)
        return self._head + tail + crc16(tail, self._crc).to_bytes(2, "little")


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
        while at < size:
            if not buffer.startswith(HEADER, at):
                start = buffer.find(HEADER, at)
                if start < 0:
                    start = size - next((n for n in (3, 2, 1) if n <= size - at and HEADER[:n] == buffer[-n:]), 0)
                if start > at:
                    self.counters["stray_bytes"] += start - at
                    at = start
                    continue
                break
            if size < at + 7:
                break
            length = buffer[at + 5] | buffer[at + 6] << 8
            if not 4 <= length <= MAX_LENGTH:
                self.counters["bad_length"] += 1
                at += 4
                continue
            end = at + 7 + length
            if size < end:
                break
            body = buffer[at + HEAD_BYTES : end - 2]
            if crc16(body, _crc_of_head(buffer[at : at + HEAD_BYTES])) != buffer[end - 2] | buffer[end - 1] << 8:
                self.counters["bad_crc"] += 1
                at += 4
                continue
            if buffer[at + 7] == STATUS:
                body = body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
                packets.append((buffer[at + 4], buffer[at + 8], body))
            else:
                self.counters["not_status"] += 1
            at = end
        self._buffer = buffer[at:]
        return packets

    def reset(self) -> None:
        """Forget what has arrived: the port was reopened."""
        self._buffer = b""
