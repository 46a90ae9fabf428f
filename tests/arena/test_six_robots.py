"""The experiment of the paper with six robots as ``demo`` runs it, and what it leaves in its folder."""

import json
from pathlib import Path

import pytest

from groundstation.cli import main

KEYS = {
    "completed",
    "targets",
    "occupied",
    "mission_s",
    "run_steps",
    "min_lambda2",
    "disconnected_frames",
    "collisions",
    "min_distance_m",
    "lower_bound_s",
    "ratio_to_lower_bound",
    "seed",
    "pose_to_wheel_ms",
    "loop",
    "frames_dropped",
}
ROBOTS = ["r06", "r08", "r09", "r11", "r13", "r14"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Path]:
    out = tmp_path_factory.mktemp("six") / "run"
    return main(["demo", "--headless", "--seed", "1", "--out", str(out)]), out


def test_all_targets_occupied_in_one_piece_without_collision(run: tuple[int, Path]) -> None:
    code, out = run
    metrics = json.loads((out / "metrics.json").read_text())
    assert code == 0, metrics
    assert metrics["completed"] is True
    assert metrics["occupied"] == metrics["targets"] == metrics["visited"] == 19
    assert metrics["disconnected_frames"] == 0
    assert metrics["collisions"] == 0
    assert metrics["min_lambda2"] >= metrics["lambda2_floor"] - 1e-6
    assert metrics["mission_s"] > metrics["lower_bound_s"] > 0


def test_the_folder_has_what_others_rely_on(run: tuple[int, Path]) -> None:
    _, out = run
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics.keys() >= KEYS
    assert list(metrics["loop"]) == ROBOTS
    assert all(loop["steps"] > 100 for loop in metrics["loop"].values())
    assert metrics["pose_to_wheel_ms"]["p50"] > 0
    assert metrics["seed"] == 1
    assert {"run.mcap", "config.toml", "metrics.json"} <= {entry.name for entry in out.iterdir()}
    assert not (out / "ports").exists()


def test_its_numbers_come_from_the_recording_alone(run: tuple[int, Path], capsys: pytest.CaptureFixture[str]) -> None:
    _, out = run
    assert main(["metrics", str(out), "--check"]) == 0, capsys.readouterr().err


def test_three_robots_drive_over_can_and_three_over_serial(run: tuple[int, Path]) -> None:
    from contract.arena import load

    arena = load(run[1] / "config.toml")
    assert [robot.wheels["kind"] for robot in arena.robots.values()] == ["odrive", "roboclaw"] * 3
