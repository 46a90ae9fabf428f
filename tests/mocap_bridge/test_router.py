"""The router of a site without keys: READY or why not, gone with its bridge whatever ends that, mended if it dies."""

import errno
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
import zenoh

from contract.codec import encode
from contract.messages import ClockAsk
from groundstation.ports import free_ports
from mocap_bridge import router
from mocap_bridge.router import READY, Router, RouterError
from tests.mocap_bridge.lockstep import arena
from tests.mocap_bridge.test_mocap_bridge import Loop, arena_file, on_free_ports

LIMIT_S = 15.0
TAKEN = os.strerror(errno.EADDRINUSE)


def ended(pidfd: int) -> bool:
    """Whether the process is no more, soon."""
    return bool(select.select([pidfd], [], [], LIMIT_S)[0])


def endpoint_of(port: int) -> str:
    return f"tcp/127.0.0.1:{port}"


@contextmanager
def taken(port: int) -> Iterator[None]:
    with socket.create_server(("127.0.0.1", port)):
        yield


@pytest.fixture
def port() -> int:
    return free_ports(1)[0]


@pytest.fixture
def process(port: int) -> Iterator["subprocess.Popen[str]"]:
    """A router that has said READY."""
    command = [sys.executable, "-m", "mocap_bridge.router", endpoint_of(port)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as started:
        try:
            assert started.stdout is not None
            assert started.stdout.readline().strip() == READY
            yield started
        finally:
            started.kill()


def end_input(process: "subprocess.Popen[str]") -> None:
    assert process.stdin is not None
    process.stdin.close()


def test_process_is_deaf_to_signals_and_leaves_with_its_input(process: "subprocess.Popen[str]", port: int) -> None:
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGINT)
    end_input(process)
    assert process.wait(LIMIT_S) == 0
    with taken(port):
        pass


def test_connection_that_never_says_who_it_is_does_not_keep_it(process: "subprocess.Popen[str]", port: int) -> None:
    with socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S):
        end_input(process)
        assert process.wait(LIMIT_S) in (0, -signal.SIGALRM)
    with taken(port):
        pass


def test_its_threads_share_one_heap(process: "subprocess.Popen[str]") -> None:
    maps = Path(f"/proc/{process.pid}/maps").read_text().splitlines()
    starts = [int(line.split("-")[0], 16) for line in maps if "rw-p" in line]
    assert sum(start % (64 << 20) == 0 for start in starts) == 1


def test_address_that_is_left_in_a_moment_is_waited_for(port: int) -> None:
    script = f"""
import sys, zenoh
from mocap_bridge.router import serve
real, refusals = zenoh.open, ["{TAKEN}"] * 2
def late(config):
    if refusals:
        raise zenoh.ZError(refusals.pop())
    return real(config)
zenoh.open = late
sys.exit(serve("{endpoint_of(port)}"))
"""
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip() == READY
        end_input(process)
        assert process.wait(LIMIT_S) == 0


def test_address_of_no_use_is_refused_in_zenohs_words() -> None:
    with pytest.raises(RouterError, match="Unicast not supported for foo protocol"):
        Router("foo/127.0.0.1:7447")


def test_process_that_ends_without_a_word_is_no_router(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(RouterError, match="its process ended with code 1"):
        Router("tcp/127.0.0.1:7447")


class Running(NamedTuple):
    """A bridge that has said READY, and its router."""

    bridge: "subprocess.Popen[str]"
    router: int
    router_fd: int


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    path = arena_file(tmp_path / "arena.toml", on_free_ports(arena()))
    command = [sys.executable, "-m", "mocap_bridge", "run", "--arena", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as bridge:
        try:
            assert bridge.stdout is not None
            assert bridge.stdout.readline() == "READY mocap_bridge\n"
            (child,) = Path(f"/proc/{bridge.pid}/task/{bridge.pid}/children").read_text().split()
            descriptor = os.pidfd_open(int(child))
            yield Running(bridge, int(child), descriptor)
            os.close(descriptor)
        finally:
            bridge.kill()


@pytest.mark.parametrize("frozen", [False, True])
def test_bridge_that_is_killed_leaves_no_router_behind(running: Running, frozen: bool) -> None:
    if frozen:
        os.kill(running.router, signal.SIGSTOP)
    running.bridge.kill()
    assert ended(running.router_fd)


@pytest.mark.parametrize("frozen", [False, True])
def test_bridge_that_is_told_to_end_takes_its_router_with_it(running: Running, frozen: bool) -> None:
    if frozen:
        os.kill(running.router, signal.SIGSTOP)
    running.bridge.terminate()
    assert running.bridge.wait(LIMIT_S) == 0
    assert ended(running.router_fd)
    assert running.bridge.stderr is not None
    assert running.bridge.stderr.read() == ""


def test_second_bridge_on_a_site_is_refused(running: Running) -> None:
    done = subprocess.run(running.bridge.args, capture_output=True, text=True, timeout=LIMIT_S, check=False)  # type: ignore
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("link.router = tcp/127.0.0.1:")
    assert TAKEN in done.stderr
    assert running.bridge.poll() is None
    assert not select.select([running.router_fd], [], [], 0)[0]


def kill(child: Router) -> None:
    descriptor = os.pidfd_open(child.pid)
    os.kill(child.pid, signal.SIGKILL)
    assert ended(descriptor)
    os.close(descriptor)


def test_router_that_dies_is_begun_anew_and_the_frames_come_again(capfd: pytest.CaptureFixture[str]) -> None:
    loop = Loop(arena())
    try:
        loop.serve()
        loop.until(lambda: len(loop.frames) >= 5)
        first = loop.joined.router
        assert first is not None
        dead = first.pid
        kill(first)
        loop.until(lambda: first.pid != dead)
        seen = len(loop.frames)
        loop.until(lambda: len(loop.frames) > seen + 50)
        told = loop.client.declare_subscriber(loop.keys.clock_tell("r06"), zenoh.handlers.RingChannel(1))

        def answered() -> bool:
            loop.client.put(loop.keys.clock_ask("r06"), encode(ClockAsk(asked_ns=1)))
            return told.try_recv() is not None

        loop.until(answered)
    finally:
        loop.close()
    said = capfd.readouterr().err
    assert said.count("it begins anew") == 1
    assert f"the router at {loop.arena.link.router} ended with code -9" in said


def test_router_whose_address_another_one_took_meanwhile_ends_the_bridge(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(router, "PACE_S", 0.0)
    child = Router(endpoint_of(port))
    try:
        kill(child)
        with taken(port):
            child.tend()
            descriptor = os.pidfd_open(child.pid)
            assert ended(descriptor)
            os.close(descriptor)
            with pytest.raises(RouterError, match=TAKEN):
                child.tend()
    finally:
        child.close()


def test_router_that_dies_again_and_again_is_begun_now_and_then(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(router, "PACE_S", float("inf"))
    child = Router(endpoint_of(port))
    try:
        dead = child.pid
        kill(child)
        child.tend()
        assert child.pid == dead
        monkeypatch.setattr(router, "PACE_S", 0.0)
        child.tend()
        assert child.pid != dead
    finally:
        child.close()
