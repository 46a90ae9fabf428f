"""The arena page with many robots: frames a second in headless Chromium, and what its server costs.

A made-up mission of 50 robots and 500 targets is spoken over a real router at the rates of a real one (frames 100 Hz,
every robot's report 5 Hz with figures of its own, status 10 Hz). The page's server is a process of its own with four
clients: Chromium, two that read, and one that is frozen and never reads. Reported: frames drawn a second and what one
costs the browser (all its processes, on all cores), updates a second (whole views and poses), the server's share of a
core, and the longest wait for an update of a reading client beside the frozen one.

    python bench/arena_page.py --robots 50 --targets 500 --seconds 10 --json FILE
"""

import argparse
import contextlib
import json
import math
import os
import re
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from contract import network
from contract.arena import Arena, digest, parse
from contract.codec import encode
from contract.keys import Keys
from contract.messages import (
    SCHEMA_VERSION,
    BodyPose,
    LoopTiming,
    Message,
    MocapFrame,
    MocapHealth,
    RobotReport,
    RunStatus,
    StationHeartbeat,
    Target,
    TargetCloud,
)
from groundstation.processes import Family
from groundstation.rig import free_ports, write_config

CHROMIUM = "/usr/bin/chromium"
TICKS = os.sysconf("SC_CLK_TCK")


def arena_of(robots: int, port: int) -> Arena:
    columns = math.ceil(math.sqrt(robots))
    table = {
        f"r{i + 1:02d}": {
            "body": f"b{i}",
            "start": [0.6 + 0.8 * (i % columns), 0.6 + 0.8 * (i // columns)],
            "wheels": {"kind": "odrive"},
        }
        for i in range(robots)
    }
    side = max(8.0, 0.8 * columns + 1.0)
    floor = {"name": "many", "size_m": [side, 1.4 * side]}
    return parse({"arena": floor, "link": {"router": f"tcp/127.0.0.1:{port}"}, "robots": table}, "bench")


class Swarm(threading.Thread):
    """Speaks the mission until told to end."""

    def __init__(self, arena: Arena, targets: int, session: Any) -> None:
        super().__init__(daemon=True)
        self.over = threading.Event()
        self._arena, self._session, self._keys = arena, session, Keys(arena.arena.name)
        self._names = list(arena.robots)
        self._starts = [robot.start for robot in arena.robots.values()]
        self._hash = digest(arena)
        wide = math.ceil(math.sqrt(targets))
        width, height = arena.arena.size_m
        points = [
            (0.4 + (width - 0.8) * (k % wide) / wide, 0.4 + (height - 0.8) * (k // wide) / wide) for k in range(targets)
        ]
        self._cloud = TargetCloud(
            mission="many", targets=tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(points))
        )
        self._near = [
            tuple(n for j, n in enumerate(self._names) if j != i and math.dist(a, self._starts[j]) <= 0.85)
            for i, a in enumerate(self._starts)
        ]

    def run(self) -> None:
        began_ns = due_ns = time.monotonic_ns()
        tick = 0
        while not self.over.is_set():
            now_ns = time.monotonic_ns()
            for key, message in self._said(tick, now_ns, (now_ns - began_ns) / 1e9):
                self._session.put(key, encode(message))
            tick += 1
            due_ns += 10_000_000
            self.over.wait(max(0.0, (due_ns - time.monotonic_ns()) / 1e9))

    def end(self) -> None:
        """Say no more; the session may be closed."""
        self.over.set()
        self.join()

    def _said(self, tick: int, now_ns: int, elapsed_s: float) -> Iterator[tuple[str, Message]]:
        keys = self._keys
        bodies = []
        for i, (name, (x, y)) in enumerate(zip(self._names, self._starts, strict=True)):
            way = elapsed_s * 1.5 + i
            bodies.append(
                BodyPose(
                    robot=name,
                    x_m=round(x + 0.06 * math.cos(way), 5),
                    y_m=round(y + 0.06 * math.sin(way), 5),
                    heading_rad=round(math.remainder(way + math.pi / 2, math.tau), 5),
                )
            )
        yield (
            keys.mocap_frame,
            MocapFrame(
                session=1, frame=tick, exposure_ns=now_ns, transmit_ns=now_ns, publish_ns=now_ns, rate_hz=100.0,
                bodies=tuple(bodies),
            ),
        )  # fmt: skip
        for i in range(tick % 20, len(self._names), 20):
            yield keys.report(self._names[i]), self._report(i, tick, now_ns)
        if tick % 10 == 0:
            done = tuple(range(min(len(self._cloud.targets), int(elapsed_s * 5))))
            status = RunStatus(
                stamp_ns=now_ns, mission="many", phase="running", elapsed_s=elapsed_s, occupied=done,
                targets=len(self._cloud.targets),
            )  # fmt: skip
            yield keys.status, status
            yield keys.mocap_health, MocapHealth(stamp_ns=now_ns, state="ok", rate_hz=100.0)
        if tick % 5 == 0:
            yield keys.heartbeat, StationHeartbeat(boot=1, seq=tick, stamp_ns=now_ns, order="run", order_id=3)
        if tick % 50 == 0:
            yield keys.targets, self._cloud

    def _report(self, i: int, tick: int, now_ns: int) -> RobotReport:
        odd = i + tick // 20
        return RobotReport(
            robot=self._names[i], boot=1, stamp_ns=now_ns, schema_version=SCHEMA_VERSION, arena_hash=self._hash,
            run="running", pose_valid=True, pose_age_ms=9.0 + odd % 7, battery_v=24.0 - odd % 9 / 10,
            task="tracking" if i % 3 else "occupied", claim=(i * 7 + tick // 300) % len(self._cloud.targets),
            timing=LoopTiming(nominal_hz=100.0, rate_hz=100.0, jitter_ms=0.3 + odd % 5 / 10, steps=tick, misses=0),
            neighbours=self._near[i], links_on=self._near[i],
        )  # fmt: skip


def cpu_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def descendants(pid: int) -> set[int]:
    """Processes below this one."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError, IndexError):
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
    found: set[int] = {pid}
    while new := {child for child, parent in parents.items() if parent in found and child not in found}:
        found |= new
    return found - {pid}


def chromium_cpu_s() -> float:
    """Of all processes of the browser started by this one."""
    total = 0.0
    for pid in descendants(os.getpid()):
        with contextlib.suppress(OSError):
            if b"chrom" in Path(f"/proc/{pid}/cmdline").read_bytes():
                total += cpu_s(pid)
    return total


class Reader(threading.Thread):
    """A browser that reads everything and notes when."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self.arrivals: list[float] = []
        self.bytes: dict[str, int] = {}
        """Of the newest update of each kind."""
        self._url = url

    def run(self) -> None:
        from websockets.sync.client import connect

        with contextlib.suppress(Exception), connect(self._url, compression=None, max_queue=None) as socket:
            while True:
                text = socket.recv()
                for kind in ("view", "poses"):
                    if f'"kind":"{kind}"' in text[:40]:
                        self.arrivals.append(time.monotonic())
                        self.bytes[kind] = len(text)


@contextlib.contextmanager
def router(port: int) -> Iterator[Any]:
    """A Zenoh router in this process."""
    import zenoh

    config = zenoh.Config()
    for key, value in network.router_config(f"tcp/127.0.0.1:{port}"):
        config.insert_json5(key, value)
    with zenoh.open(config) as session:
        yield session


def measure(robots: int, targets: int, seconds: float) -> dict[str, float]:
    """One run; the figures by name."""
    from playwright.sync_api import sync_playwright
    from websockets.sync.client import connect

    port = free_ports()[0]
    arena = arena_of(robots, port)
    with contextlib.ExitStack() as stack:
        out = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        write_config(arena, out / "config.toml")
        swarm = Swarm(arena, targets, stack.enter_context(router(port)))
        swarm.start()
        stack.callback(swarm.end)
        family = stack.enter_context(Family())
        words = ["page", "--arena", str(out / "config.toml"), "--port", "0"]
        child = family.start("page", "groundstation", words, out / "page.log")
        family.wait_ready(40.0)
        found = re.search(rb"READY page http://(\S+)", child._text)
        assert found
        host = found[1].decode()
        readers = [Reader(f"ws://{host}ws") for _ in range(2)]
        for reader in readers:
            reader.start()
        frozen = stack.enter_context(connect(f"ws://{host}ws", compression=None, max_queue=1, close_timeout=0.1))
        stack.callback(frozen.socket.close)
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        stack.callback(browser.close)
        page = browser.new_page(viewport={"width": 1600, "height": 1000})
        page.goto(f"http://{host}")
        page.wait_for_function("() => window.arena.views > 20")
        frames, views = page.evaluate("[window.arena.frames, window.arena.views]")
        began, spent, drawn_s = time.monotonic(), cpu_s(child.pid), chromium_cpu_s()
        for reader in readers:
            reader.arrivals.clear()
        page.wait_for_timeout(seconds * 1e3)
        frames_after, views_after = page.evaluate("[window.arena.frames, window.arena.views]")
        lasted, used, drawn_s = time.monotonic() - began, cpu_s(child.pid) - spent, chromium_cpu_s() - drawn_s
        gaps = [b - a for reader in readers for a, b in zip(reader.arrivals, reader.arrivals[1:], strict=False)]
        return {
            "robots": robots,
            "targets": targets,
            "seconds": round(lasted, 2),
            "frames_per_s": round((frames_after - frames) / lasted, 1),
            "chromium_cpu_ms_per_frame": round(1e3 * drawn_s / max(1, frames_after - frames), 1),
            "updates_per_s_chromium": round((views_after - views) / lasted, 1),
            "updates_per_s_reader": round(len(gaps) / len(readers) / lasted, 1),
            "longest_wait_ms": round(max(gaps, default=math.nan) * 1e3, 1),
            "view_bytes": readers[0].bytes.get("view", 0),
            "poses_bytes": readers[0].bytes.get("poses", 0),
            "server_core_percent": round(100 * used / lasted, 1),
            "load_1min": round(os.getloadavg()[0], 2),
        }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--targets", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    figures = measure(args.robots, args.targets, args.seconds)
    for name, value in figures.items():
        print(f"{name:24} {value:g}")
    if args.json:
        args.json.write_text(json.dumps(figures) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
