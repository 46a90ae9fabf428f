import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.conversion import Odometer, WheelScale, saturate

SPEED = st.floats(-100.0, 100.0)


@given(units=st.floats(0.5, 1e5), gear=st.floats(0.1, 100.0), inverted=st.booleans(), radps=SPEED)
def test_scale_round_trip(units: float, gear: float, inverted: bool, radps: float) -> None:
    scale = WheelScale.of(units, gear, inverted)
    assert scale.to_wheel(scale.to_device(radps)) == pytest.approx(radps, rel=1e-12, abs=1e-12)
    assert (scale.units_per_rad < 0) is inverted


def test_one_wheel_turn_is_gear_motor_turns() -> None:
    assert WheelScale.of(2048.0, 7.0, False).to_device(2 * math.pi) == pytest.approx(2048 * 7)


@given(left=SPEED, right=SPEED, limit=st.floats(0.1, 50.0))
def test_saturation_keeps_curvature(left: float, right: float, limit: float) -> None:
    a, b = saturate(left, right, limit)
    assert max(abs(a), abs(b)) <= limit * (1 + 1e-12)
    assert a * right == pytest.approx(b * left, rel=1e-9, abs=1e-9)
    if max(abs(left), abs(right)) <= limit:
        assert (a, b) == (left, right)


@given(start=st.integers(0, 2**32 - 1), steps=st.lists(st.integers(-(2**31) + 1, 2**31 - 1), max_size=20))
def test_unwrapped_odometry_follows_any_path(start: int, steps: list[int]) -> None:
    odometer = Odometer(WheelScale(100.0), 32)
    odometer.update(start)
    position = start
    for step in steps:
        position += step
        odometer.update(position % 2**32)
    assert odometer.angle_rad == pytest.approx((position - start) / 100.0)


def test_the_first_reading_is_zero_and_a_restart_keeps_the_angle() -> None:
    odometer = Odometer(WheelScale(-2.0))
    assert odometer.update(50.0) == 0.0
    assert odometer.update(52.0) == -1.0
    odometer.restart()
    assert odometer.update(0.0) == -1.0
    assert odometer.update(4.0) == -3.0
