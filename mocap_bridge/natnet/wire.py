"""The packet around every NatNet message, the one error of the decoders, and a bounded reader."""

import struct
from enum import IntEnum
from typing import NamedTuple


class MessageId(IntEnum):
    """First field of a packet."""

    CONNECT = 0
    SERVERINFO = 1
    REQUEST = 2
    RESPONSE = 3
    REQUEST_MODELDEF = 4
    MODELDEF = 5
    REQUEST_FRAME = 6
    FRAME = 7
    MESSAGESTRING = 8
    DISCONNECT = 9
    KEEPALIVE = 10
    DISCONNECT_BY_TIMEOUT = 11
    ECHO_REQUEST = 12
    ECHO_RESPONSE = 13
    DISCOVERY = 14
    UNRECOGNIZED = 100


HEADER = struct.Struct("<HH")
MAX_DATAGRAM_BYTES = 65535
MAX_NAME_BYTES = 256

_INT = struct.Struct("<i")


class Malformed(ValueError):
    """Bytes that are not the message they claim to be; ``where`` names the field."""

    def __init__(self, where: str, fault: str) -> None:
        super().__init__(f"{where}: {fault}")
        self.where = where


class Packet(NamedTuple):
    """A datagram with its header checked; ``end`` is the offset after the payload."""

    id: int
    data: bytes
    end: int


def packet(message: int, payload: bytes = b"") -> bytes:
    """One datagram.

    :raises Malformed: payload does not fit the 16-bit size.
    """
    if len(payload) > 0xFFFF:
        raise Malformed("packet", f"payload of {len(payload)} bytes, at most 65535 fit")
    return HEADER.pack(message, len(payload)) + payload


def open_packet(datagram: bytes) -> Packet:
    """Check the header against the datagram; bytes after the payload are ignored.

    :raises Malformed: shorter than its header or than the size in it.
    """
    if len(datagram) < 4:
        raise Malformed("header", f"{len(datagram)} bytes, at least 4 needed")
    message, size = HEADER.unpack_from(datagram)
    if len(datagram) < 4 + size:
        raise Malformed("header", f"announces {size} bytes of payload, {len(datagram) - 4} came")
    return Packet(message, datagram, 4 + size)


def open_request(datagram: bytes) -> Packet:
    """As a server opens it: some clients count the header into the size, so that bounds nothing.

    :raises Malformed: shorter than its header.
    """
    if len(datagram) < 4:
        raise Malformed("header", f"{len(datagram)} bytes, at least 4 needed")
    message, size = HEADER.unpack_from(datagram)
    return Packet(message, datagram, min(4 + size, len(datagram)))


def cstring(text: str) -> bytes:
    """A NUL-terminated UTF-8 string."""
    return text.encode("utf-8") + b"\0"


def fixed(text: str, size: int = MAX_NAME_BYTES) -> bytes:
    """A string in a field of ``size`` bytes, cut so that the terminating NUL fits."""
    return text.encode("utf-8")[: size - 1].ljust(size, b"\0")


class Reader:
    """Walks a payload; every read is checked against the end of it."""

    def __init__(self, data: bytes, offset: int, end: int) -> None:
        self.data = data
        self.offset = offset
        self.end = end

    def skip(self, size: int, where: str) -> None:
        """Move on by ``size`` bytes."""
        if size < 0 or self.offset + size > self.end:
            raise Malformed(where, f"{size} bytes at offset {self.offset}, {self.end - self.offset} left")
        self.offset += size

    def integer(self, where: str) -> int:
        """A signed 32-bit integer."""
        start = self.offset
        self.skip(4, where)
        value: int = _INT.unpack_from(self.data, start)[0]
        return value

    def count(self, where: str, item_bytes: int = 1) -> int:
        """A count of items that take at least ``item_bytes`` each."""
        value = self.integer(where)
        if value < 0 or value * item_bytes > self.end - self.offset:
            raise Malformed(where, f"{value} items do not fit the {self.end - self.offset} bytes left")
        return value

    def block(self, item_bytes: int, where: str) -> None:
        """Move on past a count and its items of ``item_bytes`` each."""
        self.skip(self.count(where, item_bytes) * item_bytes, where)

    def unpack(self, layout: struct.Struct, where: str) -> tuple[object, ...]:
        """Fields of a fixed layout."""
        start = self.offset
        self.skip(layout.size, where)
        return layout.unpack_from(self.data, start)

    def string_end(self, where: str) -> int:
        """Move on past a NUL-terminated string and return the offset of its NUL."""
        limit = min(self.end, self.offset + MAX_NAME_BYTES)
        stop = self.data.find(b"\0", self.offset, limit)
        if stop < 0:
            raise Malformed(where, f"no end of the text within {limit - self.offset} bytes")
        self.offset = stop + 1
        return stop

    def string(self, where: str) -> str:
        """A NUL-terminated string; bytes that are not UTF-8 become U+FFFD."""
        start = self.offset
        stop = self.string_end(where)
        return self.data[start:stop].decode("utf-8", "replace")
