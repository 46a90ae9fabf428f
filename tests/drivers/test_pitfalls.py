"""What the makers' manuals warn of, on the emulated devices themselves."""

import itertools
import math
import struct
import threading

import pytest
from benches import ROBOT, WHEELS, Bench

from drivers.base import ControllerFault
from drivers.can.frame import CanFrame
from drivers.can.odrive import Options as OdriveOptions
from drivers.can.vesc import Options as VescOptions
from drivers.mock.controller import Wheels
from drivers.mock.dynamixel_packets import checksum
from drivers.mock.motor import MotorLimits
from drivers.mock.odrive import AxisSettings, EmulatedOdrive
from drivers.mock.roboclaw import EmulatedRoboclaw
from drivers.mock.roboclaw_packets import crc16
from drivers.mock.vesc import EmulatedVescs, VescSettings
from drivers.serial.dynamixel_codec import PacketReader
from drivers.serial.roboclaw import Options as RoboclawOptions

MS = 1_000_000


def roboclaw() -> EmulatedRoboclaw:
    options = RoboclawOptions(kind="roboclaw", port="x", counts_per_revolution=2048)
    return EmulatedRoboclaw(options, Wheels.of(MotorLimits()), 0)


def speeds(m1: int, m2: int) -> bytes:
    packet = struct.pack(">BBii", 0x80, 37, m1, m2)
    return packet + struct.pack(">H", crc16(packet))


def odrive(dialect: str, watchdog_ns: int = 0) -> EmulatedOdrive:
    options = OdriveOptions(kind="odrive", channel="x", left=0, right=1, dialect=dialect, watchdog_s=0.2)  # type: ignore[arg-type]
    device = EmulatedOdrive(options, Wheels.of(MotorLimits()), AxisSettings(watchdog_ns=watchdog_ns))
    device.advance(0)
    return device


def test_pitfall_a_gap_of_more_than_10_ms_within_a_roboclaw_packet_discards_it() -> None:
    whole = speeds(2048, 2048)
    for gap_ms, taken in ((9, True), (11, False)):
        device = roboclaw()
        assert device.receive(whole[:5], 0) == b""
        device.receive(whole[5:], gap_ms * MS)
        assert device.wheels.left.powered is taken
        assert bool(device.counters["gap"]) is not taken


def test_pitfall_a_roboclaws_single_speed_is_a_magnitude_and_a_direction() -> None:
    device = roboclaw()
    device.receive(speeds(2048, -2048), 0)
    device.receive(speeds(2048, -2048), 400 * MS)
    for command, direction in ((18, 0), (19, 1)):
        data = device.receive(bytes((0x80, command)), 900 * MS)
        magnitude, backward, crc = struct.unpack(">IBH", data)
        assert magnitude == pytest.approx(2048, rel=0.02)
        assert backward == direction
        assert crc == crc16(bytes((0x80, command)) + data[:5])


@pytest.mark.parametrize(
    ("command", "value", "signs"),
    [(0, 64, (1, 0)), (1, 64, (-1, 0)), (4, 64, (0, 1)), (5, 64, (0, -1)), (6, 127, (1, 0)), (7, 0, (0, -1))],
)
def test_pitfall_a_roboclaw_obeys_the_7_bit_commands_of_any_other_program(
    command: int, value: int, signs: tuple[int, int]
) -> None:
    """User manual pp. 60-61: 0 and 1 drive M1, 4 and 5 M2, by 0 to 127; 6 and 7 by 0 to 127 with 64 as stop."""
    device = roboclaw()
    packet = bytes((0x80, command, value))
    assert device.receive(packet + struct.pack(">H", crc16(packet)), 0) == b"\xff"
    device.advance(500 * MS)
    found = (device.wheels.left.radps, device.wheels.right.radps)
    assert tuple((speed > 1.0) - (speed < -1.0) for speed in found) == signs


def test_pitfall_a_roboclaws_time_out_is_off_by_default() -> None:
    device = roboclaw()
    device.receive(speeds(2048, 2048), 0)
    device.advance(60_000 * MS)
    assert device.wheels.left.powered
    assert device.receive(bytes((0x80, 15)), 60_000 * MS)[0] == 0


def told(device: EmulatedRoboclaw, command: int, layout: str = "", *values: int) -> bytes:
    packet = struct.pack(f">BB{layout}", 0x80, command, *values)
    return device.receive(packet + struct.pack(">H", crc16(packet)), 0)


def asked(device: EmulatedRoboclaw, command: int, layout: str) -> tuple[int, ...]:
    answer = device.receive(bytes((0x80, command)), 0)
    assert struct.unpack(">H", answer[-2:])[0] == crc16(bytes((0x80, command)) + answer[:-2])
    return struct.unpack(f">{layout}", answer[:-2])


@pytest.mark.parametrize(
    ("write", "read", "layout"), [(57, 59, "HH"), (74, 75, "BBB"), (98, 99, "H"), (133, 135, "II")]
)
def test_a_roboclaw_keeps_what_configuring_programs_set(write: int, read: int, layout: str) -> None:
    device = roboclaw()
    new = asked(device, read, layout)
    values = tuple(range(7, 7 + len(layout)))
    assert told(device, write, layout, *values) == b"\xff"
    assert asked(device, read, layout) == values
    assert told(device, 94, "I", 0xE22EAB7A) == told(device, 80) == b"\xff"
    assert asked(device, read, layout) == new, "restored"
    assert told(device, 95) == b"\xff"
    assert asked(device, read, layout) == values, "as stored"
    assert not device.counters


def test_pitfall_a_roboclaws_gains_are_set_as_d_p_i_and_read_as_p_i_d() -> None:
    device = roboclaw()
    assert told(device, 28, "IIII", 1, 2, 3, 44) == b"\xff"
    assert asked(device, 55, "IIII") == (2, 3, 1, 44)
    assert told(device, 62, "IIIIIII", 1, 2, 3, 4, 5, 6, 7) == b"\xff"
    assert asked(device, 64, "IIIIIII") == (2, 3, 1, 4, 5, 6, 7)
    told(device, 69, "I", 9)
    assert asked(device, 81, "II") == (655_360, 9), "M2 alone"


def test_pitfall_a_roboclaws_mixed_commands_move_nothing_before_both_parts_were_given() -> None:
    device = roboclaw()
    told(device, 8, "B", 64)
    assert not device.wheels.left.powered
    told(device, 10, "B", 20)
    device.advance(500 * MS)
    assert device.wheels.left.radps > device.wheels.right.radps > 0.0
    told(device, 12, "B", 64)
    told(device, 13, "B", 64)
    assert device.released


@pytest.mark.parametrize(("dialect", "answered"), [("0.5", True), ("0.6", False)])
def test_pitfall_only_0_5_takes_an_empty_data_frame_for_a_poll(dialect: str, answered: bool) -> None:
    assert odrive(dialect).take_frame(CanFrame(0x09, b"", remote=True), 0)
    assert bool(odrive(dialect).take_frame(CanFrame(0x09), 0)) is answered


@pytest.mark.parametrize(("dialect", "alive"), [("0.5", True), ("0.6", False)])
def test_pitfall_polling_feeds_the_watchdog_of_a_0_5_axis_whose_setpoints_have_stopped(
    dialect: str, alive: bool
) -> None:
    device = odrive(dialect, watchdog_ns=200 * MS)
    for node in (0, 1):
        device.take_frame(CanFrame(node << 5 | 0x0B, struct.pack("<II", 2, 1)), 0)
        device.take_frame(CanFrame(node << 5 | 0x07, struct.pack("<II", 8, 0)), 0)
    for step in range(1, 50):
        device.advance(step * 10 * MS)
        for node in (0, 1):
            device.take_frame(CanFrame(node << 5 | 0x09, b"", remote=True), step * 10 * MS)
    assert (device.axes[0].state == 8) is alive


def test_pitfall_15_1c_and_1d_are_other_messages_in_0_5_and_in_0_6() -> None:
    """0.5: sensorless estimates, ADC voltage, controller error; 0.6: temperatures, torques, powers."""
    old, new = odrive("0.5"), odrive("0.6")
    for command in (0x15, 0x1C, 0x1D):
        answers = [device.take_frame(CanFrame(command, b"", remote=True), 0)[0] for device in (old, new)]
        assert all(frame.can_id == command and len(frame.data) == 8 for frame in answers)
        assert answers[0].data == bytes(8)
        assert (answers[1].data == struct.pack("<ff", 30.0, 30.0)) is (command == 0x15)
    for dialect in ("0.5", "0.6"):
        bench = Bench("odrive", dialect=dialect)
        bench.start()
        node = bench.drive.inner.motors[0].device
        for command in (0x15, 0x1C, 0x1D):
            frame = CanFrame(node << 5 | command, struct.pack("<ff", 30.0, 7.0))
            assert bench.drive.inner._deal(frame) == "unused_frame"
        feedback = bench.run(0.1, (0.0, 0.0))
        assert feedback is not None
        assert (feedback.left_radps, feedback.left_rad) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_pitfall_the_dbc_of_0_5_6_calls_input_vel_rev_but_it_is_rev_per_s() -> None:
    """Two seconds at 1.0 are two turns, not one."""
    device = odrive("0.5")
    device.take_frame(CanFrame(0x0B, struct.pack("<II", 2, 1)), 0)
    device.take_frame(CanFrame(0x07, struct.pack("<II", 8, 0)), 0)
    device.take_frame(CanFrame(0x0D, struct.pack("<ff", 1.0, 0.0)), 0)
    device.advance(1000 * MS)
    begun = device.axes[0].shaft.turns
    device.advance(3000 * MS)
    assert device.axes[0].shaft.turns - begun == pytest.approx(2.0, abs=0.01)


def test_pitfall_a_vesc_needs_no_enabling_and_coasts_at_current_zero() -> None:
    options = VescOptions(kind="vesc", channel="x", left=1, right=2, pole_pairs=7, watchdog_s=0.2)
    device = EmulatedVescs(options, Wheels.of(MotorLimits()), VescSettings())
    device.advance(0)
    device.take_frame(CanFrame(3 << 8 | 1, (1500).to_bytes(4, "big"), True), 0)
    device.advance(900 * MS)
    wheel = device.wheels.left
    assert wheel.radps == pytest.approx(1500 / 7 / 60 * 6.283185307, rel=0.01)
    device.take_frame(CanFrame(1 << 8 | 1, bytes(4), True), 900 * MS)
    device.advance(950 * MS)
    assert not wheel.powered
    assert wheel.radps > 15.0, "rolls on"


def test_pitfall_a_vesc_ramps_its_setpoint_whatever_the_motor_can() -> None:
    """25000 electrical rpm a second: with a gear of 10 weaker than most robots brake."""
    options = VescOptions(kind="vesc", channel="x", left=1, right=2, pole_pairs=7, gear_ratio=10.0, watchdog_s=0.2)
    ramp_radps2 = 25_000 / 60 / 7 / 10 * 2 * math.pi
    device = EmulatedVescs(options, Wheels.of(MotorLimits(lag_s=0.01)), VescSettings())
    assert device.wheels.left.limits.acceleration_radps2 > 1.2 * ramp_radps2
    device.advance(0)
    device.take_frame(CanFrame(3 << 8 | 1, (10_000).to_bytes(4, "big"), True), 0)
    speeds = []
    for k in range(1, 4):
        device.advance(k * 50 * MS)
        speeds.append(device.wheels.left.radps)
    assert [after - before for before, after in itertools.pairwise(speeds)] == pytest.approx([0.05 * ramp_radps2] * 2)


def test_pitfall_an_axis_runs_only_once_its_heartbeat_says_so() -> None:
    """0.5.6 manual, "CAN Protocol": mode, clear errors, state; then the heartbeat must confirm closed loop."""
    bench = Bench("odrive")
    bench.drive.configure()
    port = bench.drive.inner.line.port
    sent: list[int] = []
    send = port.send
    port.send = lambda frames: sent.extend(frame.can_id for frame in frames) or send(frames)
    bench.drive.activate(bench.now_ns)
    assert [can_id & 0x1F for can_id in sent if can_id >> 5 == 4][:4] == [0x0B, 0x0D, 0x18, 0x07]
    bench.drive.deactivate(bench.now_ns)
    port.send = lambda frames: True
    with pytest.raises(ControllerFault, match="closed loop not reached"):
        bench.drive.activate(bench.now_ns)


def test_pitfall_a_vescs_status_messages_carry_no_fault_code() -> None:
    """Over CAN a fault shows as standing wheels; over UART by its code."""
    over_can, over_uart = Bench("vesc"), Bench("vesc_uart")
    for bench in (over_can, over_uart):
        bench.start()
        bench.run(0.5, (5.0, 5.0))
        bench.host.fault(ROBOT, "brown-out")
    silent, told = over_can.run(0.3, (5.0, 5.0)), over_uart.run(0.3, (5.0, 5.0))
    assert silent is None or silent.faults == ()
    assert told is not None
    assert "left under-voltage" in told.faults


@pytest.mark.parametrize("kind", WHEELS)
def test_pitfall_no_driver_starts_a_thread_that_would_wait_for_the_interpreter(kind: str) -> None:
    before = set(threading.enumerate())
    bench = Bench(kind)
    bench.start()
    assert set(threading.enumerate()) <= before


def test_pitfall_packets_that_the_makers_sdk_leaves_unstuffed_are_read_at_both_ends() -> None:
    content = b"\xff\xff\xfd\x01"

    def unstuffed(instruction: bytes) -> bytes:
        whole = b"\xff\xff\xfd\x00\x01" + struct.pack("<H", len(instruction) + 2) + instruction
        return whole + struct.pack("<H", checksum(whole))

    reader = PacketReader()
    assert reader.feed(unstuffed(b"\x55\x00" + content)) == [(1, 0, content)]
    bench = Bench("dynamixel")
    bench.device.receive(unstuffed(b"\x03" + struct.pack("<H", 108) + content), bench.now_ns)
    assert bytes(bench.device.servos[0].table[108:112]) == content
    assert not bench.device_counters
    assert not reader.counters
