"""Dynamixel: golden bytes from the ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", examples of each instruction."""

import struct

import pytest
from benches import ROBOT, Bench
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base import ControllerFault, LinkLost, Refused, WheelSpeeds
from drivers.mock.dynamixel_packets import checksum
from drivers.serial import dynamixel_codec as codec

PING_STATUS = bytes.fromhex("FFFFFD00 01 0700 55 00 0604 26 655D")


@pytest.mark.parametrize(
    ("packet", "golden"),
    [
        (codec.packet(1, codec.PING), "FFFFFD00 01 0300 01 194E"),
        (codec.read(1, 132, 4), "FFFFFD00 01 0700 02 8400 0400 1D15"),
        (codec.write(1, 116, struct.pack("<I", 512)), "FFFFFD00 01 0900 03 7400 00020000 CA89"),
        (codec.sync_read((1, 2), 132, 4), "FFFFFD00 FE 0900 82 8400 0400 01 02 CEFA"),
        (
            codec.sync_write(116, 4, [(1, struct.pack("<I", 150)), (2, struct.pack("<I", 170))]),
            "FFFFFD00 FE 1100 83 7400 0400 01 96000000 02 AA000000 8287",
        ),
    ],
)
def test_golden_packets(packet: bytes, golden: str) -> None:
    assert packet == bytes.fromhex(golden)


def test_golden_status() -> None:
    reader = codec.PacketReader()
    assert reader.feed(PING_STATUS) == [(1, 0, b"\x06\x04\x26")]
    assert not reader.counters


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1), st.integers(0, 252), st.integers(0, 252))
def test_goals_are_a_sync_write_whatever_they_are(left: int, right: int, first: int, second: int) -> None:
    values = [(first, struct.pack("<i", left)), (second, struct.pack("<i", right))]
    assert codec.GoalWriter(104, first, second).packet(left, right) == codec.sync_write(104, 4, values)


@given(st.binary(max_size=60))
def test_two_independent_checksums_agree(data: bytes) -> None:
    assert codec.crc16(data) == checksum(data)


@given(junk=st.binary(max_size=30), chunk=st.integers(1, 40))
def test_status_in_any_chunks_behind_junk(junk: bytes, chunk: int) -> None:
    reader = codec.PacketReader()
    data = junk + PING_STATUS * 3 + b"\xff\xff"
    packets = [p for start in range(0, len(data), chunk) for p in reader.feed(data[start : start + chunk])]
    assert packets.count((1, 0, b"\x06\x04\x26")) >= 2


@given(bit=st.integers(0, 8 * len(PING_STATUS) - 1))
def test_one_flipped_bit_yields_no_packet(bit: int) -> None:
    damaged = bytearray(PING_STATUS)
    damaged[bit // 8] ^= 1 << bit % 8
    reader = codec.PacketReader()
    assert reader.feed(bytes(damaged) + bytes(300)) == []
    assert sum(reader.counters.values()) > 0


@given(st.lists(st.binary(max_size=80), max_size=6))
def test_any_bytes_are_survived_by_both_ends(chunks: list[bytes]) -> None:
    reader, bench = codec.PacketReader(), Bench("dynamixel")
    bench.start()
    for data in chunks:
        reader.feed(data)
        bench.device.receive(data, bench.now_ns)
    assert bench.speeds() == (0.0, 0.0)


@given(velocity=st.integers(-(2**31), 2**31 - 1), low=st.integers(0, 0xFFFFFF))
def test_pitfall_stuffing_velocity_minus_one_before_a_position_ending_in_fd(velocity: int, low: int) -> None:
    for data in (struct.pack("<iI", -1, low << 8 | 0xFD), struct.pack("<iI", velocity, low)):
        body = b"\x55\x00" + data
        stuffed = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        whole = b"\xff\xff\xfd\x00\x01" + struct.pack("<H", len(stuffed) + 2) + stuffed
        packet = whole + struct.pack("<H", checksum(whole))
        assert codec.PacketReader().feed(packet) == [(1, 0, data)]


def test_pitfall_the_watchdog_is_off_by_default_and_is_set_in_20_ms_counts() -> None:
    bench = Bench("dynamixel")
    assert [servo.table[98] for servo in bench.device.servos] == [0, 0]
    bench.drive.configure()
    assert [servo.table[98] for servo in bench.device.servos] == [10, 10]


def test_pitfall_a_tripped_watchdog_refuses_goals_until_activation_clears_it() -> None:
    bench = Bench("dynamixel")
    bench.start()
    bench.run(0.5, (5.0, 5.0))
    bench.run(0.5)
    bench.run(0.5, (5.0, 5.0))
    assert bench.speeds() == pytest.approx((0.0, 0.0), abs=1e-3)
    assert bench.device.counters["refused_write"] > 0
    bench.drive.activate(bench.now_ns)
    bench.run(1.5, (5.0, 5.0))
    assert bench.speeds() == pytest.approx((5.0, 5.0), abs=0.02)


def test_pitfall_the_default_57600_baud_is_refused_with_the_arithmetic() -> None:
    with pytest.raises(Refused, match=r"78 bytes x 10 bits / 57600 baud = 13\.5 ms"):
        Bench("dynamixel", baud=57600).drive.configure()


def test_pitfall_mode_changes_only_with_torque_off() -> None:
    bench = Bench("dynamixel")
    servo = bench.device.servos[0]
    servo.table[64] = 1
    assert servo.write(11, b"\x01") == 7
    bench.drive.configure()
    assert servo.table[11] == 1


def test_a_servo_is_reset_and_backed_up_as_other_programs_ask() -> None:
    """e-Manual: Factory Reset (0x06) of all but id and baud rate; Control Table Backup (0x20), with torque off only."""
    bench = Bench("dynamixel")
    servo = bench.device.servos[0]

    def said(instruction: int, parameters: bytes) -> int:
        ((_, error, _),) = codec.PacketReader().feed(
            bench.device.receive(codec.packet(servo.device, instruction, parameters), bench.now_ns)
        )
        return error

    servo.table[8], servo.table[11] = 3, 1
    assert said(0x20, b"\x01CTRL") == 0
    assert said(0x06, b"\x02") == 0
    assert (servo.table[7], servo.table[8], servo.table[11]) == (servo.device, 3, 3)
    assert said(0x20, b"\x02CTRL") == 0
    assert servo.table[11] == 1
    servo.table[64] = 1
    assert said(0x20, b"\x02CTRL") == 1
    assert said(0x06, b"\x07") == 2


def test_a_missing_servo_is_named() -> None:
    bench = Bench("dynamixel")
    bench.device.servos[1].device = 7
    with pytest.raises(LinkLost, match="no answer from the right servo, id 2"):
        bench.drive.configure()


def test_a_hardware_error_is_reported_by_name_and_blocks_activation() -> None:
    bench = Bench("dynamixel")
    bench.start()
    bench.run(0.1, (1.0, 1.0))
    bench.device.servos[1].table[70] = 0x20
    feedback = bench.run(0.1, (1.0, 1.0))
    assert feedback is not None
    assert feedback.faults == ("right overload",)
    assert not feedback.enabled


def test_a_servo_that_refuses_torque_is_a_controller_fault() -> None:
    bench = Bench("dynamixel")
    bench.drive.configure()
    servo = bench.device.servos[1]
    servo.table[70] = 0x04
    write = servo.write
    servo.write = lambda address, data: 7 if address == 64 else write(address, data)
    with pytest.raises(ControllerFault, match="right torque does not switch on: right overheating"):
        bench.drive.activate(bench.now_ns)


def test_both_goals_leave_in_one_packet() -> None:
    bench = Bench("dynamixel")
    bench.start()
    sent: list[bytes] = []
    wire = bench.host.robots[ROBOT].wires[0]
    send = wire.send
    wire.send = lambda data: sent.append(data) or send(data)  # type: ignore[func-returns-value]
    bench.drive.write(WheelSpeeds(1.0, 1.0), bench.now_ns)
    assert [len(data) for data in sent] == [24]


def test_pitfall_half_a_millisecond_of_return_delay_by_default_is_taken_away() -> None:
    bench = Bench("dynamixel")
    assert [servo.table[9] for servo in bench.device.servos] == [250, 250]
    bench.start()
    assert [servo.table[9] for servo in bench.device.servos] == [0, 0]


def test_pitfall_a_servo_too_slow_for_the_arena_is_refused_for_it_ignores_faster_goals() -> None:
    bench = Bench("dynamixel")
    bench.start()
    servo = bench.device.servos[1]
    servo.table[44:48] = struct.pack("<I", 445)
    assert servo.write(104, struct.pack("<i", 446)) == 6
    assert servo.write(104, struct.pack("<i", -445)) == 0
    with pytest.raises(
        Refused, match=r"right servo turns its wheel at 8\.5 rad/s at most \(Velocity Limit 445\)"
    ) as caught:
        bench.drive.configure()
    assert "max_speed_mps to 0.25 or less" in caught.value.remedy


@pytest.mark.parametrize(
    ("trim", "needs"),
    [
        ({"left_wheel_radius_multiplier": 0.6}, r"44\.4"),
        ({"right_wheel_radius_multiplier": 0.6}, r"44\.4"),
        ({"wheel_separation_multiplier": 1.5}, r"40\.0"),
    ],
)
def test_a_calibration_may_ask_for_faster_wheels(trim: dict[str, float], needs: str) -> None:
    with pytest.raises(Refused, match=f"turns its wheel at 31.1 rad/s at most .* needs {needs};"):
        Bench("dynamixel", **trim).drive.configure()
    inverse = {key: 1.0 / value for key, value in trim.items()}
    Bench("dynamixel", **inverse).drive.configure()


@settings(max_examples=25)
@given(wanted=st.tuples(st.floats(-26.6, 26.6), st.floats(-26.6, 26.6)), radius=st.floats(0.87, 2.0))
def test_no_goal_is_ever_beyond_the_limit(wanted: tuple[float, float], radius: float) -> None:
    bench = Bench("dynamixel", left_wheel_radius_multiplier=radius)
    bench.start()
    bench.drive.gate.arm(bench.now_ns - 10**9)
    bench.drive.write(WheelSpeeds(*wanted), bench.now_ns)
    bench.run(0.01)
    assert not bench.device.counters["refused_write"]
