"""The recorder as a process: killed, ended, started again."""

import errno
import gc
import os
import resource
import signal
import subprocess
import sys
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import pytest
import zenoh

from contract import network
from contract.arena import Arena, parse, table_of
from contract.codec import decode, encode
from contract.keys import Keys
from contract.messages import LogEntry, RunStatus, TargetCloud
from groundstation.files import RECORDING
from groundstation.ports import free_ports
from groundstation.recorder import COMMIT_S, Reel
from groundstation.recording import Recording, RecordingError
from groundstation.recover import recover
from groundstation.rig import write_config
from tests.groundstation.runs import arena_of, until

KEYS = Keys("made")


@pytest.fixture
def arena(tmp_path: Path) -> Arena:
    table = table_of(arena_of())
    table["link"] = {"router": f"tcp/127.0.0.1:{free_ports(1)[0]}"}
    made = parse(table, "test")
    write_config(made, tmp_path / "config.toml")
    return made


@pytest.fixture
def router(arena: Arena) -> Iterator[Any]:
    config = zenoh.Config()
    for key, value in network.router_config(arena.link.router):
        config.insert_json5(key, value)
    with zenoh.open(config) as session:
        yield session


@contextmanager
def recorder(folder: Path, stderr: IO[bytes] | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """A recorder that has said READY; killed on leaving."""
    command = [
        sys.executable,
        "-m",
        "groundstation",
        "record",
        "--arena",
        str(folder / "config.toml"),
        "--out",
        str(folder),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"READY recorder\n"
            yield process
        finally:
            process.kill()


def say(session: Any, first: int, last: int) -> None:
    for number in range(first, last):
        session.put(KEYS.status, encode(RunStatus(stamp_ns=number, phase="running")))


def stamps(path: Path) -> list[int]:
    with suppress(RecordingError):
        return [m.message.stamp_ns for m in Recording(path).messages() if isinstance(m.message, RunStatus)]
    return []


def test_killed_it_leaves_all_but_the_last_second(arena: Arena, router: Any, tmp_path: Path) -> None:
    assert COMMIT_S <= 1.0
    path = tmp_path / "run.mcap"
    with recorder(tmp_path) as process:
        say(router, 0, 300)
        until(lambda: stamps(path) == list(range(300)), "300 messages on the disk while the recorder runs")
        say(router, 300, 310)
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert not Recording(path).whole
    found = recover(path, tmp_path / "whole.mcap")
    assert found.messages >= 300
    assert stamps(tmp_path / "whole.mcap")[:300] == list(range(300))
    recovered = Recording(tmp_path / "whole.mcap")
    assert recovered.whole
    assert recovered.arena() == arena
    assert recovered.metadata["run"]["arena"] == "made"


def test_it_outlives_a_full_disk_that_its_own_log_is_on(arena: Arena, router: Any, tmp_path: Path) -> None:
    levels: list[str] = []
    router.declare_subscriber(
        KEYS.log("recorder"), lambda s: levels.append(decode(LogEntry, s.payload.to_bytes()).level)
    )
    path = tmp_path / "run.mcap"
    with Path("/dev/full").open("wb") as full, recorder(tmp_path, full) as process:
        say(router, 0, 5)
        until(lambda: stamps(path) == list(range(5)), "5 messages on the disk")
        _, most = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (1, most))
        say(router, 5, 10)
        until(lambda: "error" in levels, "the recorder tells of its trouble")
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (most, most))
        say(router, 10, 15)
        until(lambda: stamps(path) == list(range(15)), "all of it on the disk")
        assert process.poll() is None


def test_terminated_it_finishes_the_file(arena: Arena, router: Any, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with recorder(tmp_path) as process:
        say(router, 0, 5)
        router.put("made/no/key/of/ours", b"?")
        router.put(KEYS.status, b"not JSON")
        until(lambda: len(stamps(path)) == 5, "5 messages on the disk")
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 0
    ended = Recording(path)
    assert ended.whole
    assert ended.metadata["recorder"]["unknown_keys"] == "1"
    assert ended.metadata["recorder"]["undecodable"] == "1"
    assert ended.metadata["recorder"]["dropped"] == "0"


def test_started_again_it_keeps_the_earlier_recording(arena: Arena, router: Any, tmp_path: Path) -> None:
    for first in (0, 100):
        with recorder(tmp_path) as process:
            say(router, first, first + 3)
            until(lambda: len(stamps(tmp_path / "run.mcap")) == 3, "3 messages on the disk")
            process.send_signal(signal.SIGTERM)
            assert process.wait() == 0
    earlier = list(tmp_path.glob("run-until-*.mcap"))
    assert [stamps(path) for path in earlier] == [[0, 1, 2]]
    assert stamps(tmp_path / "run.mcap") == [100, 101, 102]


def test_it_reports_size_and_rate(arena: Arena, router: Any, tmp_path: Path) -> None:
    subscriber = router.declare_subscriber(KEYS.log("recorder"), zenoh.handlers.FifoChannel(16))
    with recorder(tmp_path):
        sample = subscriber.recv()
    text = sample.payload.to_bytes()
    assert b"bytes_per_s" in text
    assert b"disk_free_bytes" in text


def test_an_unwritable_folder_is_told(arena: Arena, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    command = [sys.executable, "-m", "groundstation", "record", "--arena", str(tmp_path / "config.toml")]
    done = subprocess.run([*command, "--out", str(tmp_path / "file")], capture_output=True, text=True, env=os.environ)
    assert done.returncode == 1
    assert "file" in done.stderr
    assert "Traceback" not in done.stderr


def test_targets_first_heard_while_robots_run_are_the_running_mission(tmp_path: Path) -> None:
    arena = arena_of()
    write_config(arena, tmp_path / "config.toml")
    reel = Reel(tmp_path, arena, (tmp_path / "config.toml").read_bytes())
    running = (KEYS.status, encode(RunStatus(stamp_ns=1, phase="running")), 1)
    reel.write([running, (KEYS.targets, encode(TargetCloud(mission="a", targets=())), 1)], 0)
    reel.tape.close(0)
    assert reel.tape.path.parent == tmp_path


def test_a_repeated_mission_gets_a_run_folder_of_its_own(tmp_path: Path) -> None:
    arena = arena_of()
    out = tmp_path / "lab"
    (tmp_path / "lab-2").mkdir()
    out.mkdir()
    write_config(arena, tmp_path / "config.toml")
    reel = Reel(out, arena, (tmp_path / "config.toml").read_bytes())
    told = [(KEYS.targets, encode(TargetCloud(mission=name, targets=())), 1) for name in ("a", "b", "b", "c", "c")]
    running = (KEYS.status, encode(RunStatus(stamp_ns=1, phase="running")), 1)
    first = weakref.ref(reel.tape)
    reel.write([told[0], told[1], running], 0)
    assert reel.tape.path.parent == out, "targets may change before the start"
    reel.write([told[2], running, told[3], told[4]], 0)
    reel.tape.close(0)
    assert reel.tape.path.parent.name == "lab-3"
    assert not reel.troubles
    gc.collect()
    assert first() is None, "a finished recording takes no memory"

    def missions(folder: str) -> list[str]:
        recording = Recording(tmp_path / folder / "run.mcap")
        assert recording.whole
        return [m.message.mission for m in recording.messages() if isinstance(m.message, TargetCloud)]

    assert missions("lab") == ["a", "b", "b"]
    assert missions("lab-3") == ["c", "c"]
    assert (tmp_path / "lab-3" / "config.toml").read_bytes() == (tmp_path / "config.toml").read_bytes()


def test_the_first_messages_are_on_the_disk_at_once(tmp_path: Path) -> None:
    arena = arena_of()
    write_config(arena, tmp_path / "config.toml")
    reel = Reel(tmp_path, arena, (tmp_path / "config.toml").read_bytes())
    assert not list(Recording(tmp_path / RECORDING).messages())
    reel.write([(KEYS.targets, encode(TargetCloud(mission="a", targets=())), 1)], 0)
    assert len(list(Recording(tmp_path / RECORDING).messages())) == 1, "though no second has passed"
    reel.write([(KEYS.targets, encode(TargetCloud(mission="a", targets=())), 2)], 0)
    assert len(list(Recording(tmp_path / RECORDING).messages())) == 1
    reel.tape.close(0)


def test_a_run_for_which_there_is_no_room_leaves_no_folder_and_goes_into_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arena = arena_of()
    out = tmp_path / "lab"
    out.mkdir()
    write_config(arena, out / "config.toml")
    reel = Reel(out, arena, (out / "config.toml").read_bytes())
    told = {name: (KEYS.targets, encode(TargetCloud(mission=name, targets=())), 1) for name in "ab"}
    reel.write([told["a"], (KEYS.status, encode(RunStatus(stamp_ns=1, phase="running")), 1)], 0)

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    descriptors = len(os.listdir("/proc/self/fd"))
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        reel.write([told["b"]], 0)
    assert "No space left" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["lab"]
    assert len(os.listdir("/proc/self/fd")) == descriptors
    reel.tape.close(0)
    assert len(list(Recording(out / RECORDING).messages())) == 3
