"""Half an hour of motion capture with a random fault every three seconds: in virtual time, and over UDP and Zenoh."""

import itertools
import os
import random
import select
import subprocess
import sys
import time
import tracemalloc
from collections import deque
from pathlib import Path

import pytest
import zenoh

from contract import network
from contract.codec import decode
from contract.keys import Keys
from contract.messages import MocapFrame, MocapHealth
from groundstation.processes import kin
from mocap_bridge.mock.bodies import settings_of
from mocap_bridge.mock.script import Script
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.mock.udp import ServerShell
from tests.mocap_bridge.lockstep import STARTS, arena, circling
from tests.mocap_bridge.soak import GAP_S, KINDS, Judge, faults, over_s
from tests.mocap_bridge.test_mocap_bridge import arena_file, on_free_ports
from tests.mocap_bridge.test_mocap_soak import soak

MINUTES = float(os.environ.get("AHDC_SOAK_MINUTES", "30"))
COUNT = int(MINUTES * 60.0 / GAP_S)
VIRTUAL_MEMORY_BYTES = 3_000_000
REAL_GROWTH_BYTES = 4_000_000


@pytest.mark.timeout(7200)
def test_in_virtual_time() -> None:
    seed = random.SystemRandom().randrange(1 << 30)
    soak(seed, 3)
    tracemalloc.start()
    judge = soak(seed, COUNT)
    now, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    print(f"seed {seed}: {COUNT} faults, {judge.frames} frames, {judge.poses_valid} valid poses, {now} bytes kept")
    assert judge.verdicts == [], f"seed {seed}"
    assert judge.wrong == 0
    assert now < VIRTUAL_MEMORY_BYTES


class RealTime:
    """The bridge as a process, the emulated server and a subscriber here."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.arena = on_free_ports(arena())
        path = arena_file(folder / "arena.toml", self.arena)
        command = [sys.executable, "-m", "mocap_bridge", "run", "--arena", str(path)]
        self.bridge = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.bridge.stdout is not None
        assert self.bridge.stdout.readline() == "READY mocap_bridge\n"
        self.server = EmulatedServer(settings_of(self.arena, seed=seed), list(STARTS))
        self.shell = ServerShell(self.server, "127.0.0.1")
        self.poses = circling()
        self.received: deque[MocapFrame | MocapHealth] = deque()
        config = zenoh.Config()
        for key, value in network.client_config(self.arena.link.router):
            config.insert_json5(key, value)
        keys = Keys(self.arena.arena.name)
        self.session = zenoh.open(config)
        self._frames = self.session.declare_subscriber(
            keys.mocap_frame, lambda sample: self.received.append(decode(MocapFrame, bytes(sample.payload)))
        )
        self._health = self.session.declare_subscriber(
            keys.mocap_health, lambda sample: self.received.append(decode(MocapHealth, bytes(sample.payload)))
        )

    def until(self, elapsed_s: float, judge: Judge) -> None:
        """Serve to that time of the script."""
        while self.server.elapsed_s(time.monotonic_ns()) < elapsed_s:
            now_ns = time.monotonic_ns()
            if now_ns >= self.shell.next_due_ns:
                self.shell.stream(now_ns, self.poses(self.server.elapsed_s(now_ns)))
            wait_s = min(max((self.shell.next_due_ns - time.monotonic_ns()) * 1e-9, 0.0), 0.05)
            for fd in select.select(self.shell.fds(), [], [], wait_s)[0]:
                self.shell.on_readable(fd, time.monotonic_ns())
            while self.received:
                message = self.received.popleft()
                if isinstance(message, MocapFrame):
                    judge.frame(message, self.server.elapsed_s(message.exposure_ns))
                else:
                    judge.health(message)

    def memory_bytes(self) -> int:
        """Of the bridge and its router."""
        both = (self.bridge.pid, *kin(self.bridge.pid))
        pages = (int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in both)
        return sum(pages) * os.sysconf("SC_PAGE_SIZE")

    def close(self) -> None:
        self.session.close()
        self.shell.close()
        self.bridge.terminate()
        self.bridge.communicate(timeout=10)


@pytest.mark.timeout(7200)
def test_in_real_time(tmp_path: Path) -> None:
    seed = random.SystemRandom().randrange(1 << 30)
    world, judge = RealTime(tmp_path, seed), Judge(circling())
    settled = 0
    try:
        world.shell.stream(time.monotonic_ns(), [])
        world.until(1.9, judge)
        for number, fault in enumerate(itertools.islice(faults(seed, STARTS), COUNT)):
            world.server.follow(Script((fault,)))
            judge.begin(fault)
            world.until(over_s(fault), judge)
            judge.end()
            if number == COUNT // 4:
                settled = world.memory_bytes()
        grown = world.memory_bytes() - settled
    finally:
        world.close()
    print(f"seed {seed}: {COUNT} faults, {judge.frames} frames, {judge.poses_valid} valid poses, {grown} bytes grown")
    assert judge.wrong == 0, judge.verdicts
    assert judge.verdicts == [], f"seed {seed}"
    assert set(judge.named) == {kind.name for kind in KINDS.values()} - {""} or len(KINDS) > COUNT
    assert grown < REAL_GROWTH_BYTES
