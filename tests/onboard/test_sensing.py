"""The veil: nothing from farther away than r_c changes what a robot sees, hears or decides."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.messages import BodyPose, MocapFrame, Target, TargetCloud
from onboard.ahdc.view import Sighted
from onboard.odometry import Odometry, Pose, advance
from onboard.sensing import STUCK_NS, Sensing
from tests.onboard.samples import state

MS = 1_000_000


def frame(number: int, poses: dict[str, tuple[float, float]], invalid: tuple[str, ...] = ()) -> MocapFrame:
    return MocapFrame(
        session=1,
        frame=number,
        exposure_ns=number * 10 * MS,
        transmit_ns=number * 10 * MS,
        publish_ns=number * 10 * MS,
        rate_hz=100.0,
        bodies=tuple(
            BodyPose(robot=name, x_m=x, y_m=y, heading_rad=0.0, valid=name not in invalid)
            for name, (x, y) in poses.items()
        ),
    )


@given(st.floats(0, 3), st.floats(-math.pi, math.pi))
def test_only_robots_messages_and_targets_within_range_are_known(distance: float, bearing: float) -> None:
    other = (distance * math.cos(bearing), distance * math.sin(bearing))
    sensing = Sensing("r01", 1.0, 0.5)
    sensing.frame(frame(1, {"r01": (0.0, 0.0), "r02": other}))
    sensing.cloud(TargetCloud(mission="m", targets=(Target(index=0, x_m=other[0], y_m=other[1]),)))
    inside = math.hypot(*other) <= 1.0
    own = Pose(0.0, 0.0, 0.0)
    sighted = sensing.sighted(own, 10 * MS)
    assert (set(sighted) == {"r02"}) == inside
    assert sensing.state(state("r02", *other), 10 * MS) == inside
    assert (set(sensing.heard(sighted, 10 * MS)) == {"r02"}) == inside
    assert sensing.out_of_range == (0 if inside else 1)
    if abs(math.hypot(*other) - 1.0) > 1e-9:
        assert (set(sensing.targets(own)) == {0}) == inside


def test_old_repeated_and_reordered_messages_are_not_heard_again() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    sensing.frame(frame(1, {"r01": (0.0, 0.0), "r02": (0.5, 0.0)}))
    assert sensing.state(state("r02", seq=5), 0)
    assert not sensing.state(state("r02", seq=5), 0)
    assert not sensing.state(state("r02", seq=4), 0)
    assert sensing.state(state("r02", seq=1, boot=2), 0)


def test_robots_out_of_reach_are_told_by_where_they_were_last_seen() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    names = ("r02", "r03", "r04", "r05")
    assert sensing.beyond(names) == []
    places = {"r01": (1.0, 1.0), "r02": (1.6, 1.8), "r03": (1.61, 1.8), "r04": (-1.0, 1.0)}
    sensing.frame(frame(1, places))
    sensing.frame(frame(2, places, invalid=("r04",)))
    assert sensing.beyond(names) == ["r03", "r04"]
    assert sensing.beyond(("r02",)) == []


def test_where_a_linked_robot_was_within_reach_is_forgotten_with_the_release() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    own = Pose(0.0, 0.0, 0.0)
    for number, x in ((1, 0.99), (2, 1.01)):
        sensing.frame(frame(number, {"r01": (0.0, 0.0), "r02": (x, 0.0)}), {"r02"})
        assert sensing.sighted(own, 10 * number * MS, {"r02"})["r02"].x_m == 0.99
    sensing.settle()
    assert sensing.sighted(own, 20 * MS, {"r02"}) == {}


def test_an_occluded_robot_stays_where_it_was_last_seen_and_is_marked() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    places = {"r01": (0.0, 0.0), "r02": (0.5, 0.0)}
    sensing.frame(frame(1, places))
    sensing.frame(frame(2, places | {"r02": (0.9, 0.9)}, invalid=("r02",)))
    seen = sensing.sighted(Pose(0.0, 0.0, 0.0), 20 * MS)["r02"]
    assert (seen.x_m, seen.y_m, seen.valid) == (0.5, 0.0, False)
    assert seen.age_s == pytest.approx(0.010)


def test_a_linked_robot_that_is_not_seen_stays_in_view_however_far_it_was_last() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    places = {"r01": (0.0, 0.0), "r02": (0.9, 0.0), "r03": (0.9, 0.1)}
    sensing.frame(frame(1, places))
    sensing.frame(frame(2, places, invalid=("r02", "r03")))
    gone_on = Pose(-0.2, 0.0, 0.0)
    assert set(sensing.sighted(gone_on, 20 * MS, {"r02"})) == {"r02"}
    assert not sensing.sighted(gone_on, 20 * MS)
    assert set(sensing.sighted(gone_on, 20_000 * MS, {"r02"})) == {"r02"}
    sensing.frame(frame(3, places | {"r02": (0.95, 0.0)}))
    assert not sensing.sighted(gone_on, 30 * MS), "seen to be out of reach"
    last = sensing.sighted(gone_on, 30 * MS, {"r02"})
    assert list(last) == ["r02"]
    assert (last["r02"].x_m, last["r02"].valid) == (0.9, False), "where it was within"
    assert sensing.sighted(gone_on, 60 * MS, {"r02"})["r02"].age_s == pytest.approx(last["r02"].age_s + 0.03)
    assert sensing.sighted(Pose(0.0, 0.0, 0.0), 60 * MS, {"r02"})["r02"].x_m == 0.95


@pytest.mark.parametrize("seen_at_m", [0.4, 1.8])
@pytest.mark.parametrize("linked", [True, False])
def test_a_robot_that_has_jumped_was_linked_where_it_was_until_it_is_taken_out(seen_at_m: float, linked: bool) -> None:
    sensing, links = Sensing("r01", 1.0, 0.5), {"r02"} if linked else ()
    sensing.frame(frame(1, {"r01": (0.0, 0.0), "r02": (0.9, 0.0)}), links)
    sensing.frame(frame(31, {"r01": (0.0, 0.0), "r02": (seen_at_m, 0.0)}), links)
    own, now_ns = Pose(0.0, 0.0, 0.0), 320 * MS
    assert [seen.x_m for seen in sensing.sighted(own, now_ns, links).values()] == [0.4] * (seen_at_m < 1.0)
    assert sensing.left(now_ns, ()) == [("r02", Sighted(0.9, 0.0, 0.0, 0.0, 0.31, False), linked)]
    sensing.frame(frame(32, {"r01": (0.0, 0.0), "r02": (seen_at_m, 0.0)}), {"r02"})
    assert sensing.left(now_ns, ())[0].linked == linked, "a link made since is not of that place"
    assert sensing.left(now_ns, {"r02"}) == []


def test_a_linked_robot_that_comes_back_elsewhere_was_where_it_was_however_long_ago() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    sensing.frame(frame(1, {"r01": (0.0, 0.0), "r02": (0.9, 0.0), "r03": (0.8, 0.0)}), {"r02"})
    sensing.frame(frame(2_000, {"r01": (0.0, 0.0), "r02": (0.0, 30.0), "r03": (0.0, -30.0)}), {"r02"})
    assert [left.robot for left in sensing.left(20_000 * MS, ())] == ["r02"]


def test_a_robot_that_is_not_seen_is_heard_where_it_says_it_is() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    places = {"r01": (0.0, 0.0), "r02": (0.9, 0.0)}
    sensing.frame(frame(1, places))
    sensing.frame(frame(2, {**places, "r01": (-0.2, 0.0)}, invalid=("r02",)))
    assert sensing.in_range("r02"), "worth decoding"
    assert sensing.state(state("r02", 0.7, 0.0, seq=2), 0)
    assert not sensing.state(state("r02", 0.81, 0.0, seq=3), 0)
    sensing.frame(frame(3, {**places, "r01": (-0.2, 0.0)}))
    assert not sensing.in_range("r02")
    assert not sensing.state(state("r02", 0.7, 0.0, seq=4), 0), "seen: what it says does not count"


def test_an_own_pose_that_repeats_itself_is_as_old_as_its_first_frame() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    for number in range(60):
        x_m, first = (0.0, 0) if number < 10 else (1.0, 10)
        sensing.frame(frame(number, {"r01": (x_m, 0.0)}))
        assert sensing.own() == (Pose(x_m, 0.0, 0.0), number * 10 * MS)
        assert sensing.own_since_ns == max(first * 10 * MS, number * 10 * MS - STUCK_NS)


def test_velocity_comes_from_poses() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    for k in range(1, 12):
        sensing.frame(frame(k, {"r01": (0.0, 0.0), "r02": (0.004 * k, -0.002 * k)}))
    seen = sensing.sighted(Pose(0.0, 0.0, 0.0), 110 * MS)["r02"]
    assert (seen.vx_mps, seen.vy_mps) == pytest.approx((0.4, -0.2))


def test_silence_is_marked() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    sensing.frame(frame(1, {"r01": (0.0, 0.0), "r02": (0.5, 0.0)}))
    sensing.state(state("r02"), 10 * MS)
    assert not sensing.heard(["r02"], 500 * MS)["r02"].silent
    assert sensing.heard(["r02"], 520 * MS)["r02"].silent


speeds = st.floats(-0.8, 0.8)


@given(speeds, speeds, st.integers(1, 400), st.integers(1, 400))
def test_dead_reckoning_at_constant_speed_is_the_exact_arc(
    left: float, right: float, first_ms: int, more_ms: int
) -> None:
    odometry = Odometry(0.11)
    for k in range(0, first_ms + more_ms + 10, 10):
        odometry.record((k + 1) * MS, left, right)
    start = Pose(1.0, 2.0, 0.5)
    moved = odometry.predict(start, first_ms * MS, (first_ms + more_ms) * MS)
    exact = advance(start, (left + right) / 2, (right - left) / 0.11, more_ms * 1e-3)
    assert moved == pytest.approx(exact, abs=1e-6)


def test_dead_reckoning_without_measurements_stays() -> None:
    assert Odometry(0.11).predict(Pose(1.0, 2.0, 3.0), 0, 10**9) == Pose(1.0, 2.0, 3.0)


@given(st.lists(st.floats(-0.8, 0.8), min_size=3, max_size=6), st.floats(0.0, 4.0))
def test_wheels_count_for_as_long_as_the_own_pose_is_missing(speeds: list[float], rest_s: float) -> None:
    """Against one history that forgets nothing; asked every 10 ms, as a robot does."""
    short, long = Odometry(0.11), Odometry(0.11, horizon_s=100.0)
    rims = [(speed, speed * 0.7) for speed in speeds for _ in range(30)] + [(0.0, 0.0)] * int(rest_s * 100)
    pose = Pose(1.0, 2.0, 0.5)
    for step, (left, right) in enumerate(rims):
        for odometry in (short, long):
            odometry.record(step * 10 * MS, left, right)
        told = short.predict(pose, 0, step * 10 * MS + 3 * MS)
    truth = long.predict(pose, 0, (len(rims) - 1) * 10 * MS + 3 * MS)
    assert math.dist(told[:2], truth[:2]) < 1e-3
    assert abs(told.heading_rad - truth.heading_rad) < 0.02


def test_what_is_remembered_of_one_pose_is_not_used_for_another() -> None:
    odometry = Odometry(0.11)
    for step in range(200):
        odometry.record(step * 10 * MS, 0.4, 0.4)
        odometry.predict(Pose(0.0, 0.0, 0.0), 0, step * 10 * MS)
    there = odometry.predict(Pose(5.0, 0.0, 0.0), 0, 1990 * MS)
    assert there.x_m > 5.0
    fresh = odometry.predict(Pose(5.0, 0.0, 0.0), 1980 * MS, 1990 * MS)
    assert fresh.x_m == pytest.approx(5.004)


def test_a_new_mission_voids_what_was_heard_of_the_old_ones_targets() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    sensing.frame(frame(1, {"r01": (0.0, 0.0), "r02": (0.5, 0.0)}))
    targets = (Target(index=0, x_m=0.5, y_m=0.5),)
    told = {"task": "tracking", "claim": 0, "claim_at": (0.5, 0.5), "occupied": "1", "cloud_seen": True, "hops": 0}

    def heard() -> tuple[object, ...]:
        known = sensing.heard(["r02"], 10 * MS)["r02"].state
        return tuple(getattr(known, name) for name in told)

    assert sensing.cloud(TargetCloud(mission="one", targets=targets))
    assert not sensing.cloud(TargetCloud(mission="one", targets=targets))
    sensing.state(state("r02", seq=1, mission="one", **told), 10 * MS)
    assert heard() == tuple(told.values())
    assert sensing.cloud(TargetCloud(mission="two", targets=targets))
    assert heard() == ("free", -1, None, "", False, 1000), "heard before"
    sensing.state(state("r02", seq=2, mission="one", **told), 10 * MS)
    assert heard() == ("free", -1, None, "", False, 1000), "a neighbour that is late"
    sensing.state(state("r02", seq=3, mission="two", **told), 10 * MS)
    assert heard() == tuple(told.values())
