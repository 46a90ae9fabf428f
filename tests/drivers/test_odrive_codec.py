"""Golden bytes: ODrive manual, "CAN Protocol" (0.5.6 table of messages; 0.6 reference, same names)."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can import odrive_codec as codec
from drivers.can.frame import CanFrame

NODE = st.integers(0, codec.MAX_NODE)
FLOAT32 = st.floats(width=32, allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize(
    ("frame", "can_id", "data"),
    [
        (codec.set_input_vel(0, 1.0), 0x00D, "0000803f00000000"),
        (codec.set_input_vel(5, -2.5, 0.5), 0x0AD, "000020c00000003f"),
        (codec.set_axis_state(1, codec.CLOSED_LOOP), 0x027, "0800000000000000"),
        (codec.set_axis_state(63, codec.IDLE), 0x7E7, "0100000000000000"),
        (codec.set_controller_mode(3), 0x06B, "0200000001000000"),
        (codec.clear_errors(2), 0x058, "0000000000000000"),
        (codec.estop(2), 0x042, "0000000000000000"),
    ],
)
def test_golden_commands(frame: CanFrame, can_id: int, data: str) -> None:
    assert (frame.can_id, frame.data.hex(), frame.remote, frame.extended) == (can_id, data, False, False)


def test_golden_heartbeat_of_both_firmwares() -> None:
    assert codec.decode_heartbeat(bytes.fromhex("00080000 01 01 01 81"), "0.5") == codec.Heartbeat(
        0x800, 1, True, True, True, True
    )
    assert codec.decode_heartbeat(bytes.fromhex("00000001 08 01 01 00"), "0.6") == codec.Heartbeat(
        0x01000000, 8, trajectory_done=True, procedure_result=1
    )


def test_golden_estimates_and_bus() -> None:
    assert codec.decode_estimates(bytes.fromhex("0000803f 000020c0")) == codec.Estimates(1.0, -2.5)
    assert codec.decode_bus(bytes.fromhex("0000c041 0000003f")) == codec.Bus(24.0, 0.5)


@pytest.mark.parametrize(("dialect", "bit"), [("0.5", 0x800), ("0.6", 0x01000000)])
def test_pitfall_the_watchdog_bit_differs_between_firmwares(dialect: codec.Dialect, bit: int) -> None:
    assert codec.WATCHDOG_BIT[dialect] == bit
    assert codec.error_names(bit, dialect) == ("watchdog expired",)


@pytest.mark.parametrize(
    "frame", [codec.set_input_vel(1, 1.0), codec.set_axis_state(1, 8), codec.clear_errors(1), codec.estop(1)]
)
def test_pitfall_every_frame_is_padded_to_8_bytes(frame: CanFrame) -> None:
    assert len(frame.data) == 8


@given(node=NODE, speed=FLOAT32, torque=FLOAT32)
def test_setpoint_round_trip(node: int, speed: float, torque: float) -> None:
    frame = codec.set_input_vel(node, speed, torque)
    assert codec.split_id(frame.can_id) == (node, codec.SET_INPUT_VEL)
    assert struct.unpack("<ff", frame.data) == (speed, torque)


@given(node=NODE, command=st.integers(0, 31))
def test_identifier_round_trip(node: int, command: int) -> None:
    assert codec.split_id(codec.frame_id(node, command)) == (node, command)
    request = codec.request(node, command)
    assert request.remote
    assert not request.data


@given(data=st.binary(max_size=8), dialect=st.sampled_from(["0.5", "0.6"]))
def test_decoders_never_raise_and_never_yield_nonsense(data: bytes, dialect: codec.Dialect) -> None:
    beat = codec.decode_heartbeat(data, dialect)
    assert (beat is None) == (len(data) < 5)
    if beat is not None:
        assert len(codec.error_names(beat.axis_error, dialect)) == beat.axis_error.bit_count()
    for decode in (codec.decode_estimates, codec.decode_bus):
        pair = decode(data)
        assert pair is None or all(map(math.isfinite, pair))
        assert len(data) == 8 or pair is None
