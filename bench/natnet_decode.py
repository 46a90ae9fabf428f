"""Decode speed of a 4.1 frame with markers, side by side with independent decoders, in one run.

    ./kit exec python bench/natnet_decode.py [--seconds S] [--json FILE]

Frames a second at 1, 10 and 50 bodies, three labeled markers a body. Ours and ``natnet`` decode from
memory (``+ tuples``: every body as Python numbers); ``motioncapture`` (C++) can only be fed by UDP, one
frame at a time over loopback, its bodies left in C++, so ours and
bare sockets are timed the same way beside it. Blocks alternate: figures of one run compare, figures
of different runs do not.
"""

import argparse
import itertools
import json
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from contract import arena as arenas
from contract.arena import Mocap
from contract.codec import encode
from mocap_bridge.mock.bodies import BodyState, ServerSettings
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.natnet import version
from mocap_bridge.natnet.frame import decode_frame
from mocap_bridge.natnet.wire import MAX_DATAGRAM_BYTES
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.sources.natnet import data_socket

COUNTS = (1, 10, 50)
LAYOUT = version.layout(version.Version(4, 1))
GROUP = "239.255.42.97"
BLOCK_S = 0.03


def names(count: int) -> list[str]:
    return [f"b{k}" for k in range(count)]


def poses(count: int) -> list[BodyState]:
    return [BodyState(name, 0.5 * (k % 7), 0.5 * (k // 7), 0.1) for k, name in enumerate(names(count))]


def server_of(count: int, mocap: Mocap) -> EmulatedServer:
    return EmulatedServer(ServerSettings(mocap=mocap), names(count))


def frame_of(count: int) -> bytes:
    server = server_of(count, Mocap(multicast_group=GROUP))
    return server.stream(0, poses(count))[0].data


def rates(calls: dict[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Calls a second of each, median of blocks that alternate, so that a busy machine slows all alike."""
    blocks: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(max(round(seconds / BLOCK_S), 3)):
        for name, call in calls.items():
            count, start = 0, time.perf_counter()
            while (elapsed := time.perf_counter() - start) < BLOCK_S:
                for _ in range(5):
                    call()
                count += 5
            blocks[name].append(count / elapsed)
    return {name: statistics.median(values) for name, values in blocks.items()}


def natnet_decode(data: bytes) -> Callable[[], object] | None:
    try:
        from natnet.data_frame import DataFrame
        from natnet.packet_buffer import PacketBuffer
        from natnet.version import Version
    except ImportError:
        return None
    known = Version(4, 1)

    def decode() -> object:
        buffer = PacketBuffer(data)
        buffer.read_uint16()
        buffer.read_uint16()
        return DataFrame.read_from_buffer(buffer, known)

    return decode


def checks_and_json(count: int) -> Callable[[], object]:
    """What follows the decoding: checks, message and JSON, of frames that move."""
    robots = {
        name: {"body": name, "start": [0.3 + 0.5 * (k % 7), 0.3 + 0.5 * (k // 7)], "wheels": {"kind": "none"}}
        for k, name in enumerate(names(count))
    }
    arena = arenas.parse({"arena": {"name": "bench", "size_m": [4.0, 5.0]}, "robots": robots}, "bench")
    pipeline = Pipeline(arena, 1)
    server = server_of(count, Mocap(multicast_group=GROUP))
    frames = []
    for number in range(200):
        decoded = decode_frame(server.stream(number * 8_333_333, poses(count))[0].data, LAYOUT)
        frames.append({f"b{body[0] - 1}": body for body in decoded.bodies})
    numbers = itertools.count(1)

    def one() -> object:
        number = next(numbers)
        now_ns = number * 8_333_333
        return encode(pipeline.frame(SourceFrame(0, number, now_ns, now_ns, now_ns, 0, frames[number % 200]), now_ns))

    return one


def motioncapture_peer(count: int, port: int) -> Callable[[], object] | None:
    """The C++ peer, listening; the emulated server in another process is only there for its handshake."""
    try:
        import motioncapture
    except ImportError:
        return None
    [command] = free_ports(1)
    arguments = ["--multicast", GROUP, "--ports", str(command), str(port), "--bodies", str(count), "--rate", "10"]
    server = subprocess.Popen([sys.executable, "-m", "mocap_bridge", "emulate", *arguments], stdout=subprocess.PIPE)
    assert server.stdout is not None
    server.stdout.readline()
    settings = {"hostname": "127.0.0.1", "interface_ip": "127.0.0.1", "port_command": str(command)}
    peer = motioncapture.connect("optitrack", settings)
    server.kill()
    server.wait()
    return peer.waitForNextFrame


def free_ports(count: int) -> list[int]:
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    for sock in sockets:
        sock.bind(("127.0.0.1", 0))
    ports = [sock.getsockname()[1] for sock in sockets]
    for sock in sockets:
        sock.close()
    return ports


def figures(count: int, seconds: float) -> dict[str, float]:
    """One row of the table."""
    data = frame_of(count)
    calls: dict[str, Callable[[], object]] = {
        "ours": lambda: decode_frame(data, LAYOUT),
        "ours + tuples": lambda: decode_frame(data, LAYOUT).bodies,
    }
    if (natnet := natnet_decode(data)) is not None:
        calls["natnet"] = natnet
    calls["checks+json"] = checks_and_json(count)
    bare_port, our_port, peer_port = free_ports(3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        bare, own = (data_socket(GROUP, port, "127.0.0.1") for port in (bare_port, our_port))

        def by_udp(port: int, take: Callable[[], object]) -> Callable[[], object]:
            def one() -> object:
                sender.sendto(data, (GROUP, port))
                return take()

            return one

        calls["udp bare"] = by_udp(bare_port, lambda: bare.recv(MAX_DATAGRAM_BYTES))
        calls["udp ours"] = by_udp(our_port, lambda: decode_frame(own.recv(MAX_DATAGRAM_BYTES), LAYOUT))
        if (peer := motioncapture_peer(count, peer_port)) is not None:
            calls["udp motioncapture"] = by_udp(peer_port, peer)
        row = rates(calls, seconds)
        bare.close()
        own.close()
    return {"bodies": float(count), "bytes": float(len(data)), **row}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=1.0, help="per figure")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, too")
    options = parser.parse_args()
    rows = [figures(count, options.seconds) for count in COUNTS]
    print("  ".join(f"{name:>17}" for name in rows[0]))
    for row in rows:
        print("  ".join(f"{value:17.0f}" for value in row.values()))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
