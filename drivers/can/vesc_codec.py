"""VESC CAN frames: pure encode and decode.

29-bit identifier = command << 8 | controller id, big-endian payload. Source: vedderb/bldc,
``documentation/comm_can.md`` ("Simple CAN commands", "CAN status messages").
Decoders never raise: None for a payload that is too short.
"""

import struct
from typing import NamedTuple

from drivers.can.frame import CanFrame

SET_CURRENT = 1
SET_CURRENT_BRAKE = 2
SET_RPM = 3
STATUS_1 = 9
STATUS_5 = 27
TACHO_STEPS_PER_ERPM_TURN = 6
MAX_ID = 254


class Status1(NamedTuple):
    """Speed in electrical rpm, current in A, duty cycle."""

    erpm: int
    amperes: float
    duty: float


class Status5(NamedTuple):
    """Tachometer (6 steps an electrical turn, wraps at 32 bits) and input voltage."""

    tachometer: int
    volts: float


def split_id(can_id: int) -> tuple[int, int]:
    """Command and controller id."""
    return can_id >> 8, can_id & 0xFF


def _command(device: int, command: int, value: int) -> CanFrame:
    return CanFrame(command << 8 | device, struct.pack(">i", value), extended=True)


def set_rpm(device: int, erpm: int) -> CanFrame:
    """Closed-loop speed. Below the controller's ``s_pid_min_erpm`` it applies no current at all."""
    return _command(device, SET_RPM, erpm)


def set_current(device: int, amperes: float) -> CanFrame:
    """Zero lets the motor coast."""
    return _command(device, SET_CURRENT, round(amperes * 1000.0))


def set_brake(device: int, amperes: float) -> CanFrame:
    """Brake towards standstill with this current."""
    return _command(device, SET_CURRENT_BRAKE, round(amperes * 1000.0))


def decode_status_1(data: bytes) -> Status1 | None:
    if len(data) < 8:
        return None
    erpm, current, duty = struct.unpack_from(">ihh", data)
    return Status1(erpm, current / 10.0, duty / 1000.0)


def decode_status_5(data: bytes) -> Status5 | None:
    if len(data) < 6:
        return None
    tachometer, volts = struct.unpack_from(">ih", data)
    return Status5(tachometer, volts / 10.0)
