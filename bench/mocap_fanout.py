"""Whole frames through the bridge to many subscribers: loss, the bridge's and the router's processor time, latency.

    ./kit exec python bench/mocap_fanout.py [--bodies 50] [--rate 240] [--subscribers 10] [--seconds 10]

Emulated server, bridge and every subscriber are processes of their own on this machine. A frame is lost to
a subscriber if another one got it; ``never_sent`` are those a busy machine kept the server from making.
``stamp_to_put_ms`` is from the server's stamp, just before the datagram leaves, to the put. The bridge's processor time
is that of its own process, which sends a frame once; the sends to each subscriber are the router's, its child, and told
beside it. ``put_to_subscriber_ms`` is the way through both.
"""

import argparse
import json
import multiprocessing
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from multiprocessing.queues import Queue
from pathlib import Path
from typing import Any

SITE = "bench"


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def arena_text(bodies: int, rate_hz: float, router: str) -> str:
    lines = [
        f'[arena]\nname = "{SITE}"\nsize_m = [8.0, 8.0]\n[link]\nrouter = "{router}"\n[mocap]',
        f"command_port = {free_port(socket.SOCK_DGRAM)}\ndata_port = {free_port(socket.SOCK_DGRAM)}",
        f"frame_rate_hz = {rate_hz}",
    ]
    for k in range(bodies):
        start = [0.6 + 0.7 * (k % 10), 0.6 + 0.7 * (k // 10)]
        lines.append(f'[robots.b{k}]\nbody = "b{k}"\nstart = {start}\nwheels = {{kind = "none"}}')
    return "\n".join(lines)


def subscribe(router: str, seconds: float, results: "Queue[dict[str, Any]]") -> None:
    import zenoh

    from contract import network
    from contract.codec import decode
    from contract.keys import Keys
    from contract.messages import MocapFrame

    config = zenoh.Config()
    for key, value in network.client_config(router):
        config.insert_json5(key, value)
    numbers: list[int] = []
    latency_ms: list[float] = []
    arrival_ms: list[float] = []
    with zenoh.open(config) as session:
        frames = session.declare_subscriber(Keys(SITE).mocap_frame, zenoh.handlers.FifoChannel(1000))
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            frame = decode(MocapFrame, bytes(frames.recv().payload))
            numbers.append(frame.frame)
            latency_ms.append((frame.publish_ns - frame.transmit_ns) * 1e-6)
            arrival_ms.append((time.monotonic_ns() - frame.publish_ns) * 1e-6)
    results.put({"numbers": numbers, "latency_ms": latency_ms, "arrival_ms": arrival_ms})


def cpu_s(pid: int) -> dict[str, float]:
    """Processor time of a process by the names of its threads, as the scheduler counts it."""
    used: Counter[str] = Counter()
    for thread in Path(f"/proc/{pid}/task").iterdir():
        used[(thread / "comm").read_text().strip().split("-")[0]] += int((thread / "schedstat").read_text().split()[0])
    return {name: ns * 1e-9 for name, ns in used.items()}


def router_of(bridge: int) -> int:
    """The process in which the bridge has its router."""
    (child,) = Path(f"/proc/{bridge}/task/{bridge}/children").read_text().split()
    return int(child)


def spent(pid: int, before_s: dict[str, float], elapsed_s: float) -> dict[str, float]:
    """Per cent of a core since then, by the names of threads."""
    return {name: 100.0 * (end_s - before_s.get(name, 0.0)) / elapsed_s for name, end_s in cpu_s(pid).items()}


def percentile(values: list[float], share: float) -> float:
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=50)
    parser.add_argument("--rate", type=float, default=240.0, help="frames a second")
    parser.add_argument("--subscribers", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, too")
    options = parser.parse_args()
    router = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    spawn = multiprocessing.get_context("spawn")
    results: Queue[dict[str, Any]] = spawn.Queue()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arena.toml"
        path.write_text(arena_text(options.bodies, options.rate, router))
        command = [sys.executable, "-m", "mocap_bridge"]
        bridge = subprocess.Popen([*command, "run", "--arena", str(path)], stdout=subprocess.PIPE)
        server = subprocess.Popen([*command, "emulate", "--arena", str(path)], stdout=subprocess.PIPE)
        for process in (bridge, server):
            assert process.stdout is not None
            process.stdout.readline()
        arguments = (router, options.seconds, results)
        readers = [spawn.Process(target=subscribe, args=arguments) for _ in range(options.subscribers)]
        for reader in readers:
            reader.start()
        time.sleep(1.0)
        pids = {"bridge": bridge.pid, "router": router_of(bridge.pid)}
        before_s, start_s = {name: cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
        time.sleep(max(options.seconds - 2.0, 1.0))
        elapsed_s = time.monotonic() - start_s
        used = {name: spent(pid, before_s[name], elapsed_s) for name, pid in pids.items()}
        rows = [results.get() for _ in readers]
        for reader in readers:
            reader.join()
        for process in (server, bridge):
            process.terminate()
            process.wait()
    published = set().union(*(row["numbers"] for row in rows))
    received = sum(len(row["numbers"]) for row in rows)
    lost = sum(
        sum(row["numbers"][0] <= number <= row["numbers"][-1] for number in published) - len(row["numbers"])
        for row in rows
    )
    latency = rows[0]["latency_ms"]
    arrival = [value for row in rows for value in row["arrival_ms"]]
    figures = {
        "bodies": options.bodies,
        "rate_hz": options.rate,
        "subscribers": options.subscribers,
        "received": received,
        "lost": lost,
        "never_sent": max(published) - min(published) + 1 - len(published),
        **{f"{name}_cpu_percent": round(sum(threads.values()), 1) for name, threads in used.items()},
        "by_thread": {name: {thread: round(share, 1) for thread, share in used[name].items()} for name in used},
        "stamp_to_put_ms": {q: round(percentile(latency, p), 3) for q, p in (("p50", 0.5), ("p99", 0.99))},
        "put_to_subscriber_ms": {q: round(percentile(arrival, p), 3) for q, p in (("p50", 0.5), ("p99", 0.99))},
        "mean_load": round(os.getloadavg()[0], 2),
    }
    print(json.dumps(figures, indent=1))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
