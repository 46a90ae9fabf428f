"""Protocol 2.0 from the servo's end (ROBOTIS e-Manual), apart from the driver's codec."""

import struct
from binascii import unhexlify
from collections import Counter
from collections.abc import Iterator

MARK = unhexlify("fffffd00")
NEVER_STUFFED = b"\xff\xff\xfd"


def checksum(data: bytes) -> int:
    """CRC-16 with polynomial 0x8005, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1) ^ 0x8005 if value & 0x8000 else value << 1
            value &= 0xFFFF
    return value


def unstuffed(body: bytes) -> bytes:
    return body.replace(NEVER_STUFFED + b"\xfd", NEVER_STUFFED)


def status(device: int, error: int, data: bytes) -> bytes:
    """A status packet, stuffed."""
    body = (bytes((0x55, error)) + data).replace(NEVER_STUFFED, NEVER_STUFFED + b"\xfd")
    whole = MARK + bytes((device,)) + struct.pack("<H", len(body) + 2) + body
    return whole + struct.pack("<H", checksum(whole))


def sync_wishes(parameters: bytes) -> list[tuple[int, int, int]]:
    """Device, address, length of each part of a sync read."""
    if len(parameters) < 5:
        return []
    address, length = struct.unpack("<HH", parameters[:4])
    return [(device, address, length) for device in parameters[4:]]


def bulk_wishes(parameters: bytes) -> list[tuple[int, int, int]]:
    """The same of a bulk read."""
    return [struct.unpack_from("<BHH", parameters, start) for start in range(0, len(parameters) - 4, 5)]


class Cutter:
    """Cuts the byte stream into packets; what is damaged it counts."""

    def __init__(self, counters: Counter[str]) -> None:
        self._counters = counters
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Whole instruction packets, checksum included."""
        self._buffer += data
        while (whole := self._cut()) is not None:
            if whole:
                yield whole

    def _cut(self) -> bytes | None:
        """The next whole packet; empty for a damaged one, None if more bytes are needed."""
        start = self._buffer.find(MARK)
        if start != 0:
            skipped = start if start > 0 else max(0, len(self._buffer) - 3)
            if skipped:
                self._counters["garbage_byte"] += skipped
                del self._buffer[:skipped]
            if start < 0:
                return None
        if len(self._buffer) < 7:
            return None
        total = 7 + self._buffer[5] + 256 * self._buffer[6]
        if total < 10 or total > 300:
            self._counters["bad_length"] += 1
            del self._buffer[:4]
            return b""
        if len(self._buffer) < total:
            return None
        whole = bytes(self._buffer[:total])
        if checksum(whole[:-2]) != whole[-2] + 256 * whole[-1]:
            self._counters["bad_crc"] += 1
            del self._buffer[:4]
            return b""
        del self._buffer[:total]
        return whole
