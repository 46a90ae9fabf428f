"""VESC on a UART: golden bytes from vedderb/bldc ``comm/packet.c`` and ``comm/commands.c``."""

import pytest
from benches import ROBOT, Bench
from hypothesis import given
from hypothesis import strategies as st

from drivers.bandwidth import Bandwidth
from drivers.mock.vesc_uart import checksum
from drivers.serial import vesc_packet as codec
from drivers.serial.vesc_uart import Drive

REPLY = bytes.fromhex("32 0002a180 fffff448 00f0 fffffffa 00 0b")


@pytest.mark.parametrize(
    ("data", "golden"),
    [
        (codec.Command(codec.SET_RPM).packet(3000), "02 05 08 00000bb8 f804 03"),
        (codec.Command(codec.SET_RPM).packet(3000)[2:-3], "08 00000bb8"),
        (codec.Command(codec.SET_BRAKE, forward_to=11).packet(5000)[:-3], "02 07 22 0b 07 00001388"),
        (codec.ask_values()[:-3], "02 05 32 0002a180"),
        (codec.ask_values(11)[:-3], "02 07 22 0b 32 0002a180"),
        (codec.packet(bytes(300))[:4], "03 012c 00"),
    ],
)
def test_golden_packets(data: bytes, golden: str) -> None:
    assert data == bytes.fromhex(golden)


def test_golden_values() -> None:
    assert codec.decode_values(REPLY) == (-3000, 24.0, -6, 0, 11)
    assert codec.decode_values(REPLY[:-1]) is None
    assert codec.decode_values(b"\x04" + REPLY[1:]) is None


@given(st.binary(max_size=60))
def test_two_independent_checksums_agree(data: bytes) -> None:
    assert codec.packet(data or b"\0")[-3:-1] == checksum(data or b"\0").to_bytes(2, "big")


@given(junk=st.binary(max_size=20).filter(lambda data: not {2, 3} & set(data)), chunk=st.integers(1, 40))
def test_packets_in_any_chunks_behind_junk(junk: bytes, chunk: int) -> None:
    reader = codec.PacketReader()
    data = junk + codec.packet(REPLY) * 3
    payloads = [p for start in range(0, len(data), chunk) for p in reader.feed(data[start : start + chunk])]
    assert payloads == [REPLY] * 3
    assert reader.counters["stray_bytes"] == len(junk)


@given(bit=st.integers(0, 8 * (len(REPLY) + 5) - 1))
def test_one_flipped_bit_is_counted_and_the_next_packet_read(bit: int) -> None:
    damaged = bytearray(codec.packet(REPLY))
    damaged[bit // 8] ^= 1 << bit % 8
    reader = codec.PacketReader()
    payloads = reader.feed(bytes(damaged) + codec.packet(REPLY) + bytes(600))
    assert REPLY in payloads
    assert reader.counters


@given(st.binary(max_size=80))
def test_any_bytes_are_survived_by_both_ends(data: bytes) -> None:
    bench = Bench("vesc_uart")
    bench.start()
    bench.drive.inner._take_all(data)
    bench.device.receive(data, bench.now_ns)
    assert bench.speeds() == (0.0, 0.0)


@pytest.mark.parametrize("local", ["left", "right"])
def test_either_vesc_may_be_on_the_line(local: str) -> None:
    bench = Bench("vesc_uart", local=local)
    bench.start()
    bench.run(1.5, (6.0, -3.0))
    assert bench.speeds() == pytest.approx((6.0, -3.0), abs=0.02)
    assert not bench.device_counters


def test_pitfall_telemetry_does_not_feed_the_time_out_but_alive_does() -> None:
    bench = Bench("vesc_uart")
    bench.start()
    bench.run(0.5, (10.0, 10.0))
    for _ in range(60):
        bench.device.receive(codec.packet(b"\x1e") + codec.packet(b"\x22\x0b\x1e"), bench.now_ns)
        bench.run(0.008)
    assert bench.device.wheels.left.powered, "COMM_ALIVE keeps a setpoint turning: we never send it"
    for _ in range(60):
        bench.drive.poll(bench.now_ns)
        bench.device.receive(codec.ask_values(), bench.now_ns)
        bench.clock.let_pass(0.008)
        bench.host.advance(bench.now_ns)
    assert not bench.device.wheels.left.powered or bench.device.wheels.left.command_radps == 0.0


def test_a_full_reply_to_get_values_has_the_length_of_the_firmware() -> None:
    bench = Bench("vesc_uart")
    answer = bench.device.receive(codec.packet(b"\x04"), bench.now_ns)
    assert answer[1] == 1 + 73
    assert bench.host.robots[ROBOT].controller is bench.device


def test_pitfall_two_full_replies_to_get_values_take_longer_than_a_control_period() -> None:
    bench = Bench("vesc_uart")
    full = 2 * len(bench.device.receive(codec.packet(b"\x04"), bench.now_ns))
    assert not Bandwidth(full, 115200, 0.01).fits
    assert Bandwidth(Drive.CYCLE_BYTES, 115200, 0.01).fits


def test_it_tells_its_firmware_to_clients_that_ask_first() -> None:
    """COMM_FW_VERSION of ``commands.c``: major, minor, hardware name with its zero, 12 bytes of id, more."""
    bench = Bench("vesc_uart")
    (payload,) = codec.PacketReader().feed(bench.device.receive(bytes.fromhex("02 01 00 0000 03"), bench.now_ns))
    assert payload[:3] == b"\x00\x05\x02"
    assert payload[3:].partition(b"\0")[0] == b"410"
    assert not bench.device_counters
