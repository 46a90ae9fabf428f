"""Golden bytes: RoboClaw Series User Manual, packet serial (pp. 58-59) and command tables (pp. 66-97)."""

import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bandwidth import Bandwidth
from drivers.conversion import saturate
from drivers.mock.roboclaw_packets import crc16
from drivers.serial import roboclaw_codec as codec
from drivers.serial.roboclaw import Drive

ADDRESS = 0x80
QPPS = st.integers(-(2**31), 2**31 - 1)


@pytest.mark.parametrize(
    ("packet", "golden"),
    [
        (codec.speed_both(ADDRESS, 1000, -1000), "80 25 00 00 03 e8 ff ff fc 18 82 90"),
        (codec.duty_both(ADDRESS, 0, 0), "80 22 00 00 00 00 98 17"),
        (codec.set_timeout(ADDRESS, 2), "80 0e 02 38 17"),
        (codec.read_packet(0x81, codec.GET_ENCODERS), "81 4e"),
    ],
)
def test_golden_packets(packet: bytes, golden: str) -> None:
    assert packet.hex(" ") == golden


@given(left=st.floats(-1e12, 1e12), right=st.floats(-1e12, 1e12), swapped=st.booleans())
def test_a_setpoint_shrinks_both_wheels_alike_beyond_32_bits(left: float, right: float, swapped: bool) -> None:
    m1, m2 = saturate(*((right, left) if swapped else (left, right)), 2**31 - 1)
    packet = codec.SpeedWriter(ADDRESS, swapped).packet(left, right)
    assert packet == codec.speed_both(ADDRESS, round(m1), round(m2))


def reply(command: int, data: bytes) -> bytes:
    return data + struct.pack(">H", crc16(bytes((ADDRESS, command)) + data))


ENCODERS = struct.pack(">II", 5, 2**32 - 7)
STREAM = b"\xff" + reply(codec.GET_ENCODERS, ENCODERS) + reply(codec.GET_SPEEDS, struct.pack(">ii", -9, 9))
COMMANDS = (codec.SPEED_BOTH, codec.GET_ENCODERS, codec.GET_SPEEDS)


def expecting(*commands: int) -> codec.Replies:
    replies = codec.Replies(ADDRESS)
    replies.expect(0, commands)
    return replies


def test_replies_whole_byte_by_byte_and_with_trailing_junk() -> None:
    whole = expecting(*COMMANDS).feed(STREAM, 1)
    assert [command for command, _ in whole] == list(COMMANDS)
    assert codec.decode_encoders(whole[1][1]) == (5, 2**32 - 7)
    assert codec.decode_speeds(whole[2][1]) == (-9, 9)
    single = expecting(*COMMANDS)
    assert [entry for byte in STREAM for entry in single.feed(bytes((byte,)), 1)] == whole
    junk = expecting(*COMMANDS)
    assert junk.feed(STREAM + b"junk", 1) == whole
    assert junk.counters == {"stray_bytes": 4}


@given(cuts=st.lists(st.integers(0, len(STREAM)), max_size=6))
def test_replies_in_any_chunks(cuts: list[int]) -> None:
    replies = expecting(*COMMANDS)
    bounds = [0, *sorted(cuts), len(STREAM)]
    taken = [r for a, b in pairwise(bounds) for r in replies.feed(STREAM[a:b], 1)]
    assert [command for command, _ in taken] == list(COMMANDS)
    assert not replies.counters


def test_pitfall_the_reply_crc_covers_address_and_command_too() -> None:
    data = struct.pack(">II", 1, 2)
    replies = expecting(codec.GET_ENCODERS)
    assert replies.feed(data + struct.pack(">H", crc16(data)), 1) == []
    assert replies.counters == {"bad_crc": 1}


@given(bit=st.integers(8, 8 * len(STREAM) - 1))
def test_one_flipped_bit_never_yields_a_wrong_reply(bit: int) -> None:
    damaged = bytearray(STREAM)
    damaged[bit // 8] ^= 1 << bit % 8
    replies = expecting(*COMMANDS)
    good = expecting(*COMMANDS).feed(STREAM, 1)
    assert all(entry in good for entry in replies.feed(bytes(damaged), 1))
    assert sum(replies.counters.values()) >= 1


@given(data=st.binary(max_size=80), commands=st.lists(st.sampled_from([37, 78, 79, 90, 24, 21, 15, 200]), max_size=5))
def test_any_bytes_are_survived(data: bytes, commands: list[int]) -> None:
    replies = expecting(*commands)
    for now_ns, byte in enumerate(data):
        for command, _ in replies.feed(bytes((byte,)), now_ns):
            assert command in commands


def test_resynchronisation_waits_for_quiet_then_pairs_afresh() -> None:
    replies = expecting(*COMMANDS)
    assert replies.feed(b"\x00" + STREAM, 1) == []
    assert replies.counters == {"bad_ack": 1}
    assert replies.quiet(2)
    replies.expect(3, (codec.SPEED_BOTH,))
    assert replies.feed(b"\xff", 4) == []
    assert replies.counters["discarded_bytes"] == 1
    later = 1 + replies.QUIET_NS
    assert not replies.quiet(later)
    replies.expect(later, (codec.GET_ENCODERS,))
    assert [command for command, _ in replies.feed(reply(codec.GET_ENCODERS, ENCODERS), later)] == [codec.GET_ENCODERS]


def test_an_acknowledgement_that_outlives_the_quiet_time_is_skipped() -> None:
    replies = expecting(codec.SPEED_BOTH)
    replies.feed(b"\x00", 1)
    replies.expect(2, (codec.SPEED_BOTH,))
    later = 1 + replies.QUIET_NS
    replies.expect(later, (codec.GET_ENCODERS,))
    taken = replies.feed(b"\xff" + reply(codec.GET_ENCODERS, ENCODERS), later + 1)
    assert [command for command, _ in taken] == [codec.GET_ENCODERS]
    assert replies.counters["late_ack"] == 1


def test_silence_is_counted() -> None:
    replies = expecting(codec.GET_ENCODERS)
    assert replies.feed(b"", replies.REPLY_NS) == []
    assert not replies.counters
    replies.feed(b"", replies.REPLY_NS + 1)
    assert replies.counters == {"no_reply": 1}


def test_status_version_and_battery() -> None:
    assert codec.decode_status(bytes.fromhex("00010041")) == ("estop", "M1 driver fault")
    assert codec.firmware("USB Roboclaw 2x7a v4.1.34\n") == (4, 1, 34)
    assert codec.firmware("?") == ()
    assert codec.decode_battery(b"\x00\x79") == 12.1


@pytest.mark.parametrize(
    ("baud", "busy_ms", "fits"), [(115200, 3.2, True), (38400, 9.6, False), (1_000_000, 0.37, True)]
)
def test_pitfall_38400_baud_cannot_run_100_hz(baud: int, busy_ms: float, fits: bool) -> None:
    bandwidth = Bandwidth(Drive.CYCLE_BYTES, baud, 0.01)
    assert bandwidth.busy_s * 1e3 == pytest.approx(busy_ms, abs=0.05)
    assert bandwidth.fits is fits
    assert fits or "37 bytes x 10 bits / 38400 baud = 9.6 ms" in str(bandwidth)
