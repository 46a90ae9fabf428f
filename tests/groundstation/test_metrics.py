"""Metrics: worked by hand for a made-up run, the same live and from the file, and lawful."""

import math
from operator import itemgetter
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from contract.arena import Arena
from contract.keys import Keys
from contract.messages import NeighbourState, RobotReport, RunStatus, StopRequest, TargetCloud
from groundstation import cli
from groundstation.history import History
from groundstation.metrics import Metrics, compute, encode, failures
from groundstation.runfolder import read
from tests.groundstation.runs import MS, START_NS, Place, Sent, arena_of, chain, mission, northward, record


def judge(arena: Arena, sent: list[Sent]) -> Metrics:
    history = History(arena)
    for _, message, _ in sent:
        history.receive(message)
    found = compute(history)
    assert found is not None
    return found


def test_by_hand() -> None:
    arena = arena_of(robots=3, targets=2)
    found = judge(arena, mission(arena, frames=100))
    assert found.completed
    assert (found.targets, found.occupied, found.visited, found.seed) == (2, 2, 2, 42)
    assert found.mission_s == 1.0
    assert (found.run_steps, found.frames) == (100, 100)
    assert found.min_lambda2 == pytest.approx(3.0)  # 0.5 m apart and r_c = 1 m: all three pairs in reach
    assert found.min_distance_m == 0.5
    assert (found.disconnected_frames, found.collisions, found.links_removed) == (0, 0, 0)
    # the starts see target 1 at 20 frames x 8 mm and target 2 at 40, each less the reach of 5 cm, at 0.8 m/s
    assert found.lower_bound_s == pytest.approx((0.32 - 0.05) / 0.8, abs=1e-3)
    assert found.ratio_to_lower_bound == pytest.approx(1.0 / found.lower_bound_s, rel=2e-3)
    assert found.pose_to_wheel_ms == msgspec.structs.replace(found.pose_to_wheel_ms, p50=3.0, p99=3.0, max=3.0)
    assert found.pose_to_wheel_until == "motor"
    assert found.pose_age_ms.max == 4.0
    loop = found.loop["r02"]
    assert (loop.nominal_hz, loop.rate_hz, loop.p99_jitter_ms, loop.deadline_misses) == (100.0, 100.0, 0.0, 0)
    robot = found.robots["r02"]
    assert robot.targets == 1
    assert robot.path_m == pytest.approx(0.008 * 99, abs=0.011)
    assert robot.seconds == {"link": pytest.approx(0.5), "travel": pytest.approx(0.496)}
    assert (found.frames_dropped, found.frames_dropped_bridge) == (0, 0)
    assert failures(found) == []


def test_a_mission_stopped_and_started_again_goes_on() -> None:
    """From its first start to its last end; a stop after that changes nothing."""
    arena = arena_of(robots=3, targets=2)
    sent = mission(arena, frames=100)
    running, completed = (
        next(m for _, m, _ in sent if isinstance(m, RunStatus) and m.phase == phase)
        for phase in ("running", "completed")
    )

    def later(status: RunStatus, seconds: float, **changes: object) -> Sent:
        stamp_ns = START_NS + round(seconds * 1e9)
        return Keys("made").status, replace(status, stamp_ns=stamp_ns, **changes), stamp_ns

    stopped = later(running, 0.3, phase="stopped", elapsed_s=0.3, detail="r02 stopped")
    again = later(running, 0.5, elapsed_s=0.1)
    end = later(completed, 1.1, elapsed_s=0.6)
    halted = later(running, 1.2, phase="stopped", elapsed_s=0.6)
    rest = [entry for entry in sent if not isinstance(entry[1], RunStatus)]
    begun = later(running, 0.0)
    found = judge(arena, [begun, *rest, stopped, again, end, halted])
    assert (found.completed, found.ending, found.mission_s) == (True, "completed", 1.0)
    assert judge(arena, [begun, *rest, stopped]).ending == "stopped"
    assert judge(arena, [begun, *rest, stopped, again]).ending == ""


def test_without_emulated_motors_the_bus_write_counts() -> None:
    arena = arena_of()
    found = judge(arena, mission(arena, motors=False))
    assert (found.pose_to_wheel_ms.max, found.pose_to_wheel_until) == (2.5, "write")


def test_lost_frames_are_dropped_and_missed() -> None:
    arena = arena_of()
    found = judge(arena, mission(arena, skip=frozenset({10, 11, 50})))
    assert (found.frames_dropped, found.frames_dropped_bridge) == (3, 3)
    assert found.loop["r01"].deadline_misses == 3
    assert found.loop["r01"].steps == 97


def test_frames_the_bridge_lost_before_the_recording_began_are_not_the_missions() -> None:
    arena = arena_of()
    sent = [entry for entry in mission(arena, skip=frozenset({10})) if entry[2] > 4_990_000_000]
    assert judge(arena, [mission(arena)[0], *sent]).frames_dropped_bridge == 0


def spread_at(k: int, far_m: float) -> Place:
    """Robot 0 is ``far_m`` from robot 1 from frame k on."""
    return lambda i, frame: (2.0 - far_m, 0.5) if i == 0 and frame >= k else (1.5 + 0.5 * i, 0.5)


def test_a_split_is_counted_to_the_frame() -> None:
    arena = arena_of()
    found = judge(arena, mission(arena, place=spread_at(60, 1.01)))
    assert (found.disconnected_frames, found.disconnected_disk_frames, found.min_lambda2) == (40, 40, 0.0)
    assert failures(found) == ["network split in 40 of 100 frames"]


def test_robots_in_reach_without_a_common_link_are_split() -> None:
    arena = arena_of()

    def links(k: int) -> dict[int, set[int]]:
        return chain(3) if k < 70 else {0: {1}, 1: {2}, 2: {1}}  # robot 2 (index 1) no longer enforces the link to 1

    found = judge(arena, mission(arena, links=links))
    assert (found.disconnected_disk_frames, found.disconnected_enforced_frames, found.disconnected_frames) == (
        0,
        30,
        30,
    )
    assert found.links_removed == 1
    paper = arena_of(profile="paper")
    assert judge(paper, mission(paper, links=links)).disconnected_frames == 0


def test_a_collision_is_one_however_long() -> None:
    arena = arena_of(robots=2)

    def place(i: int, k: int) -> tuple[float, float]:
        touching = i == 1 and (20 <= k < 40 or 60 <= k < 61)
        return (1.0 + 0.13 if touching else 1.0 + 0.5 * i, 1.0)

    found = judge(arena, mission(arena, place=place))
    assert found.collisions == 2
    assert found.min_distance_m == pytest.approx(0.13)
    assert failures(found) == ["2 collisions, least distance 0.13 m"]


@pytest.mark.parametrize("ending", ["failed", "stopped", ""])
def test_an_unfinished_mission_is_no_success(ending: str) -> None:
    arena = arena_of()
    found = judge(arena, mission(arena, ending=ending))
    assert not found.completed
    assert found.ratio_to_lower_bound is None
    assert len(failures(found)) == 1


def test_completed_needs_every_target_occupied() -> None:
    arena = arena_of(targets=2)
    found = judge(arena, mission(arena, frames=30))
    assert (found.ending, found.completed, found.occupied) == ("completed", False, 1)


def test_a_target_nobody_drove_to_is_not_visited() -> None:
    arena = arena_of(targets=2)
    sent = mission(arena)
    cloud = sent[0][1]
    far = msgspec.structs.replace(cloud.targets[0], x_m=3.5, y_m=4.5)  # type: ignore[attr-defined]
    moved = msgspec.structs.replace(cloud, targets=(far, *cloud.targets[1:]))  # type: ignore[attr-defined]
    found = judge(arena, [(sent[0][0], moved, sent[0][2]), *sent[1:]])
    assert (found.occupied, found.visited) == (2, 1)


def test_no_mission_no_metrics() -> None:
    arena = arena_of()
    history = History(arena)
    for _, message, _ in mission(arena)[:2]:
        history.receive(message)
    assert compute(history) is None
    assert failures(None) == ["no mission was started"]


@given(order=st.randoms(use_true_random=False), frames=st.integers(2, 60), robots=st.integers(1, 5))
def test_lawful(order: object, frames: int, robots: int) -> None:
    arena = arena_of(robots=robots)
    paths = [[order.uniform(0, 0.9), order.uniform(0, 3.0)] for _ in range(robots)]  # type: ignore[attr-defined]

    def place(i: int, k: int) -> tuple[float, float]:
        return paths[i][0] + 0.02 * k * (i % 2), paths[i][1]

    found = judge(arena, mission(arena, frames=frames, place=place))
    assert found.disconnected_frames >= max(found.disconnected_disk_frames, found.disconnected_enforced_frames)
    assert found.disconnected_frames <= found.disconnected_disk_frames + found.disconnected_enforced_frames
    if robots > 1:
        assert (found.min_lambda2 > 0) == (found.disconnected_disk_frames == 0)
        assert found.min_lambda2 == 0 or found.min_lambda2 >= found.lambda2_floor - 1e-6
        closest = min(
            math.dist(place(i, k), place(j, k)) for k in range(frames) for i in range(robots) for j in range(i)
        )
        assert found.min_distance_m == pytest.approx(closest, abs=1e-5)
        assert (found.collisions > 0) == (closest < 0.14)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run")
    arena = arena_of()
    record(path, arena, mission(arena, place=northward))
    return path


def test_the_file_gives_the_same_numbers(folder: Path) -> None:
    arena = arena_of()
    assert encode(judge(arena, mission(arena))) == encode(read(folder).metrics or pytest.fail("no metrics"))


def test_the_verb_recomputes_and_checks(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["metrics", str(folder)]) == 0
    written = msgspec.json.decode((folder / "metrics.json").read_bytes())
    assert written["occupied"] == 2
    assert cli.main(["metrics", str(folder), "--check"]) == 0
    (folder / "metrics.json").write_bytes(msgspec.json.encode(written | {"collisions": 7}))
    assert cli.main(["metrics", str(folder / "run.mcap"), "--check"]) == 1
    assert "collisions: 7 written, 0 recomputed" in capsys.readouterr().err
    assert cli.main(["metrics", str(folder / "nothing")]) == 2


def test_metrics_json_has_what_others_rely_on(folder: Path) -> None:
    table = msgspec.json.decode(encode(read(folder).metrics or pytest.fail("no metrics")))
    assert {
        "completed", "targets", "occupied", "mission_s", "run_steps", "min_lambda2", "disconnected_frames",
        "collisions", "min_distance_m", "lower_bound_s", "ratio_to_lower_bound", "seed", "pose_to_wheel_ms", "loop",
        "frames_dropped",
    } <= table.keys()  # fmt: skip
    assert {"p50", "p99", "max"} <= table["pose_to_wheel_ms"].keys()
    assert {"rate_hz", "p99_jitter_ms", "deadline_misses"} <= table["loop"]["r01"].keys()


def test_what_robots_say_of_another_mission_is_not_this_ones() -> None:
    arena = arena_of()
    plain = mission(arena)
    keys = Keys(arena.arena.name)
    spoken = [(k, m) for k, m, _ in plain if isinstance(m, NeighbourState)]
    ours = [(k, replace(m, mission="made") if isinstance(m, NeighbourState) else m, t) for k, m, t in plain]
    old = [(k, replace(m, mission="before", stamp_ns=1), START_NS - 60 * MS) for k, m in spoken]
    later = [(k, replace(m, mission="after", occupied="ff", stamp_ns=2), START_NS + 5 * MS) for k, m in spoken]
    cloud = (keys.targets, TargetCloud(mission="after", targets=()), START_NS + 4 * MS)
    expected = None
    for sent in (ours, [*old, *ours], [*ours, cloud, *later], sorted([*old, *ours, cloud, *later], key=itemgetter(2))):
        history = History(arena)
        for _, message, _ in sent:
            history.receive(message)
        found = compute(history)
        assert found is not None
        assert found.completed
        assert expected in (None, found)
        expected = found


def test_stop_latency_is_from_the_request_to_each_robots_report() -> None:
    arena = arena_of(robots=2)
    keys = Keys(arena.arena.name)
    sent = mission(arena, ending="stopped")
    at_ns = START_NS + 500 * MS
    sent.append((keys.stop, StopRequest(stamp_ns=at_ns, source="test", stop_id=9), at_ns))
    for k, name in enumerate(arena.robots):
        for late_ms in (30 + 20 * k, 200):
            stamp_ns = at_ns + late_ms * MS
            report = RobotReport(robot=name, boot=1, stamp_ns=stamp_ns, run="stopped", stop_id=9, reason="stop")
            sent.append((keys.report(name), report, stamp_ns))
    found = judge(arena, sorted(sent, key=itemgetter(2)))
    assert (found.stops, found.stop_ms.p50, found.stop_ms.max) == (1, 40.0, 50.0)
