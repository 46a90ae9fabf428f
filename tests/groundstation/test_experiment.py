"""Experiments: the file, the order of trials, interruption and resumption, and what is aggregated."""

import csv
import json
from pathlib import Path

import pytest

from contract.arena import ArenaError
from groundstation import cli, stage_lockstep
from groundstation.experiment import ABORTED, Book, conduct, outcome
from groundstation.outcomes import Outcome, groups, table
from groundstation.sweep import Job, keep
from groundstation.trials import Trial, parse, trials

FILE = """
name = "small"
robots = [1, 2]
targets = [1]
seeds = [3, 4]
conditions = "ideal"
timeout_s = 60
"""


def test_every_combination_is_a_trial_and_repetitions_come_whole() -> None:
    text = 'name = "lab"\nbackend = "mock"\narena = "bench2"\ntargets = [3, 4]\nseeds = [1, 2]\nrepetitions = 2\n'
    found = trials(parse(text, "test"))
    assert [trial.name for trial in found[:4]] == ["m3-s1-k1", "m4-s1-k1", "m3-s2-k1", "m4-s2-k1"]
    assert [trial.repetition for trial in found] == [1] * 4 + [2] * 4
    assert len({trial.name for trial in found}) == 8
    assert trials(parse(FILE, "test"))[0] == Trial("field-n1-m1-s3-k1", 1, 1, "field", 3, 1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "a"', "robots: backend"),
        ('name = "a"\nrobot = [2]\nrobots = [2]', 'did you mean "robots"'),
        ('name = "a"\nrobots = [2]\nrepetitions = 2', "bit for bit"),
        ('name = "a"\nrobots = [2]\narena = "x"', "arena = x: not used"),
        ('name = "a"\nbackend = "robots"\narena = "x"\nprofiles = ["paper"]', "profiles"),
        ('name = "a"\nbackend = "mock"', "needs an arena file"),
        ('name = "a"\nrobots = [2, 2]', "every value once"),
        ('name = "a"\nrobots = [2]\nseeds = []', "at least one"),
        ('name = "A b"\nrobots = [2]', "name = "),
        ('name = "a"\nrobots = [2]\nprofiles = ["feild"]', 'profiles[0] = "feild": needs one of field, paper'),
        ("name = ", "not TOML"),
    ],
)
def test_faults_of_the_file_are_named(text: str, words: str) -> None:
    with pytest.raises(ArenaError) as caught:
        parse(text, "test")
    assert words in str(caught.value)


def run(tmp_path: Path) -> int:
    file = tmp_path / "small.toml"
    file.write_text(FILE)
    return cli.main(["experiment", str(file), "--out", str(tmp_path / "out")])


def test_interrupted_it_goes_on_with_the_trial_it_was_in_and_keeps_the_attempt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    played: list[tuple[int, int]] = []

    def interrupted(job: Job) -> object:
        played.append((job.robots, job.seed))
        if len(played) == 3:
            raise KeyboardInterrupt
        return keep(job)

    monkeypatch.setattr(stage_lockstep, "keep", interrupted)
    assert run(tmp_path) == 130
    assert "go on with: experiment" in capsys.readouterr().err
    assert run(tmp_path) == 0
    assert played == [(1, 3), (2, 3), (1, 4), (1, 4), (2, 4)]
    out = tmp_path / "out"
    rows = list(csv.DictReader((out / "trials.csv").open()))
    assert [row["ending"] for row in rows] == ["completed", "completed", "aborted", "completed", "completed"]
    assert rows[2]["folder"] == f"field-n1-m1-s4-k1{ABORTED}1"
    assert (out / rows[2]["folder"] / "trial.json").exists()
    found = json.loads((out / "summary.json").read_text())["groups"]
    assert [(g["robots"], g["trials"], g["aborted"]) for g in found] == [(1, 2, 1), (2, 2, 0)]
    assert found[0]["completed"]["value"] == 1.0
    assert found[0]["mission_s"]["low"] < found[0]["mission_s"]["value"] < found[0]["mission_s"]["high"]
    assert found[0]["mission_s"]["value"] == pytest.approx(
        sum(float(row["mission_s"]) for row in rows if row["robots"] == "1" and row["mission_s"]) / 2, abs=1e-6
    )
    text = capsys.readouterr().out
    assert "100% [34%, 100%]" in text
    assert run(tmp_path) == 0
    assert len(played) == 5, "nothing left to run"


def test_a_killed_experiment_keeps_what_was_under_way(tmp_path: Path) -> None:
    planned = trials(parse(FILE, "test"))[:1]
    book = Book(tmp_path / "out", FILE)
    (book.begin(planned[0]) / "run.mcap").write_text("half")

    class Stage:
        def play(self, trial: Trial, folder: Path) -> Outcome:
            assert not list(folder.iterdir())
            return outcome(trial, "failed", "split")

        def close(self) -> None:
            return

    found = conduct(Book(tmp_path / "out", FILE), planned, Stage())
    assert [(entry.ending, entry.why) for entry in found] == [
        ("aborted", "the experiment ended in it"),
        ("failed", "split"),
    ]
    assert (tmp_path / "out" / found[0].folder / "run.mcap").read_text() == "half"


def test_a_folder_of_another_experiment_is_refused(tmp_path: Path) -> None:
    Book(tmp_path, FILE)
    with pytest.raises(ArenaError, match="another experiment"):
        Book(tmp_path, FILE + "\n")


def test_a_trial_that_went_wrong_counts_against_its_group() -> None:
    trial = Trial("t", 5, 19, "field", 1, 1)
    bad = [outcome(trial, "timeout"), outcome(trial, "aborted"), outcome(trial, "error")]
    (group,) = groups(bad)
    assert (group.trials, group.aborted, group.completed.value) == (2, 1, 0.0)
    assert group.mission_s.value is None
    assert table([group])[1][5:9:3] == ("0% [0%, 66%]", "-")
