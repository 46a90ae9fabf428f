"""A body that comes back elsewhere than its wheels can have taken it, and what the others then keep clear of."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Safety
from contract.messages import BodyPose, MocapFrame
from onboard.jump import GAP_NS, MOST_ENTRIES, JumpCheck
from onboard.odometry import Odometry, Pose
from onboard.sensing import FORGET_NS, Sensing

MS = 1_000_000
SEPARATION_M = 0.11
SAFETY = Safety()
SPEED = st.floats(-0.8, 0.8)


def body(x_m: float, heading_rad: float = 0.0, valid: bool = True, resets: int = 0, y_m: float = 0.0) -> BodyPose:
    return BodyPose(robot="r01", x_m=x_m, y_m=y_m, heading_rad=heading_rad, valid=valid, resets=resets)


def driven(speed_mps: float, hidden_ms: int, back: BodyPose, active: bool = True) -> JumpCheck:
    """At the origin at 200 ms, then unseen for so long while the wheels go on at that speed."""
    check = JumpCheck(SAFETY, SEPARATION_M)
    for at_ms in range(0, 200 + hidden_ms, 10):
        check.feedback(at_ms * MS, speed_mps, speed_mps)
        known = at_ms <= 200
        check.see(body(speed_mps * (at_ms - 200) / 1000) if known else body(0.0, valid=False), at_ms * MS, active)
    check.see(back, (200 + hidden_ms) * MS, active)
    return check


@pytest.mark.parametrize(("way_m", "wrong"), [(0.0, False), (0.40, False), (0.62, True), (-0.62, True), (1.0, True)])
def test_a_body_comes_back_no_farther_than_its_wheels_rolled(way_m: float, wrong: bool) -> None:
    assert bool(driven(0.4, 1000, body(way_m)).text) == wrong


def test_the_threshold_is_the_arena_files() -> None:
    assert not driven(0.0, 500, body(SAFETY.motion_way_m / 2 - 0.001)).text
    assert "0.06 m away" in driven(0.0, 500, body(SAFETY.motion_way_m / 2 + 0.001)).text
    assert not driven(0.0, 500, body(0.0, SAFETY.motion_turn_rad / 2 - 0.01)).text
    assert "turned by" in driven(0.0, 500, body(0.0, SAFETY.motion_turn_rad / 2 + 0.01)).text
    assert not driven(0.0, 500, body(0.0, 2 * math.pi - 0.1)).text


def test_a_robot_without_power_may_be_put_anywhere() -> None:
    assert not driven(0.0, 500, body(2.0), active=False).text


@pytest.mark.parametrize("gap_ns", [10 * MS, GAP_NS, GAP_NS + 1])
@pytest.mark.parametrize("resets", [0, 1])
def test_two_poses_are_compared_after_a_gap_or_a_reset(gap_ns: int, resets: int) -> None:
    check = JumpCheck(SAFETY, SEPARATION_M)
    check.see(body(0.0), 100 * MS, True)
    check.see(body(0.5, resets=resets), 100 * MS + gap_ns, True)
    assert bool(check.text) == (bool(resets) or gap_ns > GAP_NS)


def test_a_restart_of_motion_capture_with_every_body_in_its_place_is_none() -> None:
    check = JumpCheck(SAFETY, SEPARATION_M)
    for resets in (3, 4, 0):
        check.see(None, 0, True)
        check.see(body(1.0, resets=resets), (resets + 1) * 500 * MS, True)
    assert not check.text


def test_what_was_wrong_stays_until_the_motors_are_disabled() -> None:
    check = driven(0.0, 100, body(1.0))
    words = check.text
    check.see(body(1.0), 400 * MS, True)
    check.see(body(1.0, valid=False), 410 * MS, True)
    check.see(body(1.0), 420 * MS, True)
    assert check.text == words != ""
    check.forget()
    assert not check.text
    check.see(body(3.0), 5000 * MS, True)
    assert not check.text, "what was before is not compared"


def test_feedback_that_is_missing_counts_as_the_faster_of_its_ends_and_does_not_run_backwards() -> None:
    check = JumpCheck(SAFETY, SEPARATION_M)
    check.feedback(0, 0.4, 0.4)
    check.see(body(0.0), 0, True)
    check.feedback(1000 * MS, 0.0, 0.0)
    check.feedback(500 * MS, 9.0, 9.0)
    check.see(body(0.4), 1000 * MS, True)
    assert not check.text
    check.see(body(0.6), 2000 * MS, True)
    assert check.text


def test_a_turn_while_feedback_is_missing_counts_too() -> None:
    check = JumpCheck(SAFETY, SEPARATION_M)
    check.feedback(0, -0.22, 0.22)
    check.see(body(0.0), 0, True)
    check.feedback(1000 * MS, 0.0, 0.0)
    check.see(body(0.0, 2.0), 1000 * MS, True)
    assert not check.text


def test_what_the_wheels_rolled_between_a_pose_and_its_arrival_counts() -> None:
    check = JumpCheck(SAFETY, SEPARATION_M)
    for at_ms in range(0, 1001, 10):
        check.feedback(at_ms * MS, 0.8, 0.8)
    check.see(body(0.0), 900 * MS, True)
    for at_ms in range(1010, 1200, 10):
        check.feedback(at_ms * MS, 0.0, 0.0)
    check.see(body(0.085, resets=1), 1200 * MS, True)
    assert not check.text


def test_a_long_occlusion_keeps_no_more_than_it_needs() -> None:
    assert not driven(0.1, 20_000, body(2.0)).text
    assert driven(0.1, 20_000, body(2.7)).text
    check = JumpCheck(SAFETY, SEPARATION_M)
    check.see(body(0.0), 0, True)
    for at_ms in range(2000):
        check.feedback(at_ms * MS, 0.1, 0.1)
        assert len(check._rolled) <= MOST_ENTRIES
    check.see(body(0.3, resets=1), 2000 * MS, True)
    assert not check.text, "the first entry is the last to go"


@given(st.lists(st.tuples(SPEED, SPEED), min_size=1, max_size=30), st.integers(0, 25))
def test_no_body_that_follows_its_wheels_has_jumped(rims: list[tuple[float, float]], hidden_from: int) -> None:
    check, odometry, pose = JumpCheck(SAFETY, SEPARATION_M), Odometry(SEPARATION_M, 10.0), Pose(0.0, 0.0, 0.0)
    for k, (left, right) in enumerate([*rims, rims[-1]]):
        stamp_ns = k * 40 * MS
        check.feedback(stamp_ns, left, right)
        odometry.record(stamp_ns, left, right)
        if k:
            pose = odometry.predict(pose, stamp_ns - 40 * MS, stamp_ns)
        seen = k <= hidden_from or k == len(rims)
        place = body(pose.x_m, math.remainder(pose.heading_rad, math.tau), valid=seen, y_m=pose.y_m)
        check.see(place, stamp_ns, True)
        assert not check.text


# --- the others ---------------------------------------------------------------------------------------------------


def frame(at_ms: int, other: BodyPose) -> MocapFrame:
    return MocapFrame(
        session=1, frame=at_ms, exposure_ns=at_ms * MS, transmit_ns=at_ms * MS, publish_ns=at_ms * MS, rate_hz=100.0,
        bodies=(BodyPose(robot="r00", x_m=0.0, y_m=0.0, heading_rad=0.0), other),
    )  # fmt: skip


def watched(back: BodyPose, hidden_ms: int = 60, speed_mps: float = 0.4) -> Sensing:
    """Another robot on its way along x, seen at 0.5 m at 200 ms, unseen for so long, then back."""
    sensing = Sensing("r00", 1.0, 0.5, 0.8, 0.06)
    for at_ms in range(0, 201, 10):
        sensing.frame(frame(at_ms, body(0.5 + speed_mps * (at_ms - 200) / 1000)))
    for at_ms in range(210, 200 + hidden_ms, 10):
        sensing.frame(frame(at_ms, body(0.5, valid=False)))
    sensing.frame(frame(200 + hidden_ms, back))
    return sensing


@pytest.mark.parametrize(("x_m", "kept"), [(0.524, False), (0.61, False), (0.63, True), (1.0, True), (0.0, True)])
def test_where_a_robot_was_before_it_jumped_is_kept_clear(x_m: float, kept: bool) -> None:
    sensing = watched(body(x_m, resets=1))
    places = sensing.left(300 * MS, frozenset())
    assert bool(places) == kept
    seen = sensing.sighted(Pose(0.0, 0.0, 0.0), 300 * MS)["r01"]
    assert seen.x_m == x_m
    if kept:
        assert places[0].robot == "r01"
        assert not places[0].linked
        x, y, vx, vy, age_s, _ = places[0].seen
        assert (x, y, vx, vy, age_s) == pytest.approx((0.5, 0.0, 0.4, 0.0, 0.1))
        assert (seen.vx_mps, seen.vy_mps) == (0.0, 0.0), "no robot is as fast as a jump"


def test_a_place_is_kept_until_the_robot_is_excluded_or_this_one_released() -> None:
    sensing = watched(body(1.0, resets=1))
    later_ns = 3_600_000 * MS
    assert sensing.left(later_ns, frozenset({"r09"}))
    assert not sensing.left(later_ns, frozenset({"r01"}))
    assert not sensing.left(later_ns, frozenset())
    sensing = watched(body(1.0, resets=1))
    sensing.settle()
    assert not sensing.left(later_ns, frozenset())


def test_every_place_of_a_robot_that_jumps_again_is_kept_up_to_a_few() -> None:
    sensing = watched(body(1.0, resets=1))
    for k in range(2, 9):
        sensing.frame(frame(300 + 10 * k, body(0.1 * k, resets=k, y_m=(-1.0) ** k)))
    assert [round(place.seen.x_m, 3) for place in sensing.left(400 * MS, frozenset())] == [0.4, 0.5, 0.6, 0.7]


def test_a_robot_not_seen_for_long_may_be_anywhere() -> None:
    assert watched(body(5.0, resets=1), FORGET_NS // MS).left(9_000 * MS, frozenset())
    assert not watched(body(5.0, resets=1), FORGET_NS // MS + 10).left(9_000 * MS, frozenset())
