"""Missions in virtual time: repeatable bit for bit, and a slice of the seeds that must stay whole and clear."""

from pathlib import Path

import msgspec
import pytest

from groundstation.cli import main
from groundstation.simulate import Job, play


@pytest.mark.parametrize("conditions", ["ideal", "field"])
def test_same_seed_same_run(conditions: str) -> None:
    job = Job(6, 19, 5, "field", conditions, limit_s=4.0)
    first, second = (msgspec.json.encode(play(job)) for _ in range(2))
    assert first == second
    assert first != msgspec.json.encode(play(job._replace(seed=6)))


def test_verb_writes_the_same_file_twice(tmp_path: Path) -> None:
    words = ["simulate", "--robots", "3", "--targets", "4", "--runs", "2", "--seed", "3", "--json"]
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
