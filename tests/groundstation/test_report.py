"""Figures and report of a made-up run: files, what they show, and that they stand alone."""

import csv
import re
from pathlib import Path

import msgspec
import pytest

from contract.keys import Keys
from contract.messages import LogEntry, RobotReport
from groundstation import cli
from groundstation.history import History
from groundstation.page import _handling
from groundstation.recording import Recording
from groundstation.report import finish
from groundstation.runfolder import read
from groundstation.scenes import Film, clock, label
from tests.groundstation.runs import MS, START_NS, Sent, arena_of, chain, mission, record

ARENA = arena_of(robots=4, targets=4)


def links(k: int) -> dict[int, set[int]]:
    """Four robots in a ring of links; 0-3 is removed at frame 150."""
    ring = chain(4)
    if k < 150:
        ring[0].add(3)
        ring[3].add(0)
    return ring


def place(i: int, k: int) -> tuple[float, float]:
    """A square of 0.5 m that drifts north, stretched to 0.9 m on one side from frame 150."""
    x, y = [(0.5, 0.5), (1.0, 0.5), (1.0, 1.0), (0.5, 1.0)][i]
    return x + (0.4 if i in (1, 2) and k >= 150 else 0.0), y + 0.004 * k


SENT = mission(ARENA, frames=250, place=place, links=links, every=50)


def film_of(sent: list[Sent]) -> Film:
    history = History(ARENA)
    for _, message, _ in sent:
        history.receive(message)
    span = history.mission()
    assert span is not None
    return Film(history, span)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run")
    record(path, ARENA, SENT)
    assert finish(path) == []
    return path


def test_six_scenes_in_order() -> None:
    scenes = film_of(SENT).six()
    assert len(scenes) == 6
    assert [s.seconds for s in scenes] == sorted(s.seconds for s in scenes)
    assert scenes[0].caption == "Start: 4 links"
    assert scenes[-1].caption == "End: 4 targets done"
    assert "1 reaches the first target" in [s.caption for s in scenes]
    assert "Before 1-4 goes" in [s.caption for s in scenes]


def test_links_are_kept_critical_or_removed() -> None:
    film = film_of(SENT)
    before, after = film.scene(100), film.scene(200)
    assert (before.kept, before.critical, before.removed) == ({(0, 1), (1, 2), (2, 3), (0, 3)}, set(), set())
    assert (after.kept, after.critical, after.removed) == ({(1, 2)}, {(0, 1), (2, 3)}, {(0, 3)})
    assert after.done == {0, 1, 2}
    assert film.scene(60).done == {0}
    assert after.lambda2 == pytest.approx(2 - 2**0.5)


def test_lambda2_of_every_frame() -> None:
    values = film_of(SENT).lambda2()
    assert values.shape == (250,)
    assert values[0] == pytest.approx(4.0)  # the square's diagonal of 0.71 m is in reach, too
    assert values[-1] == pytest.approx(2.0)  # 0.9 m by 0.5 m: the diagonal of 1.03 m is not


def test_files(folder: Path) -> None:
    for name in ("trajectories", "topology", "lambda2"):
        assert (folder / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (folder / "figures" / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    manifest = msgspec.json.decode((folder / "manifest.json").read_bytes())
    assert {"run.mcap", "config.toml", "metrics.json", "metrics.csv", "report.html"} <= manifest["files"].keys()
    assert manifest["seed"] == "42"
    assert Recording(folder / "run.mcap").whole


def test_the_page_stands_alone(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    assert "All 4 targets in 0:02.5" in text
    assert "never split" in text
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    assert "<script" not in text
    assert "a &lt;warning&gt;" in text


def test_warnings_that_differ_in_their_numbers_are_one_line(tmp_path: Path) -> None:
    arena = arena_of()
    keys = Keys(arena.arena.name)
    entries = [
        LogEntry(stamp_ns=START_NS + k * MS, level="warning", source="bridge", event="rate", text=f"{100 + k} frames/s")
        for k in range(5)
    ]
    record(tmp_path, arena, mission(arena) + [(keys.log("bridge"), entry, entry.stamp_ns) for entry in entries])
    finish(tmp_path)
    text = (tmp_path / "report.html").read_text()
    assert text.count("frames/s</td>") == 1
    assert "<td>5</td>" in text


def test_runs_are_compared_on_a_page_that_stands_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k, ending in enumerate(("completed", "completed", "stopped")):
        (tmp_path / str(k)).mkdir()
        record(tmp_path / str(k), arena_of(), mission(arena_of(), frames=100 + k, ending=ending))
    page = tmp_path / "comparison.html"
    assert cli.main(["report", *(str(tmp_path / str(k)) for k in range(3)), "--page", str(page)]) == 0
    text = page.read_text()
    assert "3 runs compared" in text
    assert "±" in text
    assert "2 of 3 runs" in text
    assert "1 split, collided or stayed incomplete" in text
    assert not re.search(r"(src|href)=\"(?!data:)", text)


def test_the_table_has_every_number(folder: Path) -> None:
    with (folder / "metrics.csv").open(newline="") as stream:
        table = dict(csv.reader(stream))
    assert table["loop.r01.rate_hz"] == "100.0"
    assert table["robots.r03.targets"] == "1"
    assert table["occupied"] == "4"


def test_a_failed_mission_is_reported_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def apart(i: int, k: int) -> tuple[float, float]:
        x, y = place(i, k)
        return (x + 1.5 if i == 1 and k >= 60 else x), y

    record(tmp_path, ARENA, mission(ARENA, frames=70, place=apart, links=links, ending="stopped"))
    reasons = finish(tmp_path)
    assert len(reasons) == 2
    assert "network split" in reasons[1]
    text = (tmp_path / "report.html").read_text()
    assert "The network split" in text
    assert "stopped after" in text


def test_without_a_mission_there_is_no_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record(tmp_path, ARENA, SENT[:3])
    assert cli.main(["report", str(tmp_path)]) == 1
    assert "no mission was started" in capsys.readouterr().err
    assert cli.main(["report", str(tmp_path / "none")]) == 2


@pytest.mark.parametrize(
    ("seconds", "decimals", "text"), [(65, 0, "1:05"), (59.99, 0, "0:59"), (65.34, 1, "1:05.3"), (0.0, 1, "0:00.0")]
)
def test_clock(seconds: float, decimals: int, text: str) -> None:
    assert clock(seconds, decimals) == text


@pytest.mark.parametrize(("robot", "text"), [("r06", "6"), ("r14", "14"), ("leader", "leader"), ("r", "r")])
def test_label(robot: str, text: str) -> None:
    assert label(robot) == text


def test_faults_are_told_with_their_remedy_and_how_long_they_lasted(tmp_path: Path) -> None:
    arena = arena_of()
    keys = Keys(arena.arena.name)
    sent = mission(arena)
    for late_ms, run, reason in (
        (105, "holding", "pose <stale>"),
        (155, "holding", "pose <stale>"),
        (405, "running", ""),
    ):
        report = RobotReport(
            robot="r02", boot=1, stamp_ns=START_NS + late_ms * MS, run=run, reason=reason, remedy="clear the view"
        )  # fmt: skip
        sent.append((keys.report("r02"), report, START_NS + late_ms * MS))
    sent = [
        e for e in sent if not (isinstance(e[1], RobotReport) and e[1].robot == "r02" and e[1].run == "running")
    ] + [e for e in sent if isinstance(e[1], RobotReport) and e[1].stamp_ns == START_NS + 405 * MS]
    record(tmp_path, arena, sorted(sent, key=lambda entry: entry[2]))
    told = _handling(read(tmp_path))
    assert told.count("<tr>") == 2, "the head, and one fault however often reported"
    for words in ("+0.10 s", "holding", "pose &lt;stale&gt;", "clear the view", "0.30 s"):
        assert words in told
    assert _handling(read(record(tmp_path / "good", arena, mission(arena)))) == ""
