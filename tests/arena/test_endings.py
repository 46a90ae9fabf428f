"""However the demo ends, nothing is left behind: no process, no pty, no moving wheel; the recording is readable."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.cli import main
from groundstation.processes import Child, ChildError, Family, kin
from tests.arena.conftest import PATIENCE_S, ROOT, alive

END_S = 2.0


def wait(done: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    deadline = time.monotonic() + patience_s
    while not done():
        if time.monotonic() > deadline:
            pytest.fail(f"not within {patience_s:g} s: {what}")
        time.sleep(0.01)


def children_of(pid: int) -> dict[int, str]:
    """Process id to command line, children's children as well."""
    found = {}
    for number in kin(pid):
        found[number] = Path(f"/proc/{number}/cmdline").read_bytes().replace(b"\0", b" ").decode()
        found |= children_of(number)
    return found


def heeding_ctrl_c() -> None:
    """Also where the tests themselves run in the background of a shell, which then ignores SIGINT for all it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Demo:
    """``demo`` as a person starts it, its output in a file."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self._said = out.with_suffix(".txt")
        words = ["demo", "--headless", "--robots", "2", "--targets", "30", "--seed", "2", "--out", str(out)]
        with self._said.open("w") as sink:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "groundstation", *words],
                cwd=ROOT,
                stdout=sink,
                stderr=subprocess.STDOUT,
                process_group=0,
                preexec_fn=heeding_ctrl_c,
            )

    def said(self) -> str:
        return self._said.read_text()

    def ptys(self) -> list[Path]:
        return [entry.resolve() for entry in (self.out / "ports").iterdir()]

    def gone(self, children: dict[int, str], ptys: list[Path]) -> None:
        wait(lambda: not any(alive(pid) for pid in children), f"all ended: {children}", END_S)
        wait(lambda: not any(pty.exists() for pty in ptys), f"no pty left of {ptys}", END_S)


@pytest.fixture
def demo(tmp_path: Path):
    running = Demo(tmp_path / "run")
    yield running
    if running.process.poll() is None:
        running.process.kill()
        running.process.wait()


def started(demo: Demo) -> tuple[dict[int, str], list[Path]]:
    """Children and ptys of a demo whose robots move."""
    wait(lambda: " running " in demo.said() or demo.process.poll() is not None, "the mission runs")
    assert demo.process.poll() is None, demo.said()
    children, ptys = children_of(demo.process.pid), demo.ptys()
    assert len(children) == 6, children
    assert any("mocap_bridge.router" in words for words in children.values())
    assert len(ptys) == 2
    recorded = demo.out / "run.mcap"
    wait(lambda: recorded.exists() and recorded.stat().st_size > 400_000, "some seconds recorded")
    return children, ptys


def test_ctrl_c_in_the_middle(demo: Demo) -> None:
    children, ptys = started(demo)
    os.killpg(demo.process.pid, signal.SIGINT)
    demo.gone(children, ptys)
    assert demo.process.wait(END_S) == 130
    assert "Traceback" not in demo.said()
    assert not (demo.out / "ports").exists()
    readable(demo.out)


def test_kill_9_of_the_launcher(demo: Demo) -> None:
    children, ptys = started(demo)
    demo.process.kill()
    demo.gone(children, ptys)
    readable(demo.out)


def test_ctrl_c_while_starting(demo: Demo) -> None:
    wait(lambda: bool(children_of(demo.process.pid)), "the first child")
    children = children_of(demo.process.pid)
    demo.process.send_signal(signal.SIGINT)
    code = demo.process.wait(PATIENCE_S)
    demo.gone(children, [])
    assert code == 130, demo.said()
    assert "Traceback" not in demo.said()


def readable(out: Path) -> None:
    """``recover`` makes an indexed file of what was recorded, with poses and wheel commands in it."""
    done = subprocess.run(
        [sys.executable, "-m", "groundstation", "recover", str(out / "run.mcap"), "--out", str(out / "recovered.mcap")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    from mcap.reader import make_reader

    with (out / "recovered.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = {
        channel.topic: summary.statistics.channel_message_counts.get(number, 0)
        for number, channel in summary.channels.items()
    }
    assert any(topic.endswith("/mocap/frame") and count > 50 for topic, count in counts.items()), counts
    assert any("/motor/" in topic and count > 5 for topic, count in counts.items()), counts


def test_a_child_that_ends_at_its_start_is_named_with_its_last_words(tmp_path: Path) -> None:
    with Family() as family:
        family.start("nobody", "onboard", ["run", "--arena", "/no/such/file", "--robot", "r01"], tmp_path / "log")
        with pytest.raises(ChildError, match=r"nobody ended with code 2[\s\S]*no/such/file"):
            family.wait_ready(PATIENCE_S)


def test_a_child_that_ignores_sigterm_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "deaf.py").write_text(
        "import signal\nsignal.signal(15, signal.SIG_IGN)\nprint('READY', flush=True)\nsignal.pause()\n"
    )
    family = Family()
    family.children.append(Child("deaf", "deaf", [], tmp_path / "log"))
    family.wait_ready(PATIENCE_S)
    assert family.end() == {"deaf": -signal.SIGKILL}


@pytest.mark.parametrize(
    "words",
    [
        ["--arena", "no-such-arena"],
        ["--targets", "100000"],
        ["--robots", "0"],
        ["--seed", "-1"],
    ],
)
def test_bad_input_is_refused_before_anything_starts(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--headless", "--out", str(tmp_path / "run"), *words]) == 2
    assert capsys.readouterr().err.strip()
    assert not (tmp_path / "run").exists()
