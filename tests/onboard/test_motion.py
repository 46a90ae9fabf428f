"""What wheels say against what a body does: every kind of disagreement, and none where they agree."""

import math
import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from contract.arena import Arena, FieldControl, Floor, Safety
from onboard.expected import Expected, Plant, slowest
from onboard.limits import respond
from onboard.motion import TEXT, Kind, MotionCheck
from onboard.odometry import Pose, advance

MS = 1_000_000
SEPARATION_M = 0.11
SAFETY = Safety()
WEAK_MPS2, STRONG_MPS2 = FieldControl().brake_deceleration_mps2
SHORT_S, LONG_S = FieldControl().motor_lag_s
SLOW = Plant(WEAK_MPS2, LONG_S)
Rims = tuple[float, float]


class Robot:
    """Wheels that do as they are told, a body that does what ``body`` makes of it, cameras that see it late."""

    def __init__(
        self, body: Callable[[Rims], tuple[float, float, float]], noise_m: float = 0.0025, late_ns: int = 4 * MS
    ) -> None:
        self.check = MotionCheck(SAFETY, SEPARATION_M, SLOW)
        self.body = body
        self.noise_m = noise_m
        self.late_ns = late_ns
        """What feedback's stamps are behind poses' by."""
        self.draw = random.Random(1)
        self.pose = Pose(1.0, 1.0, 0.4)
        self.now = 1_000 * MS
        self.kinds: list[str] = []

    def drive(self, seconds: float, said: Rims, done: Rims | None = None) -> str:
        """:param said: what the wheels report; ``done``: what was commanded, the same where None."""
        gauss = self.draw.gauss
        for _ in range(round(seconds * 100)):
            self.now += 10 * MS
            self.check.command(*(said if done is None else done))
            before = self.pose
            forward, left, turn = self.body(said)
            self.pose = advance(self.pose, forward, turn, 0.01)
            x = self.pose.x_m - left * 0.01 * math.sin(self.pose.heading_rad)
            y = self.pose.y_m + left * 0.01 * math.cos(self.pose.heading_rad)
            self.pose = Pose(x, y, self.pose.heading_rad)
            self.check.feedback(self.now - self.late_ns, *said)
            seen = Pose(
                before.x_m + gauss(0.0, self.noise_m),
                before.y_m + gauss(0.0, self.noise_m),
                math.remainder(before.heading_rad + gauss(0.0, 6 * self.noise_m), math.tau),
            )
            self.check.pose(self.now - 10 * MS, seen)
            self.kinds.append(self.check.kind)
        return self.check.kind


def honest(rims: Rims) -> tuple[float, float, float]:
    return (rims[0] + rims[1]) / 2, 0.0, (rims[1] - rims[0]) / SEPARATION_M


AHEAD: Rims = (0.3, 0.3)
SPOT: Rims = (-0.15, 0.15)
CURVE: Rims = (0.2, 0.4)
CASES: dict[str, tuple[Callable[[Rims], tuple[float, float, float]], Rims, Kind]] = {
    "lifted, ahead": (lambda rims: (0.0, 0.0, 0.0), AHEAD, "lifted"),
    "lifted, turning": (lambda rims: (0.0, 0.0, 0.0), SPOT, "lifted"),
    "slipping": (lambda rims: (0.2 * honest(rims)[0], 0.0, honest(rims)[2]), AHEAD, "lifted"),
    "inverted heading": (lambda rims: (-honest(rims)[0], 0.0, honest(rims)[2]), CURVE, "inverted heading"),
    "inverted wheels": (lambda rims: (-honest(rims)[0], 0.0, -honest(rims)[2]), CURVE, "inverted wheels"),
    "heading 1 rad off": (
        lambda rims: (math.cos(1.0) * honest(rims)[0], math.sin(1.0) * honest(rims)[0], honest(rims)[2]),
        AHEAD,
        "sideways",
    ),
    "quarter off": (lambda rims: (0.0, honest(rims)[0], honest(rims)[2]), AHEAD, "sideways"),
    "swapped, on the spot": (lambda rims: (0.0, 0.0, -honest(rims)[2]), SPOT, "swapped wheels"),
    "swapped, on a curve": (lambda rims: (honest(rims)[0], 0.0, -honest(rims)[2]), CURVE, "swapped wheels"),
    "another's body": (lambda rims: (0.4, 0.0, 0.0), (0.0, 0.0), "wrong body"),
}


@pytest.mark.parametrize("case", CASES)
def test_each_kind_is_named_within_the_window(case: str) -> None:
    body, rims, kind = CASES[case]
    robot = Robot(body)
    robot.drive(SAFETY.motion_window_s + 0.3, rims)
    assert robot.check.kind == kind
    assert robot.check.text == TEXT[kind] != ""
    assert set(robot.kinds) == {"", kind}


@pytest.mark.parametrize("stuck", [(0.0, 0.0), (0.0, 0.3), (0.3, 0.0)])
def test_a_commanded_wheel_that_does_not_turn_is_stuck(stuck: Rims) -> None:
    robot = Robot(honest)
    robot.drive(SAFETY.motion_window_s + 0.5, stuck, done=(0.3, 0.3))
    assert robot.check.kind == "stuck"


@pytest.mark.parametrize("rims", [AHEAD, SPOT, CURVE, (-0.3, -0.2), (0.8, 0.8), (0.02, 0.02), (0.0, 0.0), (0.6, -0.1)])
def test_wheels_and_body_that_agree_are_never_a_fault(rims: Rims) -> None:
    robot = Robot(honest)
    robot.drive(3.0, rims)
    assert set(robot.kinds) == {""}


@given(st.lists(st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.integers(5, 60)), min_size=1, max_size=8))
def test_no_drive_of_an_honest_robot_trips_it(legs: list[tuple[float, float, int]]) -> None:
    robot = Robot(honest)
    for left, right, steps in legs:
        robot.drive(steps / 100, (left, right))
    assert set(robot.kinds) == {""}


class Wheel:
    """A calibrated one: hears each command ``late`` periods after it was given."""

    def __init__(self, share: float, lag_share: float, late: int) -> None:
        self.plant = (WEAK_MPS2 + share * (STRONG_MPS2 - WEAK_MPS2), SHORT_S + lag_share * (LONG_S - SHORT_S))
        self.waiting = [0.0] * late
        self.speed_mps = 0.0

    def turn(self, command_mps: float) -> float:
        """The mean speed over a period."""
        self.waiting.append(command_mps)
        way_m, self.speed_mps = respond(self.speed_mps, self.waiting.pop(0), 0.01, *self.plant)
        return way_m / 0.01


COMMANDS = st.lists(st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.integers(1, 40)), min_size=1, max_size=12)
SHARES = st.floats(0.0, 1.0)
WHEELS = st.builds(Wheel, SHARES, SHARES, st.integers(0, 3))


@given(COMMANDS, WHEELS, WHEELS, st.integers(-20, 40))
def test_no_calibrated_wheel_is_ever_at_fault(
    legs: list[tuple[float, float, int]], left: Wheel, right: Wheel, late_ms: int
) -> None:
    robot = Robot(honest, late_ns=late_ms * MS)
    for _ in range(2):
        for left_mps, right_mps, steps in legs:
            for _ in range(steps):
                robot.drive(0.01, (left.turn(left_mps), right.turn(right_mps)), done=(left_mps, right_mps))
    assert set(robot.kinds) == {""}


@pytest.mark.parametrize("half_s", [0.04, 0.06, 0.2])
def test_a_slow_wheel_told_to_go_back_and_forth_is_not_stuck(half_s: float) -> None:
    robot, wheel = Robot(honest), Wheel(0.0, 1.0, 2)
    for turn in range(round(4.0 / half_s)):
        command = 0.35 if turn % 2 else -0.35
        for _ in range(round(half_s * 100) if turn else round(half_s * 50)):
            speed = wheel.turn(command)
            robot.drive(0.01, (speed, speed), done=(command, command))
    assert set(robot.kinds) == {""}


@pytest.mark.parametrize("half_steps", [80, 1000])
def test_a_jammed_wheel_is_named_though_its_commands_change_direction(half_steps: int) -> None:
    check = MotionCheck(SAFETY, SEPARATION_M, SLOW)
    for step in range(200):
        now = step * 10 * MS
        command = 0.5 if step // half_steps % 2 else -0.5
        check.command(command, 0.3)
        check.feedback(now, 0.0, 0.3)
        check.pose(now, Pose(0.0, 0.0, 0.0))
    assert check.kind == "stuck"


def test_a_wheel_is_expected_to_roll_only_where_the_slowest_has_turned_round() -> None:
    rim = Expected(SLOW)
    assert rim.roll(0.3, 3.0) == pytest.approx(
        0.9 - 0.3 * LONG_S - (0.3 - WEAK_MPS2 * LONG_S) ** 2 / (2 * WEAK_MPS2), abs=1e-3
    )
    assert rim.speed_mps == pytest.approx(0.3, abs=1e-6)
    assert (rim.roll(-0.5, 0.1), rim.speed_mps) == (0.0, 0.0), "still rolling ahead"
    assert 0.0 < rim.roll(-0.5, 3.0) < 1.5
    assert rim.speed_mps == pytest.approx(0.5, abs=1e-6)
    assert (rim.roll(0.0, 1.0), rim.speed_mps) == (0.0, 0.0), "one that stops at once"


def test_the_slowest_wheel_is_that_of_the_arena_file_and_of_the_last_gate() -> None:
    arena = Arena(Floor("bench", (4.0, 4.0)), {})
    assert slowest(arena) == SLOW
    slowed = structs.replace(arena, safety=structs.replace(SAFETY, max_slew_mps2=0.5))
    assert slowest(slowed) == (0.5, LONG_S)


@given(st.floats(0.02, 3.0), st.floats(0.0, 0.8), st.floats(-0.8, 0.8))
def test_a_process_that_hung_blames_no_wheel(hung_s: float, before_mps: float, after_mps: float) -> None:
    """Its last command stands until the controller's watchdog lets go, then the body coasts; nobody writes it down."""
    robot = Robot(honest)
    robot.drive(1.0, (before_mps, before_mps))
    speed, left = before_mps, hung_s
    while left > 0.0:
        speed = before_mps if hung_s - left < 0.2 else max(0.0, speed - 0.6 * 0.01)
        robot.pose = advance(robot.pose, speed, 0.0, min(left, 0.01))
        left -= 0.01
    robot.now += round(hung_s * 1e9)
    for _ in range(200):
        speed += max(-0.02, min(0.02, after_mps - speed))
        robot.drive(0.01, (speed, speed), done=(after_mps, after_mps))
    assert set(robot.kinds) == {""}


def test_a_body_whose_origin_is_off_the_axle_is_no_fault() -> None:
    robot = Robot(lambda rims: (honest(rims)[0], 0.02 * honest(rims)[2], honest(rims)[2]))
    for rims in (CURVE, SPOT, (0.5, 0.1), (-0.1, 0.4)):
        robot.drive(1.5, rims)
    assert set(robot.kinds) == {""}


@pytest.mark.parametrize("rims", [AHEAD, SPOT, (0.7, 0.6), (0.16, 0.16)])
def test_encoders_that_begin_to_count_backwards_are_named_before_they_are_most_of_the_window(rims: Rims) -> None:
    robot = Robot(lambda said: honest(rims))
    robot.drive(1.5, rims)
    assert set(robot.kinds) == {""}
    assert robot.drive(0.6 * SAFETY.motion_window_s, (-rims[0], -rims[1]), done=rims)
    assert robot.drive(SAFETY.motion_window_s, (-rims[0], -rims[1]), done=rims)


def test_it_clears_with_standing_still_and_begins_anew_when_told() -> None:
    body, rims, kind = CASES["lifted, ahead"]
    robot = Robot(body)
    assert robot.drive(2.0, rims) == kind
    assert robot.drive(SAFETY.motion_window_s + 0.2, (0.0, 0.0)) == ""
    assert robot.drive(2.0, rims) == kind
    robot.check.forget()
    assert robot.check.kind == ""
    robot.drive(SAFETY.motion_window_s - 0.1, rims)
    assert robot.check.kind == "", "nothing before it counts"


def test_without_feedback_or_with_old_feedback_it_says_nothing() -> None:
    check = MotionCheck(SAFETY, SEPARATION_M, SLOW)
    for step in range(300):
        check.pose(step * 10 * MS, Pose(0.01 * step, 0.0, 0.0))
    check.feedback(100 * MS, 0.0, 0.0)
    check.feedback(100 * MS, 5.0, 5.0)
    for step in range(30, 300):
        check.pose(step * 10 * MS, Pose(0.01 * step, 0.0, 0.0))
    assert check.kind == ""
