"""VESC: golden bytes from vedderb/bldc ``documentation/comm_can.md``."""

import math
from collections import Counter
from collections.abc import Callable

import pytest
from benches import ROBOT, Bench
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import LinkLost, Refused
from drivers.can import vesc_codec as codec
from drivers.can.frame import CanFrame
from drivers.vesc_motor import Setpoint, motor_of


@pytest.mark.parametrize(
    ("frame", "can_id", "data"),
    [
        (codec.set_rpm(3, 3000), 0x303, "00000bb8"),
        (codec.set_rpm(10, -1), 0x30A, "ffffffff"),
        (codec.set_current(1, 0.0), 0x101, "00000000"),
        (codec.set_brake(1, 5.0), 0x201, "00001388"),
    ],
)
def test_golden_commands(frame: CanFrame, can_id: int, data: str) -> None:
    assert (frame.can_id, frame.data.hex(), frame.extended) == (can_id, data, True)


def test_golden_status() -> None:
    assert codec.decode_status_1(bytes.fromhex("fffff448 0064 01f4")) == codec.Status1(-3000, 10.0, 0.5)
    assert codec.decode_status_5(bytes.fromhex("fffffffa 00f0 0000")) == codec.Status5(-6, 24.0)


@given(st.binary(max_size=8), st.integers(0, 2**29 - 1))
def test_any_frame_is_survived_by_both_ends(data: bytes, can_id: int) -> None:
    for decode, length in ((codec.decode_status_1, 8), (codec.decode_status_5, 6)):
        assert (decode(data) is None) == (len(data) < length)
    bench = Bench("vesc")
    bench.start()
    bench.drive.inner._deal(CanFrame(can_id, data, True))
    bench.device.device.take_frame(CanFrame(can_id | 0x1000, data, True), bench.now_ns)
    assert bench.speeds() == (0.0, 0.0)


def test_pitfall_status_messages_are_off_by_default_and_asked_for_by_number() -> None:
    bench = Bench("vesc")
    bench.device.device.settings = bench.device.device.settings._replace(status_ns=0)
    with pytest.raises(LinkLost, match=r"no status message 1 and 5 from left \(id 10\)") as caught:
        bench.drive.configure()
    assert "VESC Tool" in caught.value.remedy


def test_pitfall_below_min_erpm_there_is_no_current_so_zero_is_a_brake() -> None:
    bench = Bench("vesc", min_erpm=900.0)
    bench.start()
    bench.run(1.5, (20.0, 20.0))
    assert bench.speeds() == pytest.approx((20.0, 20.0), abs=0.02)
    start_m = bench.x_m
    bench.run(1.0, (0.0, 0.0))
    assert bench.speeds() == pytest.approx((0.0, 0.0), abs=0.01)
    assert bench.x_m - start_m < 0.6**2 / (2 * 0.6), "braked, not coasted"
    bench.run(0.2, (1.0, 1.0))
    assert bench.speeds() == pytest.approx((0.0, 0.0), abs=0.01)
    assert bench.drive.counters["below_min_erpm"] > 0
    bench.device.device.take_frame(codec.set_rpm(10, 800), bench.now_ns)
    assert not bench.device.wheels.left.powered, "the device itself lets go"


@pytest.mark.parametrize(
    ("min_erpm", "erpm", "told", "counted"),
    [
        (900.0, 900.1, 900, 0),
        (900.0, -900.1, -900, 0),
        (900.0, 899.9, "brake", 1),
        (900.0, -899.9, "brake", 1),
        (900.0, 0.0, "brake", 0),
        (0.0, -0.0, "brake", 0),
        (0.0, 0.4, "brake", 1),
        (0.0, -0.6, -1, 0),
        (0.0, 1e12, 2_000_000_000, 0),
        (0.0, -1e12, -2_000_000_000, 0),
    ],
)
def test_what_a_wheel_is_told(min_erpm: float, erpm: float, told: int | str, counted: int) -> None:
    counters: Counter[str] = Counter()
    speed: Callable[[int], int | str] = lambda erpm: erpm  # noqa: E731
    setpoint = Setpoint(motor_of("left", 10, 7, 1.0, False), min_erpm, speed, "brake", counters)
    assert setpoint.of(erpm * math.tau / (60.0 * 7)) == told
    assert counters["below_min_erpm"] == counted


def test_pitfall_the_default_time_out_of_1_s_is_refused() -> None:
    with pytest.raises(Refused, match=r"1\.0 s exceeds safety\.watchdog_s"):
        Bench("vesc", watchdog_s=1.0).drive.configure()
    with pytest.raises(ValueError, match="VESC Tool"):
        Bench("vesc", watchdog_s=None)


def test_pitfall_only_setpoints_feed_the_time_out() -> None:
    bench = Bench("vesc")
    bench.start()
    bench.run(0.5, (10.0, 10.0))
    for _ in range(60):
        bench.device.device.take_frame(CanFrame(8 << 8 | 10, b"\0\0\4", True), bench.now_ns)
        bench.run(0.008)
    assert bench.device.counters["watchdog_expired"] == 2


def test_tachometer_wraps_without_a_jump() -> None:
    bench = Bench("vesc")
    for controller in bench.device.device.controllers:
        controller.shaft._start_turns = 2**31 / 42 - 0.5
    bench.start()
    feedback = bench.run(1.0, (10.0, 10.0))
    assert feedback is not None
    assert feedback.left_rad == pytest.approx(bench.device.wheels.left.angle_rad, abs=0.2)
    assert bench.host.pose(ROBOT)[0] > 20.1
