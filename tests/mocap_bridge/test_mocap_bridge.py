"""The bridge end to end: UDP in, Zenoh out, one process and loopback; and the command by itself."""

import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from contract import network
from contract.arena import Arena
from contract.codec import decode
from contract.keys import Keys
from contract.messages import LogEntry, MocapFrame, MocapHealth
from groundstation.ports import free_ports
from mocap_bridge.bridge import Bridge
from mocap_bridge.mock.bodies import settings_of
from mocap_bridge.mock.script import parse
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.mock.udp import ServerShell
from mocap_bridge.network import is_local, open_session
from mocap_bridge.sources.choose import SourceError, open_source
from tests.mocap_bridge.lockstep import arena, circling

LIMIT_S = 15.0


def on_free_ports(site: Arena) -> Arena:
    command, data, tcp = free_ports(3)
    mocap = msgspec.structs.replace(site.mocap, command_port=command, data_port=data)
    link = msgspec.structs.replace(site.link, router=f"tcp/127.0.0.1:{tcp}")
    return msgspec.structs.replace(site, mocap=mocap, link=link)


class Loop:
    """Server, bridge and subscribers in turn, in one thread."""

    def __init__(self, site: Arena, faults: str = "") -> None:
        self.arena = on_free_ports(site)
        self.keys = Keys(site.arena.name)
        self.joined = open_session(self.arena.link.router)
        config = zenoh.Config()
        for key, value in network.client_config(self.arena.link.router):
            config.insert_json5(key, value)
        self.client = zenoh.open(config)
        self.received = self.client.declare_subscriber(self.keys.everything, zenoh.handlers.FifoChannel(10_000))
        self.source = open_source(self.arena)
        self.bridge = Bridge(self.arena, self.source, self.joined)
        settings = settings_of(self.arena, parse(faults))
        self.server = EmulatedServer(settings, [robot.body for robot in self.arena.robots.values()])
        self.shell: ServerShell | None = None
        self.frames: list[MocapFrame] = []
        self.health: list[MocapHealth] = []
        self.logs: list[LogEntry] = []
        self._poses = circling({name: robot.start for name, robot in self.arena.robots.items()})

    def serve(self) -> None:
        self.shell = ServerShell(self.server, "127.0.0.1")

    def turn(self) -> None:
        if self.shell:
            for fd in select.select(self.shell.fds(), [], [], 0)[0]:
                self.shell.on_readable(fd, time.monotonic_ns())
            now_ns = time.monotonic_ns()
            if now_ns >= self.shell.next_due_ns:
                self.shell.stream(now_ns, self._poses(self.server.elapsed_s(now_ns)))
        self.source.wait(0.001)
        self.bridge.turn(time.monotonic_ns())
        while (sample := self.received.try_recv()) is not None:
            kind = self.keys.kind(str(sample.key_expr))
            assert kind is not None
            message = decode(kind, bytes(sample.payload))
            for wanted, store in ((MocapFrame, self.frames), (MocapHealth, self.health), (LogEntry, self.logs)):
                if isinstance(message, wanted):
                    store.append(message)  # type: ignore[arg-type]

    def until(self, done: object) -> None:
        limit = time.monotonic() + LIMIT_S
        while not done():  # type: ignore[operator]
            assert time.monotonic() < limit, (self.health[-1:], len(self.frames))
            self.turn()

    def close(self) -> None:
        if self.shell:
            self.shell.close()
        self.source.close()
        self.client.close()
        self.joined.close()


@pytest.fixture
def loops() -> Iterator[list[Loop]]:
    made: list[Loop] = []
    yield made
    for loop in made:
        loop.close()


@pytest.mark.parametrize("group", ["", "239.255.42.98"], ids=["unicast", "multicast"])
def test_frames_arrive_whole_over_the_network(loops: list[Loop], group: str) -> None:
    loop = Loop(arena(multicast_group=group, frame_rate_hz=200.0))
    loops.append(loop)
    loop.until(lambda: loop.health)
    assert loop.health[0].state == "connecting"
    loop.serve()
    loop.until(lambda: len(loop.frames) >= 50 and loop.health[-1].state == "ok")
    frame = loop.frames[-1]
    assert [body.robot for body in frame.bodies] == ["r06", "r08", "r09"]
    assert all(body.valid for body in frame.bodies)
    assert frame.exposure_ns <= frame.publish_ns
    assert [f.frame for f in loop.frames] == sorted({f.frame for f in loop.frames})
    assert any(entry.event == "mocap_ok" for entry in loop.logs)
    assert loop.health[-1].source == "Emulated Motive"


def test_program_of_the_documentation_feeds_the_bridge(loops: list[Loop]) -> None:
    text = (Path(__file__).parents[2] / "docs" / "mocap.md").read_text(encoding="utf-8")
    program = text.partition("```python\n")[2].partition("```")[0]
    loop = Loop(arena({"r06": (2.0, 2.0)}, source="external"))
    loops.append(loop)
    loop.source.attach(loop.joined.session)  # type: ignore[attr-defined]
    assert "tcp/127.0.0.1:7447" in program
    sender = subprocess.Popen(
        [sys.executable, "-c", program.replace("tcp/127.0.0.1:7447", loop.arena.link.router)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
    )
    try:
        loop.until(lambda: len(loop.frames) >= 20)
    finally:
        sender.kill()
        sender.wait()
    assert {body.valid for frame in loop.frames for body in frame.bodies} == {True}
    assert loop.frames[-1].bodies[0].robot == "r06"


def test_datagram_from_elsewhere_is_not_heard(loops: list[Loop]) -> None:
    loop = Loop(arena())
    loops.append(loop)
    loop.serve()
    loop.until(lambda: loop.frames)
    command = loop.source._command  # type: ignore[attr-defined]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.9", 0))
        stranger.sendto(b"\x07\x00\x00\x00", command.getsockname())
        loop.until(lambda: loop.source.status().counters.get("foreign_sender"))
    assert loop.source.status().malformed == 0


def test_mangled_datagram_is_counted_and_the_stream_goes_on(loops: list[Loop]) -> None:
    loop = Loop(arena())
    loops.append(loop)
    loop.serve()
    loop.until(lambda: loop.frames)
    loop.shell._data.sendto(b"\x07\x00\x10\x00garbage", loop.source._command.getsockname())  # type: ignore
    before = len(loop.frames)
    loop.until(lambda: loop.source.status().malformed == 1 and len(loop.frames) > before + 5)
    loop.until(lambda: loop.health and loop.health[-1].malformed == 1)


def test_source_faults_name_the_key() -> None:
    with pytest.raises(SourceError, match=r"mocap.local_address = 203.0.113.7"):
        open_source(arena(local_address="203.0.113.7"))
    with pytest.raises(SourceError, match=r"mocap.version: NatNet 9.9 is not supported"):
        open_source(arena(version="9.9"))


def test_local_router_addresses_are_recognised() -> None:
    assert is_local("tcp/127.0.0.1:7447")
    assert is_local("quic/localhost:7447?mixed_rel=1")
    assert not is_local("tcp/203.0.113.7:7447")
    assert not is_local("tcp/no.such.host.invalid:7447")


def arena_file(path: Path, site: Arena) -> Path:
    lines = [
        f'[arena]\nname = "lab"\nsize_m = [4.0, 5.0]\n[link]\nrouter = "{site.link.router}"',
        f"[mocap]\ncommand_port = {site.mocap.command_port}\ndata_port = {site.mocap.data_port}",
    ]
    for name, robot in site.robots.items():
        lines.append(f'[robots.{name}]\nbody = "{name}"\nstart = {list(robot.start)}\nwheels = {{kind = "odrive"}}')
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_run_is_ready_without_a_server_and_ends_on_a_signal(tmp_path: Path, number: signal.Signals) -> None:
    path = arena_file(tmp_path / "arena.toml", on_free_ports(arena()))
    process = subprocess.Popen(
        [sys.executable, "-m", "mocap_bridge", "run", "--arena", str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "READY mocap_bridge\n"
        process.send_signal(number)
        assert process.wait(10) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
    finally:
        process.kill()
        process.communicate()


def test_bad_arena_is_bad_input(tmp_path: Path) -> None:
    for verb in (["run", "--arena"], ["check"], ["emulate", "--arena"]):
        done = subprocess.run(
            [sys.executable, "-m", "mocap_bridge", *verb, str(tmp_path / "none.toml")],
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
        assert done.returncode == 2
        assert "No such file" in done.stderr


def test_emulate_and_check_by_themselves(tmp_path: Path) -> None:
    path = arena_file(tmp_path / "arena.toml", on_free_ports(arena()))
    run = [sys.executable, "-m", "mocap_bridge"]
    checked = subprocess.run([*run, "check", str(path)], capture_output=True, text=True, timeout=30, check=True)
    assert "body     'r06' is r06" in checked.stdout
    script = tmp_path / "faults.txt"
    script.write_text("0 1 drop\n")
    emulated = subprocess.run(
        [*run, "emulate", "--arena", str(path), "--script", str(script), "--seconds", "0.2"],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    assert emulated.stdout.startswith("READY emulate\n")
