"""What wheels say against what a body does: every kind of disagreement, and none where they agree."""

import math
import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Safety
from onboard.motion import TEXT, Kind, MotionCheck
from onboard.odometry import Pose, advance

MS = 1_000_000
SEPARATION_M = 0.11
SAFETY = Safety()
Rims = tuple[float, float]


class Robot:
    """Wheels that do as they are told, a body that does what ``body`` makes of it, cameras that see it late."""

    def __init__(self, body: Callable[[Rims], tuple[float, float, float]], noise_m: float = 0.0025) -> None:
        self.check = MotionCheck(SAFETY, SEPARATION_M)
        self.body = body
        self.noise_m = noise_m
        self.draw = random.Random(1)
        self.pose = Pose(1.0, 1.0, 0.4)
        self.now = 1_000 * MS
        self.kinds: list[str] = []

    def drive(self, seconds: float, said: Rims, done: Rims | None = None) -> str:
        """:param said: what the wheels report; ``done``: what was commanded, the same where None."""
        gauss = self.draw.gauss
        for step in range(round(seconds * 100)):
            self.now += 10 * MS
            self.check.command(*(said if done is None else done))
            before = self.pose
            forward, left, turn = self.body(said)
            self.pose = advance(self.pose, forward, turn, 0.01)
            x = self.pose.x_m - left * 0.01 * math.sin(self.pose.heading_rad)
            y = self.pose.y_m + left * 0.01 * math.cos(self.pose.heading_rad)
            self.pose = Pose(x, y, self.pose.heading_rad)
            self.check.feedback(self.now - 4 * MS, *said)
            if step:
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


def test_a_body_whose_origin_is_off_the_axle_is_no_fault() -> None:
    robot = Robot(lambda rims: (honest(rims)[0], 0.02 * honest(rims)[2], honest(rims)[2]))
    for rims in (CURVE, SPOT, (0.5, 0.1), (-0.1, 0.4)):
        robot.drive(1.5, rims)
    assert set(robot.kinds) == {""}


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
    check = MotionCheck(SAFETY, SEPARATION_M)
    for step in range(300):
        check.pose(step * 10 * MS, Pose(0.01 * step, 0.0, 0.0))
    check.feedback(100 * MS, 0.0, 0.0)
    check.feedback(100 * MS, 5.0, 5.0)
    for step in range(30, 300):
        check.pose(step * 10 * MS, Pose(0.01 * step, 0.0, 0.0))
    assert check.kind == ""
