"""What the makers' manuals warn of, on the emulated devices themselves."""

import struct

import pytest

from drivers.can.frame import CanFrame
from drivers.can.odrive import Options as OdriveOptions
from drivers.mock.controller import Wheels
from drivers.mock.motor import MotorLimits
from drivers.mock.odrive import AxisSettings, EmulatedOdrive
from drivers.mock.roboclaw import EmulatedRoboclaw, crc16
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
