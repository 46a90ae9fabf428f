"""Missions in virtual time: repeatable bit for bit, and a slice of the seeds that must stay whole and clear."""

import gc
import math
import weakref
from pathlib import Path
from typing import Literal

import msgspec
import pytest

from contract.arena import FieldControl
from groundstation import sweep
from groundstation.cli import main
from groundstation.conditions import FIELD, IDEAL, Conditions
from groundstation.lockstep import World
from groundstation.runfolder import read
from groundstation.sweep import Job, arena_for, play
from groundstation.targets import Scenario, scenario


@pytest.mark.parametrize("conditions", ["ideal", "field"])
def test_same_seed_same_run(conditions: str) -> None:
    job = Job(3, 9, 5, "field", conditions, limit_s=3.0)
    first, second = (msgspec.json.encode(play(job)) for _ in range(2))
    assert first == second
    assert first != msgspec.json.encode(play(job._replace(seed=6)))


def test_verb_writes_the_same_file_twice(tmp_path: Path) -> None:
    words = ["simulate", "--robots", "2", "--targets", "2", "--runs", "2", "--seed", "3", "--json"]
    codes = [main([*words, str(tmp_path / name)]) for name in ("a.json", "b.json")]
    assert codes == [0, 0]
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    runs = msgspec.json.decode((tmp_path / "a.json").read_bytes())["runs"]
    assert [run["seed"] for run in runs] == [3, 4]


@pytest.mark.parametrize(
    ("robots", "seed", "conditions"),
    [(5, 1, "ideal"), (5, 2, "ideal"), (6, 1, "ideal"), (6, 2, "ideal"), (5, 1, "field"), (6, 2, "field")],
)
def test_missions_complete_whole_and_clear(robots: int, seed: int, conditions: str) -> None:
    result = play(Job(robots, 19, seed, "field", conditions, limit_s=120.0))
    assert result.completed, result.why
    assert (result.occupied, result.disconnected_steps, result.collisions) == (19, 0, 0)
    assert result.mission_s >= result.lower_bound_s


@pytest.mark.parametrize("conditions", [IDEAL, FIELD])
@pytest.mark.parametrize("before_m", [0.06, 0.1, 0.15])
def test_a_robot_makes_way_for_the_one_that_takes_the_target_it_gave_up(
    before_m: float, conditions: Conditions
) -> None:
    """Two that took turns before the last target stood in each other's way for good."""
    job = Job(2, 1, 1, "field", "ideal", limit_s=8.0)
    starts = ((2.0 + before_m, 2.5), (1.6, 2.5))
    world = World(arena_for(job), Scenario((4.0, 5.0), starts, ((2.0, 2.5),), 0.0), conditions, 1, 8.0)
    world.agents["r01"].controller.tasking._blocked_until[0] = math.inf
    result = world.run()
    assert result.completed, result.why
    assert (result.disconnected_steps, result.collisions) == (0, 0)


def test_time_up_is_a_failure_with_its_reason(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--robots", "2", "--targets", "5", "--runs", "1", "--limit-s", "0.5"]) == 1
    assert "failed seeds [1]" in capsys.readouterr().out
    assert "r01 running" in play(Job(2, 5, 1, "field", "ideal", limit_s=0.5)).why


@pytest.mark.parametrize(
    "words",
    [
        ["--robots", "0"],
        ["--targets", "-3"],
        ["--runs", "0"],
        ["--workers", "0"],
        ["--robots", "six"],
        ["--profile", "fast"],
        ["--conditions", "rain"],
        ["--unknown"],
        ["--robot", "6"],
        ["--limit-s", "0"],
        ["--limit-s", "nan"],
    ],
)
def test_bad_arguments_exit_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", *words]) == 2
    assert words[0].removesuffix("t") in capsys.readouterr().err


SETTINGS = (
    "--conditions field --pose-age-ms 10:30 --message-age-ms 15 --pose-noise-mm 1 --heading-noise-mrad 4 --loss 0.3 "
    "--frame-loss 0.05 --motor-lag-ms 50:70 --accel 1.8:2 --told-lag-ms 40:80"
)


def test_every_condition_is_settable(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    words = f"simulate --robots 2 --targets 1 --runs 1 --limit-s 1 {SETTINGS} --json {path}"
    assert main(words.split()) == 1
    settings = msgspec.json.decode(path.read_bytes())["settings"]
    assert settings["conditions"] == {
        "pose_age_s": [0.01, 0.03],
        "message_age_s": [0.015, 0.015],
        "position_noise_m": 0.001,
        "heading_noise_rad": 0.004,
        "loss": 0.3,
        "frame_loss": 0.05,
        "lag_s": [0.05, 0.07],
        "deceleration_mps2": [1.8, 2.0],
    }
    assert settings["told"] == {"deceleration_mps2": [1.8, 2.0], "lag_s": [0.04, 0.08]}


@pytest.mark.parametrize(
    "change",
    [
        {"pose_age_s": (0.03, 0.05)},
        {"message_age_s": (0.03, 0.05)},
        {"position_noise_m": 0.003},
        {"heading_noise_rad": 0.02},
        {"loss": 0.4},
        {"frame_loss": 0.4},
        {"lag_s": (0.06, 0.08)},
        {"deceleration_mps2": (1.6, 2.0)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_every_condition_matters(change: dict[str, object]) -> None:
    job = Job(3, 6, 4, "field", "field", limit_s=2.0)
    assert msgspec.json.encode(play(job)) != msgspec.json.encode(play(job, FIELD._replace(**change)))


def test_presets_are_what_the_robots_are_calibrated_for() -> None:
    ideal, field = (arena_for(Job(2, 1, 1, "field", name, 1.0)).control.field for name in ("ideal", "field"))
    assert (ideal.brake_deceleration_mps2, ideal.motor_lag_s) == ((100.0, 100.0), (0.001, 0.001))
    assert field == FieldControl()


def test_on_two_processes_the_same_bytes_as_on_one(tmp_path: Path) -> None:
    words = ["simulate", "--robots", "2", "--targets", "2", "--runs", "3", "--seed", "8"]
    for name, workers in (("a.json", "1"), ("b.json", "2")):
        assert main([*words, "--workers", workers, "--json", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_a_sweep_leaves_no_mission_behind_and_the_collector_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    worlds: list[weakref.ref[World]] = []

    class Noted(World):
        def __post_init__(self) -> None:
            super().__post_init__()
            worlds.append(weakref.ref(self))

    monkeypatch.setattr(sweep, "World", Noted)
    before = (gc.isenabled(), gc.get_freeze_count())
    assert before[0]
    during = []
    for found in sweep.local([Job(2, 3, seed, "field", "ideal", 0.02) for seed in (1, 2)], 1):
        during.append((gc.isenabled(), gc.get_freeze_count() > 0))
        if found is not None and len(worlds) == 2:
            assert worlds[0]() is None
    assert worlds[1]() is None
    assert set(during) == {(False, True)}
    assert (gc.isenabled(), gc.get_freeze_count()) == before


@pytest.mark.parametrize("wired", [False, True])
@pytest.mark.parametrize("conditions", ["ideal", "field"])
def test_a_mission_leaves_the_collector_nothing_while_it_lasts(
    conditions: Literal["ideal", "field"], wired: bool
) -> None:
    """Else its memory would grow without bound: nothing collects until it is over."""
    job = Job(5, 5, 3, "field", conditions, 30.0)
    world = World(arena_for(job), scenario(5, 5, 3), job.faced, 3, wired=wired, tap=lambda *_: None)
    with sweep.undisturbed():
        world.until(1.0)
        gc.collect()
        for moment in range(2, 7):
            world.until(float(moment))
            assert gc.collect() == 0


def test_a_collector_that_was_off_stays_off() -> None:
    gc.disable()
    try:
        with sweep.undisturbed():
            assert not gc.isenabled()
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_a_run_that_breaks_is_kept_with_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    healthy = World.until

    def until(world: World, mission_s: float) -> bool:
        if world.seed == 3:
            raise ZeroDivisionError("made up")
        return healthy(world, mission_s)

    monkeypatch.setattr(World, "until", until)
    path = tmp_path / "a.json"
    assert main(f"simulate --robots 2 --targets 2 --runs 3 --seed 2 --json {path}".split()) == 1
    found = msgspec.json.decode(path.read_bytes())
    assert [run["ending"] for run in found["runs"]] == ["completed", "error", "completed"]
    assert found["runs"][1]["why"] == "ZeroDivisionError: made up"
    assert found["summary"]["failed_seeds"] == [3]
    assert found["summary"]["completed"]["value"] == pytest.approx(2 / 3, abs=1e-5)


def test_an_interrupt_writes_what_was_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    healthy = World.until

    def until(world: World, mission_s: float) -> bool:
        if world.seed == 3 and mission_s > 1:
            raise KeyboardInterrupt
        return healthy(world, mission_s)

    monkeypatch.setattr(World, "until", until)
    path = tmp_path / "a.json"
    assert main(f"simulate --robots 2 --targets 2 --runs 4 --seed 2 --json {path} --save {tmp_path}".split()) == 130
    found = msgspec.json.decode(path.read_bytes())
    assert [run["seed"] for run in found["runs"]] == [2]
    assert found["unfinished"] == [3, 4, 5]
    assert "seeds from 3 on are missing" in capsys.readouterr().out
    assert read(tmp_path / "seed-3").recording.whole


def test_a_saved_run_is_a_run_folder_that_report_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = "simulate --robots 3 --targets 4 --runs 1 --seed 3 --conditions field --save"
    for name in ("a", "b"):
        assert main([*command.split(), str(tmp_path / name)]) == 0
    first, second = tmp_path / "a" / "seed-3", tmp_path / "b" / "seed-3"
    assert (first / "run.mcap").read_bytes() == (second / "run.mcap").read_bytes()
    assert sorted(path.name for path in first.iterdir()) == ["config.toml", "manifest.json", "metrics.json", "run.mcap"]
    result = play(Job(3, 4, 3, "field", "field", 180.0))
    metrics = read(first).metrics
    assert metrics is not None
    assert (metrics.completed, metrics.occupied, metrics.visited) == (True, 4, 4)
    assert (metrics.collisions, metrics.disconnected_disk_frames) == (0, 0)
    assert result.mission_s <= metrics.mission_s <= result.mission_s + 0.1
    assert metrics.ratio_to_lower_bound == pytest.approx(result.ratio_to_lower_bound, rel=0.02)
    assert metrics.min_distance_m == pytest.approx(result.min_distance_m, abs=0.01)
    spent = {word: sum(robot.seconds.get(word, 0.0) for robot in metrics.robots.values()) for word in result.time_s}
    for word, seconds in result.time_s.items():
        assert spent[word] == pytest.approx(seconds, abs=0.02 * sum(result.time_s.values())), word
    assert main(["report", str(first)]) == 0
    page = (first / "report.html").read_text()
    assert "Lockstep simulation" in page
    assert "turning: on the spot" in page
    assert main(["replay", "--check", str(first)]) == 0
    capsys.readouterr()
    assert main([*command.split(), str(tmp_path / "a")]) == 2
    assert "exists; give another folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["--pose-age-ms", "80:20"],
        ["--pose-age-ms", "1000"],
        ["--pose-age-ms", "5:-1"],
        ["--message-age-ms", "1:2:3"],
        ["--pose-noise-mm", "nan"],
        ["--heading-noise-mrad", "1:2"],
        ["--loss", "1.5"],
        ["--frame-loss", "x"],
        ["--motor-lag-ms", "inf"],
        ["--accel", "0"],
        ["--told-accel", ""],
    ],
)
def test_conditions_out_of_range_exit_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", *words]) == 2
    assert f"{words[0]} {words[1]}: needs" in capsys.readouterr().err
