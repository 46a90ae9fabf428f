import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Platform
from drivers.mock.body import Body
from drivers.mock.motor import Motor, MotorLimits, Shaft

LIMITS = MotorLimits(lag_s=0.1, acceleration_radps2=60.0, coast_radps2=20.0)


@given(
    command=st.floats(-40.0, 40.0),
    start=st.floats(-40.0, 40.0),
    powered=st.booleans(),
    cuts=st.lists(st.floats(0.0, 0.3), min_size=1, max_size=8),
)
def test_the_result_does_not_depend_on_the_steps(
    command: float, start: float, powered: bool, cuts: list[float]
) -> None:
    motors = [Motor(LIMITS), Motor(LIMITS)]
    for motor in motors:
        motor.radps = start
        motor.drive(command)
        if not powered:
            motor.release()
    motors[0].advance(sum(cuts))
    for cut in cuts:
        motors[1].advance(cut)
    assert motors[1].radps == pytest.approx(motors[0].radps, abs=1e-9)
    assert motors[1].angle_rad == pytest.approx(motors[0].angle_rad, abs=1e-9)


@given(command=st.floats(-40.0, 40.0), start=st.floats(-40.0, 40.0), lag=st.sampled_from([0.0, 0.05, 0.15]))
def test_closed_form_agrees_with_fine_integration(command: float, start: float, lag: float) -> None:
    limits = LIMITS._replace(lag_s=lag)
    motor = Motor(limits)
    motor.radps = start
    motor.drive(command)
    motor.advance(0.4)
    speed, angle, dt = start, 0.0, 1e-4
    for _ in range(4000):
        wanted = (command - speed) / max(lag, dt)
        change = max(-limits.acceleration_radps2, min(limits.acceleration_radps2, wanted)) * dt
        angle += (speed + 0.5 * change) * dt
        speed += change
    assert motor.radps == pytest.approx(speed, abs=0.02)
    assert motor.angle_rad == pytest.approx(angle, abs=0.02)


def test_a_released_motor_coasts_v_squared_over_2a() -> None:
    motor = Motor(LIMITS)
    motor.radps = 10.0
    motor.release()
    motor.advance(5.0)
    assert motor.radps == 0.0
    assert motor.angle_rad == pytest.approx(10.0**2 / (2 * 20.0))


def test_without_supply_it_coasts_whatever_is_commanded_and_stuck_stands() -> None:
    motor = Motor(LIMITS)
    motor.radps, motor.supplied = 10.0, False
    motor.drive(10.0)
    motor.advance(0.25)
    assert motor.radps == pytest.approx(5.0)
    motor.stuck = True
    motor.advance(0.1)
    assert motor.radps == 0.0


@given(gear=st.floats(0.5, 50.0), inverted=st.booleans(), turns=st.floats(-5.0, 5.0))
def test_shaft_turns_gear_times_the_wheel(gear: float, inverted: bool, turns: float) -> None:
    motor = Motor(LIMITS)
    shaft = Shaft(motor, gear, inverted)
    shaft.drive(turns)
    assert motor.command_radps * gear == pytest.approx(turns * 2 * math.pi * (-1 if inverted else 1), abs=1e-9) or (
        abs(motor.command_radps) == LIMITS.max_radps
    )
    motor.angle_rad = 2 * math.pi
    assert shaft.turns == pytest.approx(-gear if inverted else gear)


def test_body_drives_straight_turns_in_place_and_closes_a_circle() -> None:
    platform = Platform()
    body = Body(platform, (1.0, 1.0), 0.0)
    body.roll(10.0, 10.0)
    assert (body.x_m, body.y_m, body.heading_rad) == pytest.approx((1.3, 1.0, 0.0))
    turn = math.pi * platform.wheel_separation_m / platform.wheel_radius_m
    body.roll(10.0 - turn / 2, 10.0 + turn / 2)
    assert (body.x_m, body.y_m, abs(body.heading_rad)) == pytest.approx((1.3, 1.0, math.pi))
    circle = Body(platform, (0.0, 0.0), 0.5)
    for step in range(1, 101):
        circle.roll(0.0, step / 100 * 2 * turn)
    assert (circle.x_m, circle.y_m) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert circle.heading_rad == pytest.approx(0.5)
