"""The command line: every verb explains itself, mistakes are named, topics are those of the contract."""

from pathlib import Path

import pytest

from contract.messages import LogEntry, LoopTiming, MocapHealth, RobotReport, RunStatus
from contract.network import QOS
from groundstation import cli
from groundstation.topics import page, topics
from groundstation.watch import Watch, render
from tests.groundstation.runs import arena_of

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("verb", cli.VERBS)
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([verb, "--help"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: ahdc-groundstation {verb}")


def test_overview_names_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {verb} " in text for verb in cli.VERBS)
    assert cli.main([]) == 2


def test_a_mistyped_verb_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["recrod"]) == 2
    assert "did you mean 'record'?" in capsys.readouterr().err


def test_a_mistyped_option_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["topics", "--mark"]) == 2


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(cli.VERBS, "topics", cli.Verb("no_such_package.x", "", ""))
    assert cli.main(["topics"]) == 1
    assert "needs no_such_package" in capsys.readouterr().err


def test_a_faulty_arena_file_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.toml").write_text("[arena]\nnam = 1\n")
    assert cli.main(["record", "--arena", str(tmp_path / "a.toml"), "--out", str(tmp_path)]) == 2
    assert 'did you mean "name"?' in capsys.readouterr().err


def test_the_page_of_topics_is_the_code() -> None:
    assert (ROOT / "docs" / "topics.md").read_text() == page(), (
        "run: ahdc-groundstation topics --markdown > docs/topics.md"
    )


def test_every_channel_is_a_topic(capsys: pytest.CaptureFixture[str]) -> None:
    listed = list(topics())
    assert [topic.channel for topic in listed] == list(QOS)
    assert len({topic.key for topic in listed}) == len(QOS)
    assert cli.main(["topics"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(QOS)


def report(robot: str, **changes: object) -> RobotReport:
    timing = LoopTiming(nominal_hz=100.0, rate_hz=99.8, jitter_ms=0.4, steps=100, misses=2)
    fields = {
        "run": "running",
        "pose_age_ms": 8.0,
        "pose_valid": True,
        "task": "tracking",
        "claim": 4,
        "timing": timing,
    }
    return RobotReport(robot=robot, boot=1, stamp_ns=1, **(fields | changes))  # type: ignore[arg-type]


def test_watch_says_why_a_robot_is_not_well() -> None:
    watch = Watch(arena_of(robots=3))
    watch.receive(report("r01"), 10.0)
    watch.receive(report("r02", run="fault", reason="pose lost", remedy="clear the cameras' view"), 10.0)
    well, faulty, silent = watch.rows(10.5)
    assert (well.well, well.task, well.age, well.rate, well.misses) == (True, "tracking 5", "8 ms", "99.8/100 Hz", "2")
    assert (faulty.well, faulty.reason) == (False, "pose lost; clear the cameras' view")
    assert (silent.state, silent.well) == ("SILENT", False)
    assert watch.rows(12.0)[0].reason.startswith("silent for 2.0 s")


def test_watch_shows_progress_network_and_recorder() -> None:
    from rich.console import Console

    watch = Watch(arena_of())
    assert "no station session" in watch.headline(0.0)
    status = RunStatus(
        stamp_ns=1, phase="running", elapsed_s=65.0, targets=19, occupied=(3, 4), lambda2=0.5, components=1
    )
    watch.receive(status, 10.0)
    watch.receive(MocapHealth(stamp_ns=1, state="ok", rate_hz=120.0), 10.0)
    watch.receive(LogEntry(stamp_ns=1, level="info", source="recorder", event="recording", text="2.0 MB"), 10.0)
    console = Console(width=140, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(render(watch, 10.1))
    text = console.export_text()
    for word in ("RUNNING", "2/19 targets", "1:05.0", "one piece", "mocap ok, 120 Hz", "recorder: 2.0 MB", "r03"):
        assert word in text
    assert "no station session" in watch.headline(12.0)
