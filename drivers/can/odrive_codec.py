"""ODrive CANSimple frames, firmware 0.5 and 0.6: pure encode and decode.

11-bit identifier = node << 5 | command, payload little-endian. Sources: ODrive 0.5.6 manual,
"CAN Protocol" (table of messages), and ODrive 0.6 documentation, "CAN Protocol", same table.
Every frame sent is padded to 8 bytes, since strict DBC decoders ignore shorter ones. 0x15, 0x1C
and 0x1D differ between the firmwares and are not used.

Decoders never raise: they return None for a payload that is too short or not finite.
"""

import math
import struct
from typing import Literal, NamedTuple

from drivers.can.frame import CanFrame

Dialect = Literal["0.5", "0.6"]

GET_VERSION = 0x00
"""0.6 only: protocol, hardware and firmware version."""
HEARTBEAT = 0x01
ESTOP = 0x02
GET_ERROR = 0x03
SET_AXIS_STATE = 0x07
ENCODER_ESTIMATES = 0x09
SET_CONTROLLER_MODE = 0x0B
SET_INPUT_VEL = 0x0D
SET_LIMITS = 0x0F
GET_IQ = 0x14
GET_BUS = 0x17
CLEAR_ERRORS = 0x18

IDLE = 1
CLOSED_LOOP = 8
VELOCITY_CONTROL = 2
INPUT_PASSTHROUGH = 1

MAX_NODE = 0x3F
WATCHDOG_BIT: dict[Dialect, int] = {"0.5": 0x800, "0.6": 0x01000000}

ERROR_NAMES: dict[Dialect, dict[int, str]] = {
    "0.5": {
        0x1: "invalid state",
        0x40: "motor failed",
        0x100: "encoder failed",
        0x200: "controller failed",
        0x800: "watchdog expired",
        0x4000: "estop requested",
        0x40000: "over temperature",
    },
    "0.6": {
        0x1: "initializing",
        0x2: "system level",
        0x8: "missing estimate",
        0x10: "bad config",
        0x20: "driver fault",
        0x40: "missing input",
        0x100: "bus over voltage",
        0x200: "bus under voltage",
        0x400: "bus over current",
        0x1000: "current limit",
        0x2000: "motor over temperature",
        0x4000: "inverter over temperature",
        0x8000: "velocity limit",
        0x01000000: "watchdog expired",
        0x02000000: "estop requested",
        0x04000000: "spinout",
    },
}
"""Bits of axis_error (0.5: ``Axis.Error``) and active_errors (0.6: ``ODrive.Error``)."""

_TWO_FLOATS = struct.Struct("<ff")
_TWO_WORDS = struct.Struct("<II")


class Heartbeat(NamedTuple):
    """Sent by each axis every 100 ms unless configured otherwise."""

    axis_error: int
    state: int
    motor_fault: bool = False
    encoder_fault: bool = False
    controller_fault: bool = False
    trajectory_done: bool = False
    procedure_result: int | None = None
    """0.6 only: 0 success, 1 busy."""


class Estimates(NamedTuple):
    """Motor shaft: position in turns, velocity in turns/s."""

    position_rev: float
    velocity_revps: float


class Bus(NamedTuple):
    volts: float
    amperes: float


def frame_id(node: int, command: int) -> int:
    return node << 5 | command


def split_id(can_id: int) -> tuple[int, int]:
    """Node and command."""
    return can_id >> 5, can_id & 0x1F


def set_axis_state(node: int, state: int) -> CanFrame:
    return CanFrame(frame_id(node, SET_AXIS_STATE), _TWO_WORDS.pack(state, 0))


def set_controller_mode(node: int, control: int = VELOCITY_CONTROL, source: int = INPUT_PASSTHROUGH) -> CanFrame:
    return CanFrame(frame_id(node, SET_CONTROLLER_MODE), _TWO_WORDS.pack(control, source))


def set_input_vel(node: int, revps: float, torque_nm: float = 0.0) -> CanFrame:
    """Velocity setpoint in motor turns per second with a feed-forward torque."""
    return CanFrame(node << 5 | SET_INPUT_VEL, _TWO_FLOATS.pack(revps, torque_nm))


def clear_errors(node: int) -> CanFrame:
    """In 0.6 byte 0 would make the device blink (identify)."""
    return CanFrame(frame_id(node, CLEAR_ERRORS), bytes(8))


def estop(node: int) -> CanFrame:
    return CanFrame(frame_id(node, ESTOP), bytes(8))


def request(node: int, command: int) -> CanFrame:
    """Remote frame: the device answers with a data frame of the same identifier."""
    return CanFrame(frame_id(node, command), remote=True, dlc=8)


def decode_heartbeat(data: bytes, dialect: Dialect) -> Heartbeat | None:
    if len(data) < 5:
        return None
    error, state = int.from_bytes(data[:4], "little"), data[4]
    flags = data[5:8].ljust(3, b"\0")
    if dialect == "0.6":
        return Heartbeat(error, state, trajectory_done=bool(flags[1] & 1), procedure_result=flags[0])
    return Heartbeat(error, state, bool(flags[0] & 1), bool(flags[1] & 1), bool(flags[2] & 1), bool(flags[2] & 0x80))


def decode_estimates(data: bytes) -> Estimates | None:
    pair = _two_floats(data)
    return None if pair is None else Estimates(*pair)


def decode_bus(data: bytes) -> Bus | None:
    pair = _two_floats(data)
    return None if pair is None else Bus(*pair)


def error_names(bits: int, dialect: Dialect) -> tuple[str, ...]:
    """The set bits in words; an unknown bit by its number."""
    names = ERROR_NAMES[dialect]
    return tuple(names.get(1 << i, f"error 0x{1 << i:X}") for i in range(bits.bit_length()) if bits >> i & 1)


def _two_floats(data: bytes) -> tuple[float, float] | None:
    if len(data) < 8:
        return None
    first, second = _TWO_FLOATS.unpack_from(data)
    return (first, second) if math.isfinite(first) and math.isfinite(second) else None
