"""RoboClaw packet serial: pure encode, and a reader of replies that resynchronises.

Source: RoboClaw Series User Manual (Basicmicro, 101 pages): "Packet Serial" pp. 58-59 (addresses, gap,
acknowledgement, CRC), command tables pp. 66-67 (14, 15), 73 (90), 86-89 (encoders), 90-97 (speeds).
Not found there, hence as the maker's library has them: 200, and bit 0x4000 of 90. Which packets feed
the time-out it does not say.

Big-endian. A write is ``address command data crc16`` and is answered with ``FF``; a read is
``address command`` and is answered with ``data crc16`` whose CRC covers address, command and data.
CRC-16/XMODEM (poly 0x1021, init 0). A gap of more than 10 ms discards a packet.
"""

import re
import struct
from binascii import crc_hqx
from collections import Counter
from collections.abc import Callable, Sequence

from drivers.conversion import saturate

SET_TIMEOUT = 14
GET_TIMEOUT = 15
GET_VERSION = 21
GET_MAIN_BATTERY = 24
DUTY_BOTH = 34
SPEED_BOTH = 37
GET_ENCODERS = 78
GET_SPEEDS = 79
GET_STATUS = 90
RESET_ESTOP = 200

ACK = 0xFF
REPLY_BYTES = {GET_TIMEOUT: 1, GET_VERSION: 0, GET_MAIN_BATTERY: 2, GET_ENCODERS: 8, GET_SPEEDS: 8, GET_STATUS: 4}
"""Data bytes of each reply, CRC not counted; GET_VERSION, 0 here, ends with a zero byte, 48 at most."""
MAX_VERSION = 48

ERRORS = 0xFFFF
STATUS_NAMES = {
    0x1: "estop",
    0x2: "temperature 1",
    0x4: "temperature 2",
    0x8: "main battery high",
    0x10: "logic battery high",
    0x20: "logic battery low",
    0x40: "M1 driver fault",
    0x80: "M2 driver fault",
    0x100: "M1 speed error",
    0x200: "M2 speed error",
    0x400: "M1 position error",
    0x800: "M2 position error",
    0x1000: "M1 over current",
    0x2000: "M2 over current",
    0x4000: "main battery low",
}
"""Error bits of command 90 (32-bit form, firmware 4.2 and later); bits above 0xFFFF are warnings."""

MAX_QPPS = (1 << 31) - 1
_pack_speeds = struct.Struct(">BBii").pack
_pack_crc = struct.Struct(">H").pack
Decoder = Callable[[bytes], tuple[int, ...]]


def write_packet(address: int, command: int, data: bytes = b"") -> bytes:
    body = bytes((address, command)) + data
    return body + _pack_crc(crc_hqx(body, 0))


def read_packet(address: int, command: int) -> bytes:
    return bytes((address, command))


def speed_both(address: int, m1_qpps: int, m2_qpps: int) -> bytes:
    """Command 37: signed speeds in quadrature pulses per second."""
    body = _pack_speeds(address, SPEED_BOTH, m1_qpps, m2_qpps)
    return body + _pack_crc(crc_hqx(body, 0))


class SpeedWriter:
    """:func:`speed_both` in the order of the wheels; beyond 32 bits both shrink alike."""

    def __init__(self, address: int, swapped: bool) -> None:
        """:param swapped: the left wheel is on channel 2."""
        self._address = address
        self._swapped = swapped

    def packet(self, left_qpps: float, right_qpps: float) -> bytes:
        """Both wheels' speeds."""
        if self._swapped:
            left_qpps, right_qpps = right_qpps, left_qpps
        try:
            body = _pack_speeds(self._address, SPEED_BOTH, round(left_qpps), round(right_qpps))
        except struct.error:
            m1, m2 = saturate(left_qpps, right_qpps, MAX_QPPS)
            body = _pack_speeds(self._address, SPEED_BOTH, round(m1), round(m2))
        return body + _pack_crc(crc_hqx(body, 0))


def duty_both(address: int, m1: int, m2: int) -> bytes:
    """Command 34: signed duty of +-32767; zero releases the motors."""
    return write_packet(address, DUTY_BOTH, struct.pack(">hh", m1, m2))


def set_timeout(address: int, tenths: int) -> bytes:
    """Command 14: serial time-out in units of 100 ms, 0 = off."""
    return write_packet(address, SET_TIMEOUT, bytes((tenths,)))


decode_encoders: Decoder = struct.Struct(">II").unpack
"""Command 78: both 32-bit counters, which wrap."""
decode_speeds: Decoder = struct.Struct(">ii").unpack
"""Command 79: pulses per second, signed."""


def decode_battery(data: bytes) -> float:
    """Command 24: volts."""
    return int.from_bytes(data, "big") / 10.0


def decode_status(data: bytes) -> tuple[str, ...]:
    """Command 90: errors in words, warnings left off."""
    bits = int.from_bytes(data, "big") & ERRORS
    return tuple(STATUS_NAMES.get(1 << i, f"status 0x{1 << i:X}") for i in range(16) if bits >> i & 1)


def firmware(version: str) -> tuple[int, ...]:
    """``USB Roboclaw 2x7a v4.2.8`` as (4, 2, 8); empty if there is no number in it."""
    match = re.search(r"v(\d+)\.(\d+)\.(\d+)", version)
    return tuple(int(part) for part in match.groups()) if match else ()


Reply = tuple[int, bytes]
"""Command and answer; a write's is empty."""


class Replies:
    """Pairs the byte stream with the commands sent, in order.

    After a bad CRC, a byte where an acknowledgement should be, or ``REPLY_NS`` of silence, nothing
    is believed for ``QUIET_NS``: the line drains, then pairing starts afresh.
    """

    REPLY_NS = 50_000_000
    QUIET_NS = 20_000_000
    MAX_WAITING = 4
    """Outstanding replies after which no more reads are sent."""

    def __init__(self, address: int) -> None:
        self.counters: Counter[str] = Counter()
        self._forms = {
            command: (crc_hqx(bytes((address, command)), 0), length + 2 if length else 0)
            for command, length in REPLY_BYTES.items()
        }
        """CRC of what a reply's CRC covers besides its data, and bytes of data and CRC; 0 for a version."""
        self._pending: list[int] = []
        """Commands sent and not answered."""
        self._since_ns = 0
        """When the oldest of them became the one that is waited for."""
        self._buffer = b""
        self._quiet_until_ns = 0
        self._late_acks = 0

    def quiet(self, now_ns: int) -> bool:
        """Resynchronising: send no reads."""
        return now_ns < self._quiet_until_ns

    def ready(self, now_ns: int) -> bool:
        """Whether reads may be sent: the line is in step and not far behind."""
        return now_ns >= self._quiet_until_ns and len(self._pending) <= self.MAX_WAITING

    @property
    def waiting(self) -> int:
        """Replies outstanding."""
        return len(self._pending)

    def expect(self, now_ns: int, commands: Sequence[int]) -> None:
        """Packets were sent; commands without an entry in ``REPLY_BYTES`` are acknowledged writes."""
        if now_ns >= self._quiet_until_ns:
            if not self._pending:
                self._since_ns = now_ns
            self._pending.extend(commands)
            return
        writes = sum(command not in self._forms for command in commands)
        self._late_acks = min(self._late_acks + writes, 8)

    def feed(self, data: bytes, now_ns: int) -> list[Reply]:
        """Replies completed by ``data``."""
        if now_ns < self._quiet_until_ns:
            self.counters["discarded_bytes"] += len(data)
            return []
        buffer = self._buffer + data
        replies: list[Reply] = []
        pending, forms = self._pending, self._forms
        at, size = 0, len(buffer)
        for command in pending:
            form = forms.get(command)
            if form is not None:
                seed, length = form
                end = at + (length or _version_bytes(buffer, at) + 2)
                if size < end:
                    break
                answer = buffer[at:end]
                if crc_hqx(answer, seed):
                    if not self._late_acks or answer[0] != ACK:
                        self._resynchronise("bad_crc", now_ns)
                        return replies
                    del pending[: len(replies)]
                    self._late_acks -= 1
                    self.counters["late_ack"] += 1
                    self._buffer = buffer[at + 1 :]
                    return replies + self.feed(b"", now_ns)
                self._late_acks = 0
                at = end
                replies.append((command, answer[:-2]))
            elif at == size:
                break
            elif buffer[at] == ACK:
                at += 1
                replies.append((command, b""))
            else:
                self._resynchronise("bad_ack", now_ns)
                return replies
        self._buffer = buffer[at:]
        if replies:
            del pending[: len(replies)]
            self._since_ns = now_ns
        if not pending:
            if self._buffer:
                self.counters["stray_bytes"] += len(self._buffer)
                self._buffer = b""
        elif now_ns - self._since_ns > self.REPLY_NS:
            self._resynchronise("no_reply", now_ns)
        return replies

    def reset(self) -> None:
        """Forget what was sent: the port was reopened."""
        self._pending.clear()
        self._buffer = b""
        self._quiet_until_ns = 0
        self._late_acks = 0

    def _resynchronise(self, reason: str, now_ns: int) -> None:
        self.counters[reason] += 1
        self._pending.clear()
        self._buffer = b""
        self._late_acks = 0
        self._quiet_until_ns = now_ns + self.QUIET_NS


def _version_bytes(buffer: bytes, start: int) -> int:
    """Length of a version's text with the zero that ends it."""
    end = buffer.find(0, start, start + MAX_VERSION)
    return end + 1 - start if end >= 0 else MAX_VERSION
