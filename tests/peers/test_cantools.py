"""ODrive's published DBC (``tools/odrive-cansimple.dbc`` of odriverobotics/ODrive, firmware 0.5) through ``cantools``.

The file describes axis 0; its signals are written here as facts: command, message, then signal, first bit, bits, float.
"""

import struct

import cantools
import pytest
from cantools.database.can import Database, Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given
from hypothesis import strategies as st

from drivers.can import odrive_codec as codec
from drivers.can.frame import CanFrame
from drivers.can.odrive import Options
from drivers.mock.controller import Wheels
from drivers.mock.motor import MotorLimits
from drivers.mock.odrive import AxisSettings, EmulatedOdrive

FACTS = {
    (0x01, "Heartbeat"): [("Axis_Error", 0, 32, False), ("Axis_State", 32, 32, False)],
    (0x07, "Set_Axis_State"): [("Axis_Requested_State", 0, 32, False)],
    (0x09, "Get_Encoder_Estimates"): [("Pos_Estimate", 0, 32, True), ("Vel_Estimate", 32, 32, True)],
    (0x0B, "Set_Controller_Mode"): [("Control_Mode", 0, 32, False), ("Input_Mode", 32, 32, False)],
    (0x0D, "Set_Input_Vel"): [("Input_Vel", 0, 32, True), ("Input_Torque_FF", 32, 32, True)],
    (0x17, "Get_Vbus_Voltage"): [("Vbus_Voltage", 0, 32, True)],
}
SINGLE = st.floats(-1e4, 1e4, width=32)


def signal(name: str, start: int, length: int, is_float: bool) -> Signal:
    conversion = BaseConversion.factory(is_float=is_float)
    return Signal(name, start, length, byte_order="little_endian", conversion=conversion)


@pytest.fixture(scope="module")
def dbc() -> Database:
    messages = [
        Message(command, name, 8, [signal(*fact) for fact in facts]) for (command, name), facts in FACTS.items()
    ]
    return cantools.database.Database(messages=messages)


@given(velocity=SINGLE, torque=SINGLE, node=st.integers(0, 63))
def test_setpoints_are_what_the_dbc_encodes(dbc: Database, velocity: float, torque: float, node: int) -> None:
    data = dbc.encode_message("Set_Input_Vel", {"Input_Vel": velocity, "Input_Torque_FF": torque})
    assert codec.set_input_vel(node, velocity, torque) == CanFrame(node << 5 | 0x0D, data)


@pytest.mark.parametrize(
    ("frame", "name", "values"),
    [
        (codec.set_axis_state(3, 8), "Set_Axis_State", {"Axis_Requested_State": 8}),
        (codec.set_controller_mode(3), "Set_Controller_Mode", {"Control_Mode": 2, "Input_Mode": 1}),
    ],
)
def test_commands_are_what_the_dbc_encodes(dbc: Database, frame: CanFrame, name: str, values: dict[str, int]) -> None:
    assert frame.data == dbc.encode_message(name, values, padding=False)
    assert frame.can_id == 3 << 5 | dbc.get_message_by_name(name).frame_id


@given(position=SINGLE, velocity=SINGLE)
def test_estimates_are_read_as_the_dbc_means_them(dbc: Database, position: float, velocity: float) -> None:
    data = dbc.encode_message("Get_Encoder_Estimates", {"Pos_Estimate": position, "Vel_Estimate": velocity})
    assert codec.decode_estimates(data) == codec.Estimates(position, velocity)


def test_the_emulated_axis_speaks_what_the_dbc_decodes(dbc: Database) -> None:
    options = Options(kind="odrive", channel="x", left=0, right=1, dialect="0.5", watchdog_s=0.2)
    wheels = Wheels.of(MotorLimits())
    device = EmulatedOdrive(options, wheels, AxisSettings(bus_ns=100_000_000))
    command = dbc.encode_message("Set_Controller_Mode", {"Control_Mode": 2, "Input_Mode": 1})
    device.advance(0)
    device.take_frame(CanFrame(0x0B, command), 0)
    device.take_frame(CanFrame(0x07, dbc.encode_message("Set_Axis_State", {"Axis_Requested_State": 8})), 0)
    speed = dbc.encode_message("Set_Input_Vel", {"Input_Vel": 2.0, "Input_Torque_FF": 0.0})
    said: dict[int, dict[str, float]] = {}
    for step in range(100):
        device.take_frame(CanFrame(0x0D, speed), step * 10_000_000)
        for frame in device.advance(step * 10_000_000):
            if frame.can_id < 0x20:
                said[frame.can_id] = dbc.decode_message(frame.can_id, frame.data, decode_choices=False)
    assert said[0x01] == {"Axis_Error": 0, "Axis_State": 8}
    assert said[0x09]["Vel_Estimate"] == pytest.approx(2.0, abs=0.01)
    assert said[0x09]["Pos_Estimate"] == pytest.approx(wheels.left.angle_rad / 6.283185307, rel=1e-5)
    assert said[0x17]["Vbus_Voltage"] == 24.0


FACTS_06 = {
    (0x00, "Get_Version"): [
        (name, 8 * place, 8, False)
        for place, name in enumerate(
            ("Protocol", "Hw_Major", "Hw_Minor", "Hw_Variant", "Fw_Major", "Fw_Minor", "Fw_Revision", "Fw_Unreleased")
        )
    ],
    (0x01, "Heartbeat"): [
        ("Axis_Error", 0, 32, False),
        ("Axis_State", 32, 8, False),
        ("Procedure_Result", 40, 8, False),
        ("Trajectory_Done_Flag", 48, 1, False),
    ],
    (0x03, "Get_Error"): [("Active_Errors", 0, 32, False), ("Disarm_Reason", 32, 32, False)],
    (0x15, "Get_Temperature"): [("FET_Temperature", 0, 32, True), ("Motor_Temperature", 32, 32, True)],
    (0x1C, "Get_Torques"): [("Torque_Target", 0, 32, True), ("Torque_Estimate", 32, 32, True)],
    (0x1D, "Get_Powers"): [("Electrical_Power", 0, 32, True), ("Mechanical_Power", 32, 32, True)],
}
"""``odrive-cansimple-0.6.10.dbc`` as the ``odrive-can`` package 2.1.0 carries it."""


def polled(device: EmulatedOdrive, command: int) -> bytes | None:
    answer = device.take_frame(CanFrame(command, b"", remote=True), 0)
    return answer[0].data if answer else None


def test_the_emulated_0_6_axis_answers_polls_as_its_dbc_has_them() -> None:
    dbc = cantools.database.Database(
        messages=[Message(n, name, 8, [signal(*fact) for fact in facts]) for (n, name), facts in FACTS_06.items()]
    )
    options = Options(kind="odrive", channel="x", left=0, right=1, dialect="0.6", watchdog_s=0.2)
    device = EmulatedOdrive(options, Wheels.of(MotorLimits()), AxisSettings())
    device.advance(0)
    said = {n: dbc.decode_message(n, polled(device, n) or b"", decode_choices=False) for n, _ in FACTS_06}
    assert [said[0x00][name] for name in ("Fw_Major", "Fw_Minor", "Fw_Unreleased")] == [0, 6, 0]
    assert said[0x01] == {"Axis_Error": 0, "Axis_State": 1, "Procedure_Result": 0, "Trajectory_Done_Flag": 0}
    assert said[0x15]["Motor_Temperature"] == 30.0
    assert polled(device, 0x04) is None, "an endpoint access, not a poll"
    device.take_frame(CanFrame(0x0F, struct.pack("<ff", 1.0, 5.0)), 0)
    device.take_frame(CanFrame(0x0B, struct.pack("<II", 2, 1)), 0)
    device.take_frame(CanFrame(0x07, struct.pack("<II", 8, 0)), 0)
    device.take_frame(CanFrame(0x0D, struct.pack("<ff", 9.0, 0.0)), 0)
    assert device.axes[0].shaft.commanded_radps == pytest.approx(6.283185307)
    device.take_frame(CanFrame(0x16, b"\0"), 0)
    assert device.axes[0].state == 1


def test_a_0_5_axis_has_no_version_to_tell() -> None:
    options = Options(kind="odrive", channel="x", left=0, right=1, dialect="0.5", watchdog_s=0.2)
    device = EmulatedOdrive(options, Wheels.of(MotorLimits()), AxisSettings())
    device.advance(0)
    assert polled(device, 0x00) is None
    assert polled(device, 0x0A) == bytes(8)
