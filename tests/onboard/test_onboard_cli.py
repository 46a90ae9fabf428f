"""``ahdc-onboard``: what it says before any robot runs."""

import subprocess
import sys
from pathlib import Path

import pytest

from onboard.cli import main
from onboard.failsafes import markdown

ROOT = Path(__file__).parents[2]
ARENA = ROOT / "groundstation" / "arenas" / "bench2.toml"


def test_failsafes_prints_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["failsafes"]) == 0
    assert capsys.readouterr().out.strip() == markdown()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "--arena", "/no/such.toml", "--robot", "r06"], "/no/such.toml"),
        (["run", "--arena", str(ARENA), "--robot", "r07"], "robots.r07: not in the arena file"),
    ],
)
def test_bad_input_is_named(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [[], ["walk"], ["run"], ["run", "--arena", "x"], ["run", "--are", "x", "--robot", "y"]]
)
def test_wrong_words_are_bad_input(words: list[str]) -> None:
    with pytest.raises(SystemExit) as ending:
        main(words)
    assert ending.value.code == 2


@pytest.mark.parametrize("words", [("onboard", "failsafes"), ("groundstation", "topics")])
def test_a_reader_that_leaves_early_gets_no_traceback(words: tuple[str, ...]) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", *words], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
        assert process.wait(30) == 1
