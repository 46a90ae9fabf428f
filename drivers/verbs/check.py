"""``ahdc-drivers check``: the wheels tables of an arena file, and whether their wire is fast enough."""

import argparse
import sys
from pathlib import Path

from contract.arena import ArenaError, load
from drivers.registry import family_of, open_robot, port_path, wheel_faults


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("arena", type=Path, help="arena file (TOML)")


def run(args: argparse.Namespace) -> int:
    try:
        arena = load(args.arena, wheel_faults)
    except ArenaError as error:
        print(error, file=sys.stderr)
        return 2
    for name, robot in arena.robots.items():
        open_robot(arena, name)
        family = family_of(robot.wheels["kind"])
        emulated = " (emulated)" if "wheels" in robot.emulate else ""
        summary = family.summary if family else ""
        print(f"{name}: {summary} on {port_path(robot.wheels)}{emulated}")
    return 0
