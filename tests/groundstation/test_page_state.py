"""The arena page without a browser: what it says of robots, network, targets and STOP."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Arena, digest, load
from contract.messages import (
    SCHEMA_VERSION,
    BodyPose,
    LoopTiming,
    MocapFrame,
    OrderRequest,
    RobotReport,
    RunStatus,
    StopRequest,
)
from groundstation import rig
from groundstation.connectivity import components
from groundstation.page_links import CRITICAL, KEPT, REMOVED, UNVERIFIED, Network, network
from groundstation.page_reasons import Heard, complaint
from groundstation.page_seed import MOST_TARGETS, SeedError, checked, cloud, points_of, unreachable
from groundstation.page_state import PageState
from groundstation.page_stop import CONFIRM_NS, RELEASE_NS, REPEAT_NS, StopLatch
from groundstation.targets import cloud_of

MS = 1_000_000
ROBOTS = ("r06", "r08", "r13")


@pytest.fixture(scope="module")
def arena() -> Arena:
    return load(rig.find_arena("experiment2"))


def report(arena: Arena, robot: str, **changes: object) -> RobotReport:
    others = [name for name in arena.robots if name != robot]
    fields: dict[str, object] = {
        "robot": robot,
        "boot": 1,
        "stamp_ns": 0,
        "schema_version": SCHEMA_VERSION,
        "arena_hash": digest(arena),
        "run": "running",
        "pose_valid": True,
        "pose_age_ms": 9.0,
        "battery_v": 24.0,
        "timing": LoopTiming(nominal_hz=100.0, rate_hz=100.0, jitter_ms=0.3, steps=10, misses=0),
        "neighbours": tuple(others),
        "links_on": tuple(others),
    }
    return msgspec.convert(fields | changes, RobotReport)


def body(robot: str, **changes: object) -> BodyPose:
    return msgspec.convert({"robot": robot, "x_m": 1.0, "y_m": 1.0, "heading_rad": 0.0} | changes, BodyPose)


def timing(rate_hz: float, jitter_ms: float) -> LoopTiming:
    return LoopTiming(nominal_hz=100.0, rate_hz=rate_hz, jitter_ms=jitter_ms, steps=1, misses=3)


def trouble(arena: Arena, **changes: object) -> tuple[str, str]:
    found = complaint(arena, "r11", Heard(report(arena, "r11", **changes), 0.05, body("r11"), 0.01))
    assert found is not None
    assert found.why
    assert found.do
    return found.level, found.title


# --- reasons --------------------------------------------------------------------------------------------


def test_a_well_robot_has_no_complaint(arena: Arena) -> None:
    assert complaint(arena, "r11", Heard(report(arena, "r11"), 0.05, body("r11"), 0.01)) is None


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"schema_version": 99}, ("fault", "Other software")),
        ({"arena_hash": "other"}, ("fault", "Other arena file")),
        ({"pose_valid": False}, ("fault", "Pose invalid")),
        ({"pose_age_ms": 1800.0}, ("fault", "Pose stale")),
        ({"pose_age_ms": 1e9, "pose_valid": False, "run": "disarmed"}, ("caution", "No pose")),
        ({"motor_faults": ("undervoltage",)}, ("fault", "Motor fault")),
        ({"run": "fault", "reason": "motor gone", "remedy": "plug it in"}, ("fault", "Fault")),
        ({"run": "holding", "reason": "no frames", "remedy": "wait"}, ("fault", "Waits")),
        (
            {"timing": LoopTiming(nominal_hz=100.0, rate_hz=70.0, jitter_ms=0.1, steps=1, misses=3)},
            ("caution", "Loop slow"),
        ),
        (
            {"timing": LoopTiming(nominal_hz=100.0, rate_hz=99.0, jitter_ms=11.0, steps=1, misses=3)},
            ("caution", "Loop jitter"),
        ),
        ({"neighbours": ()}, ("caution", "Alone")),
    ],
)
def test_every_trouble_has_a_reason_and_a_remedy(arena: Arena, changes: dict[str, object], expected: object) -> None:
    assert trouble(arena, **changes) == expected


def test_silence_and_clock_are_told(arena: Arena) -> None:
    never = complaint(arena, "r11", Heard(None, -1.0, None, 0.01))
    silent = complaint(arena, "r11", Heard(report(arena, "r11"), 1.8, body("r11"), 0.01))
    ahead = complaint(arena, "r11", Heard(report(arena, "r11"), 0.05, body("r11"), 0.01, ahead_s=0.3))
    behind = complaint(arena, "r11", Heard(report(arena, "r11"), 0.05, body("r11"), 0.01, ahead_s=-0.9))
    assert never is not None
    assert "ahdc-onboard run --robot r11" in never.do
    assert silent is not None
    assert (silent.level, silent.title, silent.value) == ("fault", "Silent", "1.8 s")
    assert ahead is not None
    assert ahead.title == "Clock ahead"
    assert behind is not None
    assert behind.title == "Clock behind"


def test_a_hidden_body_names_the_markers(arena: Arena) -> None:
    hidden = body("r11", valid=False, reason="occluded")
    found = complaint(arena, "r11", Heard(report(arena, "r11", pose_valid=False), 0.05, hidden, 0.01))
    assert found is not None
    assert "markers" in found.why
    assert "marker" in found.do


# --- network --------------------------------------------------------------------------------------------


def judged(points: list[tuple[float, float]], enforced: list[list[int]], *doubtful: int) -> Network:
    labels = [str(i) for i in range(len(points))]
    return network(points, enforced, frozenset(doubtful), labels, 1.0, 0.8, True)


def test_links_are_kept_critical_removed_or_unverified() -> None:
    points = [(0.0, 0.0), (0.5, 0.0), (1.4, 0.0), (0.9, 0.0)]
    graph = judged(points, [[1], [0, 2], [1, 3], [2]])
    kinds = {(i, j): kind for i, j, kind in graph.pairs}
    assert kinds[0, 1] == KEPT
    assert kinds[1, 2] == CRITICAL
    assert kinds[0, 3] == REMOVED
    assert graph.word == "Connected"
    doubt = judged(points, [[1], [0, 2], [1, 3], [2]], 2)
    assert (2, 3, UNVERIFIED) in doubt.pairs
    assert doubt.word == "At risk"
    assert doubt.detail == "only 2 joins 3 to the rest"


@given(st.lists(st.tuples(st.floats(0, 3), st.floats(0, 3)), min_size=2, max_size=7))
def test_split_exactly_when_in_pieces_and_never_connected_from_stale_poses(points: list[tuple[float, float]]) -> None:
    labels = [str(i) for i in range(len(points))]
    graph = network(points, None, frozenset(), labels, 1.0, 0.8, True)
    pairs = [(i, j) for i, j, _ in graph.pairs]
    assert (graph.word == "SPLIT") == (len(components(len(points), pairs)) > 1)
    assert (graph.lambda2 > 0) == (graph.word == "Connected")
    assert network(points, None, frozenset(), labels, 1.0, 0.8, False).word == "Unknown"


# --- STOP -----------------------------------------------------------------------------------------------


def answer(arena: Arena, robot: str, stop_id: int, run: str = "stopped") -> RobotReport:
    return report(arena, robot, run=run, stop_id=stop_id)


def test_stop_is_repeated_until_every_robot_has_answered(arena: Arena) -> None:
    latch = StopLatch(ROBOTS)
    assert latch.press(7, "Space", 0) == StopRequest(stamp_ns=0, source="Space", stop_id=7)
    for robot in ROBOTS[:2]:
        latch.heard(answer(arena, robot, 7), 30 * MS)
    assert latch.due(REPEAT_NS) == [StopRequest(stamp_ns=REPEAT_NS, source="Space", stop_id=7)]
    assert latch.due(REPEAT_NS + 1) == []
    assert latch.silent == ["r13"]
    assert latch.confirmed(CONFIRM_NS - 1) is None
    assert latch.confirmed(CONFIRM_NS) is False
    latch.heard(answer(arena, "r13", 7), 700 * MS)
    assert latch.confirmed(CONFIRM_NS) is True
    assert latch.due(10 * REPEAT_NS) == []
    assert latch.acknowledged_ns == {"r06": 30 * MS, "r08": 30 * MS, "r13": 700 * MS}


def test_another_stop_id_or_a_running_robot_is_no_answer(arena: Arena) -> None:
    latch = StopLatch(ROBOTS)
    latch.press(7, "Space", 0)
    latch.heard(answer(arena, "r06", 6), 30 * MS)
    latch.heard(answer(arena, "r08", 7, run="running"), 30 * MS)
    assert latch.silent == list(ROBOTS)


def test_pressing_again_sends_again_and_keeps_the_answers(arena: Arena) -> None:
    latch = StopLatch(ROBOTS)
    latch.press(7, "Space", 0)
    latch.heard(answer(arena, "r06", 7), 30 * MS)
    latch.press(7, "Space", 100 * MS)
    assert list(latch.acknowledged_ns) == ["r06"]
    latch.press(8, "another page", 200 * MS)
    assert latch.silent == list(ROBOTS)


def test_release_needs_its_word_and_disarms_only(arena: Arena) -> None:
    latch = StopLatch(ROBOTS)
    latch.press(7, "Space", 0)
    for robot in ROBOTS:
        latch.heard(answer(arena, robot, 7), 30 * MS)
    for typed in ("", "release", "RELEASE ", "RELEASE-NOT-13"):
        assert latch.release(typed, latch.silent, 1, "page", 0) == "type RELEASE"
    assert latch.release("RELEASE", latch.silent, 1, "page", 0) == ""
    (sent,) = latch.due(0)
    assert isinstance(sent, OrderRequest)
    assert (sent.order, sent.robots) == ("disarm", ())
    assert latch.pressed is not None
    for robot in ROBOTS:
        latch.heard(answer(arena, robot, 7, run="disarmed"), 1)
    assert latch.pressed is None


def test_a_silent_robot_is_named_in_the_word_and_stays_latched(arena: Arena) -> None:
    latch = StopLatch(ROBOTS)
    latch.press(7, "Space", 0)
    for robot in ROBOTS[:2]:
        latch.heard(answer(arena, robot, 7), 30 * MS)
    assert latch.word(latch.silent) == "RELEASE-NOT-13"
    assert latch.release("RELEASE", latch.silent, 1, "page", 0) == "type RELEASE-NOT-13"
    assert latch.release("RELEASE-NOT-13", latch.silent, 1, "page", 0) == ""
    (sent,) = latch.due(0)
    assert isinstance(sent, OrderRequest)
    assert sent.robots == ("r06", "r08")


def test_stop_during_release_wins_and_a_release_nobody_heeds_ends(arena: Arena) -> None:
    latch = StopLatch(ROBOTS)
    latch.press(7, "Space", 0)
    for robot in ROBOTS:
        latch.heard(answer(arena, robot, 7), 1)
    latch.release("RELEASE", [], 1, "page", 0)
    latch.due(RELEASE_NS)
    assert not latch.releasing
    latch.release("RELEASE", [], 2, "page", RELEASE_NS)
    latch.press(9, "Space", RELEASE_NS + 1)
    assert not latch.releasing
    assert latch.due(RELEASE_NS + 1 + REPEAT_NS) == [
        StopRequest(stamp_ns=RELEASE_NS + 1 + REPEAT_NS, source="Space", stop_id=9)
    ]


# --- seeding ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value", [None, [], "x", [[1]], [[1, "2"]], [[math.nan, 1]], [[True, 1]], [[1, 1]] * (MOST_TARGETS + 1)]
)
def test_what_is_not_a_list_of_points_is_refused(value: object) -> None:
    with pytest.raises(SeedError, match="metres is needed"):
        points_of(value)


def test_beyond_the_fence_is_refused_by_name(arena: Arena) -> None:
    with pytest.raises(SeedError, match=r"target 2 at x 3\.90, y 1\.00 is beyond the fence: x 0\.15 to 3\.85"):
        checked(arena, [(1.0, 1.0), (3.9, 1.0)])


def test_a_target_out_of_reach_is_found_with_its_distance() -> None:
    assert unreachable([(0, 0), (0.9, 0), (1.8, 0), (3.0, 0)], 1.0) == [(3, pytest.approx(1.2))]
    assert unreachable([(0, 0), (0.9, 0)], 1.0) == []


def test_a_cloud_points_the_swarm_at_its_middle(arena: Arena) -> None:
    wish = cloud(arena, [(3.0, 0.55), (3.2, 0.55)], "by-hand")
    assert wish.start_direction_rad == pytest.approx(0.0, abs=1e-4)
    assert [(t.index, t.x_m) for t in wish.targets] == [(0, 3.0), (1, 3.2)]


# --- the view ---------------------------------------------------------------------------------------------


def filled(arena: Arena, now_ns: int, phase: str = "running", run: str = "running", **changes: object) -> PageState:
    state = PageState(arena, now_ns - 5_000 * MS)
    bodies = tuple(body(name, x_m=robot.start[0], y_m=robot.start[1]) for name, robot in arena.robots.items())
    frame = MocapFrame(
        session=1, frame=1, exposure_ns=now_ns, transmit_ns=now_ns, publish_ns=now_ns, rate_hz=100.0, bodies=bodies
    )
    state.receive(frame, now_ns)
    state.receive(cloud_of(arena, "m"), now_ns)
    status = {"stamp_ns": now_ns, "phase": phase, "elapsed_s": 34.0, "targets": 19, "occupied": (0, 3)}
    state.receive(msgspec.convert(status, RunStatus), now_ns)
    for name in arena.robots:
        state.receive(report(arena, name, run=run, stamp_ns=now_ns, **changes), now_ns)
    return state


def test_a_good_mission_in_one_glance(arena: Arena) -> None:
    now = 10**12
    view = filled(arena, now).view(now)
    assert view["run"]["state"] == "RUNNING"
    assert (view["cell"]["big"], view["cell"]["of"], view["cell"]["tone"]) == ("6", "of 6 ok", "")
    assert view["net"]["word"] == "Connected"
    assert (view["progress"]["big"], view["progress"]["of"]) == ("2", "of 19")
    assert view["time"]["big"] == "00:34"
    assert view["targets"].count("d") == 2
    assert view["stop"] is None
    assert {name for name, may in view["can"].items() if may} == {"hold", "drop"}
    assert len(msgspec.json.encode(view)) < 6_000


def test_old_poses_make_the_network_unknown_and_an_old_station_is_named(arena: Arena) -> None:
    now = 10**12
    state = filled(arena, now)
    later = state.view(now + 1_500 * MS)
    assert later["net"]["word"] == "Unknown"
    assert later["run"]["state"] == "NO STATION"
    assert {row["trouble"]["title"] for row in later["robots"]} == {"Silent"}
    assert later["cell"]["tone"] == "red"


def test_stopping_then_not_confirmed_then_stopped(arena: Arena) -> None:
    now = 10**12
    state = filled(arena, now)
    state.latch.press(7, "Space", now)
    assert state.view(now)["run"]["state"] == "STOPPING"
    names = list(arena.robots)
    for name in names[:-1]:
        state.receive(answer(arena, name, 7), now + 31 * MS)
    state.receive(report(arena, names[-1], stamp_ns=now), now + 31 * MS)
    late = state.view(now + 600 * MS)
    assert late["run"]["state"] == "STOPPED"
    assert late["stop"]["silent"] == [names[-1]]
    assert late["stop"]["word"] == "RELEASE-NOT-14"
    assert (late["cell"]["big"], late["cell"]["sub"]) == ("5", "slowest 31 ms")
    assert not any(late["can"].values())


def test_robots_that_stopped_by_themselves_show_stopped_with_the_reason(arena: Arena) -> None:
    now = 10**12
    view = filled(arena, now, phase="waiting", run="stopped", reason="no heartbeat").view(now)
    assert view["run"]["state"] == "STOPPED"
    assert "no heartbeat" in view["stop"]["source"]
    assert view["stop"]["word"] == "RELEASE"


def test_a_caution_must_last_before_it_is_shown(arena: Arena) -> None:
    now = 10**12
    slow = LoopTiming(nominal_hz=100.0, rate_hz=50.0, jitter_ms=0.1, steps=1, misses=1)
    state = filled(arena, now, timing=slow)
    assert state.complaints(now) == {}
    for name in arena.robots:
        state.receive(report(arena, name, stamp_ns=now + 1_100 * MS, timing=slow), now + 1_100 * MS)
    assert {c.title for c in state.complaints(now + 1_100 * MS).values()} == {"Loop slow"}


def test_fifty_robots_and_five_hundred_targets_stay_small(arena: Arena) -> None:
    big = load(rig.find_arena("simulation50"))
    now = 10**12
    state = filled(big, now)
    state.receive(cloud_of(big, "m2"), now)
    assert len(msgspec.json.encode(state.view(now))) < 60_000


def test_homing_is_no_mission_and_no_alarm_and_shows_where_robots_belong(arena: Arena) -> None:
    now = 10**12
    state = filled(arena, now, run="running", task="homing", links_on=())
    state.receive(RunStatus(stamp_ns=now, phase="homing", detail="on the way: r06"), now)
    state._poses["r06"] = (3.0, 4.0, 0.0, now)
    view = state.view(now)
    assert (view["run"]["state"], view["run"]["sub"]) == ("HOMING", "on the way: r06")
    assert (view["net"]["word"], view["net"]["tone"]) == ("Released", "")
    assert {name for name, may in view["can"].items() if may} == {"disarm"}
    away = {row["id"]: row["away_m"] for row in view["robots"] if "away_m" in row}
    assert list(away) == ["r06"]
    assert away["r06"] == pytest.approx(math.dist((3.0, 4.0), arena.robots["r06"].start), abs=0.01)


def test_repeat_and_home_are_offered_when_there_is_something_to_repeat_and_somebody_away(arena: Arena) -> None:
    now = 10**12
    state = filled(arena, now, run="disarmed")
    state._poses["r06"] = (3.0, 4.0, 0.0, now)

    def offered(phase: str, occupied: tuple[int, ...]) -> set[str]:
        state.receive(RunStatus(stamp_ns=now, phase=phase, occupied=occupied), now)  # type: ignore[arg-type]
        return {name for name, may in state.view(now)["can"].items() if may and name in ("repeat", "home")}

    assert offered("completed", (1, 2)) == {"repeat", "home"}
    assert offered("ready", (1, 2)) == {"repeat", "home"}
    assert offered("ready", ()) == {"home"}
    assert offered("running", (1,)) == set()
    for name, robot in arena.robots.items():
        state._poses[name] = (*robot.start, 0.0, now)
    assert offered("ready", ()) == set()


def test_targets_that_are_all_done_are_told_before_a_start_would_end_at_once(arena: Arena) -> None:
    now = 10**12
    state = filled(arena, now, run="disarmed")

    def told(occupied: tuple[int, ...]) -> tuple[str, bool]:
        state.receive(RunStatus(stamp_ns=now, phase="ready", occupied=occupied), now)
        view = state.view(now)
        words = [check[1] for check in view["checks"]]
        return f"{view['progress']['big']} {view['progress']['of']}", any("All targets are done" in w for w in words)

    assert told(()) == ("19 placed", False)
    assert told((0, 3)) == ("2 of 19", False)
    assert told(tuple(range(19))) == ("19 of 19", True)


def test_a_dropped_robot_is_no_part_of_the_network_and_no_alarm(arena: Arena) -> None:
    state = PageState(arena, 0)
    names = list(arena.robots)
    lost = names[-1]
    bodies = tuple(body(n, x_m=0.5 + 0.5 * i, y_m=4.5 if n == lost else 1.0) for i, n in enumerate(names))
    frame = MocapFrame(
        session=1, frame=1, exposure_ns=MS, transmit_ns=MS, publish_ns=MS, rate_hz=100.0, bodies=bodies
    )  # fmt: skip
    state.receive(frame, MS)
    for k, name in enumerate(names):
        links = tuple(n for n in names[max(0, k - 1) : k + 2] if n not in (name, lost)) if name != lost else ()
        run = "holding" if name == lost else "running"
        state.receive(report(arena, name, links_on=links, run=run, reason="x" if name == lost else ""), MS)
    state.receive(RunStatus(stamp_ns=MS, phase="running", elapsed_s=1.0, targets=2), MS)
    before = state.view(2 * MS)
    assert before["net"]["word"] == "SPLIT"
    assert before["cell"]["tone"] == "red"
    state.receive(RunStatus(stamp_ns=MS, phase="running", elapsed_s=1.0, targets=2, excluded=(lost,)), MS)
    after = state.view(3 * MS)
    assert after["net"]["word"] == "Connected"
    assert after["cell"]["tone"] != "red"
    assert after["robots"][-1]["out"]
    assert "dropped" in after["run"]["sub"]
    assert all(lost not in (names[i], names[j]) for i, j, _ in after["links"])
    assert after["can"]["drop"]


@pytest.mark.parametrize(("known", "titles"), [(True, []), (False, ["Clock ahead"])])
def test_a_page_on_another_computer_judges_a_robots_clock_by_the_sites(
    arena: Arena, known: bool, titles: list[str]
) -> None:
    days_ns = 5 * 86_400 * 10**9
    state = PageState(arena, 0)
    state.site_ahead_ns = days_ns if known else 0
    for second in (1, 3):
        now_ns = second * 10**9
        state.receive(report(arena, "r06", stamp_ns=days_ns + now_ns), now_ns)
        found = state.complaints(now_ns)
    assert [trouble.title for name, trouble in found.items() if name == "r06"] == titles


def test_very_many_silent_robots_are_counted_not_named() -> None:
    names = [f"r{k:02d}" for k in range(1, 51)]
    latch = StopLatch(names)
    assert latch.word(names[:8]) == "RELEASE-NOT-1-2-3-4-5-6-7-8"
    assert latch.word(names[:9]) == "RELEASE-NOT-9-ROBOTS"
    latch.press(7, "Space", 0)
    assert latch.release("RELEASE-NOT-10-ROBOTS", names[:9], 1, "page", 1) == "type RELEASE-NOT-9-ROBOTS"
    assert latch.release("RELEASE-NOT-9-ROBOTS", names[:9], 1, "page", 1) == ""
    (request,) = latch.due(1)
    assert isinstance(request, OrderRequest)
    assert set(request.robots) == set(names[9:])
