"""A sweep on a Dask cluster gives the very bytes it gives here, and refuses workers with other code."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster

from groundstation import cluster
from groundstation.cli import main

SWEEP = ["simulate", "--robots", "2", "--targets", "1", "--runs", "3", "--seed", "11", "--limit-s", "40"]


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    quiet = {"dashboard_address": None, "worker_dashboard_address": None}
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", **quiet) as local:
        yield local.scheduler_address


def test_two_workers_give_the_same_bytes(address: str, tmp_path: Path) -> None:
    here, there = tmp_path / "here.json", tmp_path / "there.json"
    codes = [main([*SWEEP, "--json", str(here)]), main([*SWEEP, "--json", str(there), "--cluster", address])]
    assert codes == [0, 0]
    assert here.read_bytes() == there.read_bytes()


def test_workers_with_other_code_are_refused(
    address: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "fingerprint", str)
    assert main([*SWEEP, "--cluster", address]) == 2
    assert "2 of 2 workers run other code" in capsys.readouterr().err


def test_no_workers_is_told() -> None:
    with pytest.raises(ConnectionError, match="no workers"):
        cluster._check({}, "tcp://127.0.0.1:1")


def test_no_scheduler_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    assert main([*SWEEP, "--cluster", "tcp://127.0.0.1:9"]) == 2
    assert "no scheduler answers" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--save", "out"], ["--workers", "2"]])
def test_what_cannot_go_together_is_told(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SWEEP, "--cluster", "tcp://127.0.0.1:9", *words]) == 2
    assert words[0] in capsys.readouterr().err
