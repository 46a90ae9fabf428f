"""What nobody can take is lost, and the process that says it goes on."""

import ast
import io
import os
from pathlib import Path

import pytest

from contract.voice import say
from tests.house.checkout import ROOT


def test_a_line_is_said_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    say("one")
    say("two", stream := io.StringIO())
    assert capsys.readouterr().err == "one\n"
    assert stream.getvalue() == "two\n"


def test_a_full_disk_a_closed_stream_and_a_pipe_that_nobody_reads_are_no_errors() -> None:
    closed = io.StringIO()
    closed.close()
    say("lost", closed)
    with Path("/dev/full").open("w", buffering=1) as full:
        say("lost", full)
        os.dup2(os.open(os.devnull, os.O_WRONLY), full.fileno())
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as pipe:
        say("lost", pipe)
        os.dup2(os.open(os.devnull, os.O_WRONLY), pipe.fileno())


def test_what_runs_while_robots_drive_prints_in_no_other_way() -> None:
    driving = [path for path in (ROOT / "onboard").rglob("*.py") if path.name not in ("cli.py", "doctor.py")]
    driving += (ROOT / "mocap_bridge").glob("*.py")
    for path in driving:
        calls = [node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
        assert not any(isinstance(name, ast.Name) and name.id == "print" for name in calls), path
