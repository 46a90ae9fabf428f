"""CiA 402 drives: process data, statuswords, the way to operation enabled. Pure tables and bytes.

Sources: CiA 301 v4.2 section 7.2 (COB-IDs, NMT, SDO), CiA 402-2 "Power drive state machine"
(statusword masks, controlword commands), "Profile velocity mode" (60FFh, 606Ch). Little-endian.
Decoders never raise: None for a payload that is too short.
"""

import struct
from typing import NamedTuple

from drivers.can.frame import CanFrame

EMERGENCY = 0x080
TPDO_1 = 0x180
RPDO_1 = 0x200
TPDO_2 = 0x280
SDO_REPLY = 0x580
SDO_REQUEST = 0x600
HEARTBEAT = 0x700
MAX_NODE = 127
OPERATIONAL = 0x05
DRIVE_PROFILE = 402

STATES = (
    (0x4F, 0x00, "not ready"),
    (0x4F, 0x40, "switch-on disabled"),
    (0x6F, 0x21, "ready"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "operation enabled"),
    (0x6F, 0x07, "quick stop"),
    (0x4F, 0x0F, "fault reaction"),
    (0x4F, 0x08, "fault"),
)
"""Mask, value, name of every state the statusword (6041h) can show."""
ENABLED = "operation enabled"

DISABLE_VOLTAGE = 0x00
SHUTDOWN = 0x06
SWITCH_ON = 0x07
ENABLE = 0x0F
RESET = 0x80
TO_ENABLED = {
    "switch-on disabled": SHUTDOWN,
    "ready": SWITCH_ON,
    "switched on": ENABLE,
    "operation enabled": ENABLE,
    "quick stop": DISABLE_VOLTAGE,
}
"""Controlword (6040h) of the next step towards operation enabled; no step leads out of a fault."""

LIFE_GUARD = 0x8130
"""Emergency code of a heartbeat that stayed away."""
ERROR_CODES = {
    0x2310: "over-current",
    0x3210: "bus over-voltage",
    0x3220: "bus under-voltage",
    0x4210: "over-temperature",
    0x4310: "over-temperature",
    0x7305: "encoder fault",
    LIFE_GUARD: "watchdog expired",
    0x8400: "speed error",
    0x8611: "following error",
}


class Motion(NamedTuple):
    """TPDO 1: statusword and actual velocity in device units."""

    statusword: int
    velocity: int


class SdoValue(NamedTuple):
    """An expedited answer; ``item`` is the object's index."""

    item: int
    subindex: int
    value: int


def state_of(statusword: int) -> str:
    """Name of the state; the number of a statusword no state has."""
    for mask, value, name in STATES:
        if statusword & mask == value:
            return name
    return f"statusword 0x{statusword:04X}"


def error_name(code: int) -> str:
    return ERROR_CODES.get(code, f"error 0x{code:04X}")


def setpoint(node: int, controlword: int, velocity: int) -> CanFrame:
    """RPDO 1 as :func:`mapping` lays it out."""
    return CanFrame(RPDO_1 + node, struct.pack("<Hi", controlword, velocity))


def heartbeat(node: int) -> CanFrame:
    """This computer's, operational: what feeds the drives' consumers (1016h)."""
    return CanFrame(HEARTBEAT + node, bytes((OPERATIONAL,)))


def ask_bus_voltage(node: int) -> CanFrame:
    """SDO upload request of 6079h, answered with :func:`decode_sdo`; nobody waits."""
    return CanFrame(SDO_REQUEST + node, bytes.fromhex("4079600000000000"))


def decode_motion(data: bytes) -> Motion | None:
    return Motion(*struct.unpack_from("<Hi", data)) if len(data) >= 6 else None


def decode_position(data: bytes) -> int | None:
    """TPDO 2: actual position, 32 bits, wraps."""
    return int.from_bytes(data[:4], "little", signed=True) if len(data) >= 4 else None


def decode_emergency(data: bytes) -> int | None:
    """Error code; 0: the error is gone."""
    return int.from_bytes(data[:2], "little") if len(data) >= 3 else None


def decode_sdo(data: bytes) -> SdoValue | None:
    """An expedited upload answer; None for anything else (aborts included)."""
    if len(data) < 8 or data[0] & 0xE2 != 0x42:
        return None
    index, subindex = struct.unpack_from("<HB", data, 1)
    size = 4 - (data[0] >> 2 & 3) if data[0] & 1 else 4
    return SdoValue(index, subindex, int.from_bytes(data[4 : 4 + size], "little"))


class Write(NamedTuple):
    """One object to write by SDO; ``item`` is its index."""

    item: int
    subindex: int
    size: int
    value: int

    @property
    def data(self) -> bytes:
        return (self.value % (1 << 8 * self.size)).to_bytes(self.size, "little")


PDOS: tuple[tuple[int, int, tuple[int, ...]], ...] = (
    (0x1400, RPDO_1, (0x60400010, 0x60FF0020)),
    (0x1800, TPDO_1, (0x60410010, 0x606C0020)),
    (0x1801, TPDO_2, (0x60640020,)),
)
"""Communication object, COB-ID base, mapped objects (index, subindex, bits)."""


def mapping(node: int, period_ms: int) -> list[Write]:
    """Everything that lays out the three PDOs, in the order CiA 301 (7.5.2.36) demands.

    A PDO is switched off (bit 31) and its map emptied before either changes.

    :param period_ms: event timer of the transmit PDOs.
    """
    writes = []
    for record, base, objects in PDOS:
        maps, cob = record + 0x200, base + node
        writes += [Write(record, 1, 4, 0x80000000 | cob), Write(maps, 0, 1, 0)]
        writes += [Write(maps, place, 4, entry) for place, entry in enumerate(objects, 1)]
        writes += [Write(maps, 0, 1, len(objects)), Write(record, 2, 1, 0xFF)]
        if record >= 0x1800:
            writes.append(Write(record, 5, 2, period_ms))
        writes.append(Write(record, 1, 4, cob))
    return writes


def consumer_heartbeat(producer: int, timeout_ms: int) -> Write:
    """1016h sub 1: whose heartbeat the drive watches, and how long it may stay away."""
    return Write(0x1016, 1, 4, producer << 16 | timeout_ms)
