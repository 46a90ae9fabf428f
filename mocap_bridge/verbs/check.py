"""Check an arena file without touching the network, and say what the bridge would do with it."""

import argparse
import sys
from pathlib import Path

from contract.arena import ArenaError, digest, load
from mocap_bridge.natnet import version


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = __doc__
    parser.add_argument("arena", type=Path, metavar="ARENA", help="arena file (TOML)")


def run(options: argparse.Namespace) -> int:
    try:
        arena = load(options.arena)
        wanted = version.layout(version.parse(arena.mocap.version)).version
    except (ArenaError, version.UnsupportedVersion) as error:
        print(error, file=sys.stderr)
        return 2
    mocap = arena.mocap
    way = f"multicast {mocap.multicast_group}:{mocap.data_port}" if mocap.multicast_group else "unicast"
    print(f"{options.arena}: {arena.arena.name}, {len(arena.robots)} robots, hash {digest(arena)}")
    print(f"source   {mocap.source}, NatNet {wanted} from {mocap.server}:{mocap.command_port}, {way}")
    print(f"via      {mocap.local_address}")
    print(f"frame    {mocap.up_axis} up, origin {mocap.origin_m} m, rotation {mocap.rotation_rad:g} rad")
    print(f"router   {arena.link.router}")
    for name, robot in arena.robots.items():
        print(f"body     {robot.body!r} is {name}, heading offset {robot.heading_offset_rad:g} rad")
    return 0
