"""Every scripted fault of the server, and the one name under which the bridge publishes it."""

import math

import pytest

from contract.messages import BodyPose
from mocap_bridge.checks import REASONS
from mocap_bridge.continuity import REACQUIRE_FRAMES
from mocap_bridge.mock.bodies import BodyState
from tests.mocap_bridge.lockstep import Story, arena, circling


def of(story: Story, robot: str, start_s: float, stop_s: float) -> list[BodyPose]:
    """A robot's body in the frames exposed in that span of the script."""
    return [
        body
        for frame in story.frames
        if start_s <= story.script_s(frame) < stop_s
        for body in frame.bodies
        if body.robot == robot
    ]


def test_quiet_stream_is_all_valid_and_in_the_arena_frame() -> None:
    story = Story().until(2.0)
    assert len(story.frames) >= 238
    assert {body.reason for frame in story.frames for body in frame.bodies} == {""}
    for frame in story.frames:
        truth = {pose.name: pose for pose in circling()(story.script_s(frame))}
        for body in frame.bodies:
            assert math.hypot(body.x_m - truth[body.robot].x_m, body.y_m - truth[body.robot].y_m) < 2e-4
            assert abs(math.remainder(body.heading_rad - truth[body.robot].heading_rad, math.tau)) < 1e-4
    assert story.health[-1].state == "ok"
    assert story.health[-1].frames_dropped == 0


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("1.0 0.5 occlusion r06", "occluded"),
        ("1.0 0.5 absent r06", "missing"),
        ("1.0 0.5 jump r06 0.5", "jump"),
        ("1.0 0.5 turn r06 1.5", "rotation_jump"),
        ("1.0 0.5 not_finite r06", "not_finite"),
        ("1.0 0.5 denormal r06 1.05", "quaternion_norm"),
        ("1.0 0.5 tilt r06 1.0", "tilted"),
        ("1.0 0.5 marker_error r06 0.02", "marker_error"),
        ("1.0 0.5 edit_mode", "edit_mode"),
        ("1.0 0.5 millimetres", "units"),
        ("1.0 0.5 jump r06 3.9", "outside_arena"),
    ],
)
def test_fault_is_invalid_in_its_very_first_frame_and_over_when_it_is_over(line: str, reason: str) -> None:
    story = Story(line).until(2.0)
    assert reason in REASONS
    assert {body.valid for body in of(story, "r06", 0.0, 0.995)} == {True}
    during = of(story, "r06", 0.999, 1.03)
    assert len(during) >= 3
    assert (during[0].valid, during[0].reason) == (False, reason)
    assert {(body.valid, body.reason) for body in during[1:]} <= {(False, reason), (False, "reacquiring")}
    assert of(story, "r06", 1.9, 2.0)[-1].valid
    others = {body.reason for body in of(story, "r09", 0.0, 2.0)}
    assert others == ({"", reason} if reason in ("edit_mode", "units") else {""})
    track = next(t for t in story.pipeline.checker.tracks if t.robot == "r06")
    assert track.faults[reason] >= 1


def test_invalid_pose_keeps_the_last_believed_coordinates() -> None:
    story = Story("1.0 0.5 jump r06 0.5").until(1.3)
    before, during = of(story, "r06", 0.9, 0.995)[-1], of(story, "r06", 0.999, 1.03)
    assert {(body.x_m, body.y_m, body.heading_rad) for body in during} == {(before.x_m, before.y_m, before.heading_rad)}


def test_glitch_of_one_frame_costs_one_frame() -> None:
    story = Story("1.0 0.005 jump r06 0.5").until(2.0)
    bodies = of(story, "r06", 0.0, 2.0)
    assert sum(not body.valid for body in bodies) == 1
    assert bodies[-1].resets == 0


def test_new_place_is_believed_after_steady_frames_and_counted() -> None:
    story = Story("1.0 9 jump r06 0.5").until(2.0)
    bodies = of(story, "r06", 0.999, 2.0)
    invalid = [body for body in bodies if not body.valid]
    assert [body.reason for body in invalid] == ["jump"] + ["reacquiring"] * (REACQUIRE_FRAMES - 1)
    assert {body.resets for body in bodies if body.valid} == {1}


def test_frozen_pose_is_invalid_after_a_quarter_second() -> None:
    story = Story("1.0 1.0 frozen r06").until(3.0)
    assert all(body.valid for body in of(story, "r06", 1.0, 1.22))
    assert {body.reason for body in of(story, "r06", 1.27, 1.99)} == {"frozen"}
    assert of(story, "r06", 2.9, 3.0)[-1].valid


def test_bodies_that_change_places_are_held_until_they_change_back() -> None:
    story = Story("1.0 2.0 swap r06 r08").until(4.0)
    for robot in ("r06", "r08"):
        during = of(story, robot, 1.001, 2.999)
        assert not any(body.valid for body in during)
        assert {body.reason for body in during[REACQUIRE_FRAMES + 1 :]} == {"swap_suspect"}
        assert of(story, robot, 3.9, 4.0)[-1].valid
        assert of(story, robot, 3.9, 4.0)[-1].resets == 0


@pytest.mark.parametrize("gap_s", [0.05, 0.2, 0.45])
def test_change_of_places_behind_an_occlusion_is_not_believed(gap_s: float) -> None:
    starts = {"r06": (1.0, 1.0), "r08": (1.45, 1.0), "r09": (3.0, 3.0)}
    hidden = f"1.0 {gap_s} occlusion r06\n1.0 {gap_s} occlusion r08\n1.0 5 swap r06 r08"
    story = Story(hidden, arena(starts)).until(3.0)
    for robot in ("r06", "r08"):
        assert not any(body.valid for body in of(story, robot, 1.001, 3.0))
        assert of(story, robot, 2.5, 3.0)[-1].reason == "swap_suspect"
    assert all(body.valid for body in of(story, "r09", 0.0, 3.0))


def test_change_of_places_behind_lost_frames_is_not_believed() -> None:
    starts = {"r06": (1.0, 1.0), "r08": (1.21, 1.0)}
    story = Story("1.0 0.3 drop\n1.1 5 swap r06 r08", arena(starts)).until(2.0)
    for robot in ("r06", "r08"):
        assert not any(body.valid for body in of(story, robot, 1.301, 2.0))


def test_label_that_wanders_to_a_hidden_robot_is_not_believed() -> None:
    """r08 is hidden and its markers are taken for r06, whose own are lost: one label, wrong place."""

    def poses(elapsed_s: float) -> list[BodyState]:
        r06, r08 = BodyState("r06", 1.0 + 0.1 * elapsed_s, 1.0, 0.0), BodyState("r08", 1.4, 1.0, 0.0)
        return [r06, r08] if elapsed_s < 1.0 else [r08._replace(name="r06")] if elapsed_s > 1.3 else []

    story = Story("", arena({"r06": (1.0, 1.0), "r08": (1.4, 1.0)}), poses).until(2.5)
    assert not any(body.valid for body in of(story, "r06", 1.01, 2.5))
    assert of(story, "r06", 2.4, 2.5)[-1].reason == "swap_suspect"


def test_robot_that_moves_on_during_an_occlusion_is_believed_at_once() -> None:
    story = Story("1.0 0.3 occlusion r06").until(2.0)
    assert story.reasons("r06") == ["", "occluded", ""]
    assert story.frames[-1].bodies[0].resets == 0


def test_follower_close_behind_is_no_swap() -> None:
    """Two robots in line, 0.21 m apart, the leader hidden for 0.3 s."""

    def poses(elapsed_s: float) -> list[BodyState]:
        x = 0.5 + 0.8 * elapsed_s
        return [BodyState("r06", x + 0.21, 1.0, 0.0), BodyState("r08", x, 1.0, 0.0)]

    story = Story("1.0 0.3 occlusion r06", arena({"r06": (0.71, 1.0), "r08": (0.5, 1.0)}), poses).until(2.0)
    assert story.reasons("r06") == ["", "occluded", ""]
    assert story.reasons("r08") == [""]


# --- the stream -------------------------------------------------------------------------------------


def numbers(story: Story) -> list[tuple[int, int]]:
    return [(frame.session, frame.frame) for frame in story.frames]


@pytest.mark.parametrize("line", ["1 0.5 reorder", "1 0.5 duplicate", "1 0.3 burst", "1 1 late 0.06", "1 1 drop 0.3"])
def test_frames_are_published_once_and_in_order(line: str) -> None:
    story = Story(line).until(3.0)
    assert numbers(story) == sorted(set(numbers(story)))
    assert len({session for session, _ in numbers(story)}) == 1
    assert {body.reason for frame in story.frames for body in frame.bodies} == {""}


@pytest.mark.parametrize(
    ("line", "counter"), [("1 0.5 reorder", "old"), ("1 0.5 duplicate", "duplicate"), ("1 0.5 truncated", "malformed")]
)
def test_stream_fault_is_counted_under_its_name(line: str, counter: str) -> None:
    story = Story(line).until(2.0)
    assert story.receiver.status().counters[counter] >= 25


def test_lost_frames_are_counted() -> None:
    story = Story("1.0 0.5 drop").until(2.0)
    assert 58 <= story.health[-1].frames_dropped <= 62
    states = [health.state for health in story.health]
    assert "stale" in states
    assert states[-1] == "ok"


def test_truncated_frames_are_malformed_and_named() -> None:
    story = Story("1.0 0.2 truncated").until(2.0)
    assert story.health[-1].malformed >= 20
    assert "header" in story.receiver.client.last_fault
    assert story.health[-1].state == "ok"


def test_restart_begins_a_session_with_a_clock_of_its_own() -> None:
    story = Story("2.0 0.7 restart").until(5.0)
    sessions = sorted({frame.session for frame in story.frames})
    assert len(sessions) == 2
    first = [frame for frame in story.frames if frame.session == sessions[0]]
    second = [frame for frame in story.frames if frame.session == sessions[1]]
    assert second[0].frame < first[-1].frame
    assert story.script_s(second[0]) < 2.7 + 0.7, "back within 0.7 s"
    for frame in second:
        assert abs(frame.publish_ns - frame.exposure_ns - 150_000) < 400_000
    assert {body.reason for frame in second for body in frame.bodies} == {""}
    assert {body.resets for body in second[-1].bodies} == {1}


def test_changed_id_is_followed_by_name() -> None:
    story = Story("1.0 0.1 id_change r06").until(3.0)
    assert story.frames[-1].bodies[0].valid
    assert story.receiver.client.models.names[101] == "r06"
    assert set(story.reasons("r06")) <= {"", "missing"}
    assert [body for body in of(story, "r06", 1.5, 3.0) if not body.valid] == []


def test_body_missing_from_the_model_list_is_named() -> None:
    story = Story("0.0 9.0 wrong_models r06").until(3.0)
    assert {body.reason for body in of(story, "r06", 2.0, 3.0)} == {"missing"}
    health = {body.robot: body.reason for body in story.health[-1].bodies}
    assert health == {"r06": "not_in_model_list", "r08": "", "r09": ""}
    assert story.receiver.client.counters["models_refetched"] <= 4, "at most once a second"


def test_name_that_two_bodies_have_is_refused() -> None:
    story = Story("1.0 9.0 duplicate_name r06").until(4.0)
    assert not of(story, "r06", 3.0, 4.0)[-1].valid
    assert {b.robot: b.reason for b in story.health[-1].bodies}["r06"] == "duplicate_name"


def test_change_of_rate_is_measured_and_warned_of() -> None:
    story = Story("1.0 9.0 rate_change 60").until(4.0)
    assert story.frames[-1].rate_hz == pytest.approx(60.0, abs=1.5)
    assert (story.health[-1].state, "60 frames/s, 120 nominal" in story.health[-1].detail) == ("degraded", True)


def test_millimetres_at_connection_are_named_with_the_remedy() -> None:
    story = Story("0.0 9.0 millimetres").until(1.5)
    assert "set metres" in story.receiver.status().problem
    assert {body.reason for body in of(story, "r06", 0.1, 1.5)} == {"units"}


def test_clock_drift_is_followed() -> None:
    story = Story("0.0 20.0 clock_drift 100").until(15.0)
    assert story.receiver.client.stamper.clock.skew == pytest.approx(-100e-6, abs=5e-6)
    for frame in story.frames[-100:]:
        assert abs(frame.publish_ns - frame.exposure_ns - 150_000) < 120_000


def test_silence_is_lost_and_then_found_again_in_the_same_session() -> None:
    story = Story("1.0 3.0 silence").until(6.0)
    states = [health.state for health in story.health]
    order = [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]]
    assert [state for state in order if state != "degraded"] == ["connecting", "ok", "stale", "lost", "ok"]
    assert len({frame.session for frame in story.frames}) == 1
    assert max(health.detail.count("no frame for") for health in story.health) == 1


def test_server_that_answers_nothing_after_connecting_still_streams() -> None:
    story = Story("0.5 9.0 deaf").until(2.5)
    assert story.frames
    assert story.frames[-1].bodies[0].valid


def test_same_script_same_bytes() -> None:
    line = "0.5 1 drop 0.3\n1.0 0.2 occlusion r06\n1.2 0.3 reorder"
    assert Story(line, seed=5).until(2.0).frames == Story(line, seed=5).until(2.0).frames
    assert Story(line, seed=5).until(2.0).frames != Story(line, seed=6).until(2.0).frames
