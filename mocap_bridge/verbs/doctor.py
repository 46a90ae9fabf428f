"""Ask the motion-capture system of the arena file for poses and name what is wrong.

Recognises: wrong interface, other subnet, absent host, no NatNet, firewall, command port only, multicast
not joined, unicast against multicast, version, names and ids, up axis, units, rate, clock, edit mode.
"""

import argparse
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from contract.arena import Arena, ArenaError, load
from contract.checks import CheckResult, worst
from mocap_bridge.diagnosis import diagnose
from mocap_bridge.evidence import Evidence
from mocap_bridge.health import Health
from mocap_bridge.interfaces import in_a_local_subnet, interfaces, neighbour, route_address
from mocap_bridge.natnet.frame import Body
from mocap_bridge.natnet.wire import MAX_DATAGRAM_BYTES
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.sources.choose import SourceError, open_natnet
from mocap_bridge.sources.natnet import NatNetSource, data_socket

MAX_SAMPLES = 50
FRAME_ID = b"\x07\x00"
MARKS = {"pass": "ok  ", "warn": "WARN", "fail": "FAIL"}


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = __doc__
    parser.add_argument("arena", type=Path, metavar="ARENA", help="arena file (TOML)")
    parser.add_argument("--json", action="store_true", help="print the checks as JSON")
    parser.add_argument("--seconds", type=float, default=3.0, help="how long to look (default 3)")


def run(options: argparse.Namespace) -> int:
    try:
        arena = load(options.arena)
    except ArenaError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        results = diagnose(examine(arena, options.seconds), arena)
    except SourceError as error:
        results = [CheckResult(name="wrong_interface", verdict="fail", seen=str(error)[:400], remedy=addresses())]
    if options.json:
        print(msgspec.json.encode(results).decode())
        return 0 if worst(results) != "fail" else 1
    for result in results:
        print(f"{MARKS[result.verdict]} {result.name}: {result.seen}")
        if result.remedy and result.verdict != "pass":
            print(f"     -> {result.remedy}")
    return 0 if worst(results) != "fail" else 1


def addresses() -> str:
    """The choice for ``mocap.local_address``."""
    return "this machine has " + ", ".join(f"{entry.address} ({entry.name})" for entry in interfaces())


def examine(arena: Arena, seconds: float) -> Evidence:
    """Look for ``seconds``.

    :raises SourceError: the sockets cannot be opened.
    """
    mocap = arena.mocap
    source = open_natnet(arena)
    others = dict(_other_interfaces(arena)) if mocap.multicast_group else {}
    refused = _refused(mocap.server, mocap.command_port, mocap.local_address)
    health = Health(mocap.frame_rate_hz)
    bodies: dict[str, list[Body]] = {}
    frames: list[SourceFrame] = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        source.wait(0.02)
        for frame in source.receive(time.monotonic_ns()):
            frames = [*frames[-1:], frame]
            health.frame(frame, frame.received_ns)
            for name, body in frame.bodies.items():
                samples = bodies.setdefault(name, [])
                if len(samples) < MAX_SAMPLES:
                    samples.append(body)
    elsewhere = tuple(address for address, sock in others.items() if _heard(sock))
    seen = _evidence(source, arena, health, frames, bodies, seconds)
    source.close()
    for sock in others.values():
        sock.close()
    return seen._replace(elsewhere=elsewhere, refused_ports=seen.refused_ports + refused)


def _evidence(
    source: NatNetSource,
    arena: Arena,
    health: Health,
    frames: list[SourceFrame],
    bodies: dict[str, list[Body]],
    seconds: float,
) -> Evidence:
    client, status = source.receiver.client, source.status()
    return Evidence(
        route_address=route_address(arena.mocap.server, arena.mocap.command_port),
        same_subnet=in_a_local_subnet(arena.mocap.server),
        neighbour=neighbour(arena.mocap.server),
        early_frames=client.counters["early_frame"],
        info=client.info,
        problem=client.problem,
        seconds=seconds,
        frames=source.frames_received,
        malformed=status.malformed,
        last_fault=client.last_fault,
        other_bitstream=client.counters["other_bitstream"],
        foreign_senders=tuple(sorted(source.foreign_senders)),
        names=status.names,
        duplicate_names=status.duplicate_names,
        duplicate_ids=status.duplicate_ids,
        bodies=bodies,
        units_to_millimetres=client.units_to_millimetres,
        rate_hz=health.rate_hz,
        nominal_rate_hz=client.nominal_rate_hz,
        clock_error_ms=frames[-1].clock_error_ns * 1e-6 if frames and client.stamper.clock.ready else None,
        edited=bool(frames and frames[-1].edited),
    )


def _refused(server: str, port: int, local_address: str) -> int:
    """1 if the server's host says at once that nobody listens there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.settimeout(0.3)
        try:
            probe.bind((local_address, 0))
            probe.connect((server, port))
            probe.send(b"\0\0\0\0")
            probe.recv(1024)
        except ConnectionRefusedError:
            return 1
        except OSError:
            return 0
    return 0


def _other_interfaces(arena: Arena) -> Iterator[tuple[str, socket.socket]]:
    """Sockets that join the group on every other interface of this machine."""
    mocap = arena.mocap
    for address in sorted({entry.address for entry in interfaces()} - {mocap.local_address}):
        try:
            yield address, data_socket(mocap.multicast_group, mocap.data_port, address)
        except OSError:
            continue


def _heard(sock: socket.socket) -> bool:
    """Whether a frame has come."""
    try:
        return sock.recv(MAX_DATAGRAM_BYTES)[:2] == FRAME_ID
    except OSError:
        return False
