"""The verb ``seed``: what it asks for, what it refuses, and that it waits until the session has it."""

import argparse
from pathlib import Path
from typing import Any

import pytest

from contract.arena import load
from contract.keys import Keys
from contract.messages import RunStatus, TargetCloud
from groundstation import seeding
from groundstation.page_seed import SeedError
from groundstation.rig import find_arena

ARENA = load(find_arena("experiment2"))


def wished(**words: object) -> TargetCloud:
    return seeding.wished(
        ARENA, argparse.Namespace(**{"points": None, "count": None, "file": None, "seed": 1} | words), "m"
    )


def test_points_a_cloud_or_a_file(tmp_path: Path) -> None:
    assert [(t.x_m, t.y_m) for t in wished(points=["1.0,2.0", "1.5,2.5"]).targets] == [(1.0, 2.0), (1.5, 2.5)]
    assert wished(count=7, seed=3) == wished(count=7, seed=3) != wished(count=7, seed=4)
    file = tmp_path / "targets.json"
    file.write_text("[[1.0, 2.0]]")
    assert len(wished(file=file).targets) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"points": ["9,9"]}, "beyond the fence"),
        ({"points": ["a,b"]}, "X,Y in metres"),
        ({"points": ["1"]}, "target 1"),
        ({"count": 0}, "1 to 1000"),
        ({"file": Path("no-such-file")}, "No such file"),
    ],
)
def test_what_cannot_be_is_named(words: dict[str, Any], said: str) -> None:
    with pytest.raises(SeedError, match=said):
        wished(**words)


class Site:
    """A link whose session takes targets after a while, or never."""

    def __init__(self, takes: int) -> None:
        self.keys, self.takes, self.sent = Keys("lab"), takes, 0

    def publish(self, key: str, message: TargetCloud, channel: str) -> None:
        assert key == self.keys.seed
        self.sent, self.wish = self.sent + 1, message

    def wait(self, wait_s: float) -> None: ...

    def drain(self) -> list[tuple[str, RunStatus]]:
        mission = self.wish.mission if self.sent >= self.takes else "old"
        return [("", RunStatus(stamp_ns=0, phase="running", mission=mission, targets=2))]


def test_it_asks_until_the_session_has_it(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    site: Any = Site(3)
    assert seeding.ask(site, wished(points=["1.0,2.0"])) == 0
    assert site.sent == 3
    monkeypatch.setattr(seeding, "ANSWER_S", 0.01)
    refused: Any = Site(1 << 60)
    assert seeding.ask(refused, wished(points=["1.0,2.0"])) == 1
    assert "only while disarmed" in capsys.readouterr().err
