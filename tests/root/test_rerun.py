"""Recordings read by rerun's own command line: whole, cut off, and with robots, links and targets as its own things."""

import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from groundstation import cli
from groundstation.recording import Recording
from tests.groundstation.kept import KEPT
from tests.root.rerun_tool import program


def rerun(*words: str, good: bool = True) -> str:
    done = subprocess.run([program(), *words], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode == 0) == good, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def visual(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rerun") / "foxglove.mcap"
    assert cli.main(["foxglove", str(KEPT), "--out", str(path)]) == 0
    return path


def counts(path: Path) -> Counter[str]:
    return Counter(entry.key for entry in Recording(path).messages())


def listed(words: str) -> dict[str, tuple[int, str]]:
    """Topic to number of messages and encoding, as ``mcap info`` lists them."""
    rows = re.findall(r"^ *\d+  (\S+) +(\d+) .* (\w+)$", words, re.MULTILINE)
    return {topic: (int(number), encoding) for topic, number, encoding in rows}


def test_a_recording_is_read_with_every_message_of_every_topic(visual: Path) -> None:
    for path in (KEPT, visual):
        seen = listed(rerun("mcap", "info", str(path)))
        ours = {topic: number for topic, (number, encoding) in seen.items() if encoding == "json"}
        assert ours == counts(KEPT)
        checked = rerun("mcap", "check", "--full", str(path))
        assert len(re.findall(r"^ok ", checked, re.MULTILINE)) == len(seen)
    assert {topic for topic, (_, encoding) in seen.items() if encoding == "protobuf"} == {
        "/tf", "/scene", "/links", "/targets", "/log", "/robot/r01/pose", "/robot/r02/pose",
    }  # fmt: skip


def test_one_that_was_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(KEPT.read_bytes()[: KEPT.stat().st_size * 4 // 5])
    assert "recover" in rerun("mcap", "info", str(cut), good=False)
    seen = listed(rerun("mcap", "info", "--recover", str(cut)))
    assert {topic: number for topic, (number, _) in seen.items()} == counts(cut)


def test_robots_links_and_targets_become_things_that_rerun_draws(visual: Path) -> None:
    target = visual.with_suffix(".rrd")
    rerun("mcap", "convert", str(visual), "-o", str(target), "--timeline-type", "duration")
    drawn: dict[str, Counter[str]] = {}
    for rows, entity, columns in re.findall(
        r"with (\d+) rows .* - (/\S+) - data columns: \[(.*)\]", rerun("rrd", "print", str(target))
    ):
        for column in columns.split():
            drawn.setdefault(entity, Counter())[column] += int(rows)
    shown = listed(rerun("mcap", "info", str(visual)))
    assert drawn["/links"]["Points3D:positions"] == shown["/links"][0] > 10
    assert drawn["/targets"]["Points3D:colors"] == shown["/targets"][0] > 0
    assert drawn["/robot/r01/pose"]["InstancePoses3D:translations"] == shown["/robot/r01/pose"][0] > 100
    assert drawn["/tf"]["Transform3D:translation"] == 2 * shown["/tf"][0]
    assert drawn["/log"]["TextLog:text"] == shown["/log"][0]
