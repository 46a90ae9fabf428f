"""The arena file and the robot that several verbs take, checked alike."""

import argparse
import sys
from pathlib import Path

from contract.arena import Arena, ArenaError, load
from drivers.registry import wheel_faults


def take(parser: argparse.ArgumentParser, required: bool = True) -> None:
    """Add both to a verb's options."""
    parser.add_argument("arena", type=Path, help="arena file (TOML)")
    parser.add_argument("--robot", required=required, metavar="ID", help="robot whose wheels are on this computer")


def given(args: argparse.Namespace) -> Arena | None:
    """The arena, if it is sound and has the robot; otherwise says why not."""
    try:
        arena = load(args.arena, wheel_faults)
    except ArenaError as error:
        print(error, file=sys.stderr)
        return None
    if args.robot is not None and args.robot not in arena.robots:
        print(f"--robot {args.robot}: the arena file has {', '.join(arena.robots)}", file=sys.stderr)
        return None
    return arena
