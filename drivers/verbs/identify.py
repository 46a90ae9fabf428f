"""``ahdc-drivers identify``: turn one wheel, then the other; ask which it was; correct ids and signs.

Put the robot on a stand first. The correction goes into the robot's overlay of the arena file, after the
difference was shown and accepted.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast, get_args

from contract import overlay
from drivers.base import DriverError, WheelSpeeds
from drivers.gated import GatedDrive
from drivers.jog import Seen, conclude
from drivers.registry import open_robot
from drivers.verbs import robots

RADPS = 3.0
TURN_S = 1.5
PERIOD_S = 0.01
QUESTION = "which wheel turned, seen from behind? lf lb rf rb (left/right, forward/backward), n for none: "

Ask = Callable[[str], str]


def configure(parser: argparse.ArgumentParser) -> None:
    robots.take(parser)
    parser.add_argument("--yes", action="store_true", help="write without asking")


def run(args: argparse.Namespace) -> int:
    arena = robots.given(args)
    if arena is None:
        return 2
    drive = open_robot(arena, args.robot)
    try:
        drive.configure()
        left, right = (show_and_ask(drive, side, input) for side in ("left", "right"))
    except DriverError as error:
        print(error, file=sys.stderr)
        return 1
    finally:
        drive.close()
    return settle(args.arena, args.robot, arena.robots[args.robot].wheels, left, right, input if not args.yes else None)


def show_and_ask(drive: GatedDrive, side: str, ask: Ask) -> Seen:
    """Turn one wheel forward for a moment, then ask.

    :raises DriverError: of the drive.
    """
    print(f"the {side} wheel turns forward now")
    speeds = WheelSpeeds(RADPS, 0.0) if side == "left" else WheelSpeeds(0.0, RADPS)
    drive.activate(time.monotonic_ns())
    end_ns = time.monotonic_ns() + int(TURN_S * 1e9)
    while (now_ns := time.monotonic_ns()) < end_ns:
        drive.write(speeds, now_ns)
        drive.poll(now_ns)
        drive.read(now_ns)
        time.sleep(PERIOD_S)
    drive.stop(time.monotonic_ns())
    drive.deactivate(time.monotonic_ns())
    return answer(ask)


def answer(ask: Ask) -> Seen:
    """Ask until the answer is one of those possible."""
    while (word := ask(QUESTION).strip().lower()) not in get_args(Seen):
        continue
    return cast(Seen, word)


def settle(arena: Path, robot: str, wheels: dict[str, Any], left: Seen, right: Seen, ask: Ask | None) -> int:
    """Tell, and write what is to be changed; the exit code."""
    conclusion = conclude(wheels, left, right)
    if conclusion.fault:
        print(conclusion.fault, file=sys.stderr)
        return 1
    if not conclusion.changes:
        print("both wheels are as the arena file says")
        return 0
    path = overlay.folder_of(arena) / f"{robot}.toml"
    print(f"{path}:")
    for key, value in conclusion.changes.items():
        print(f"  robots.{robot}.wheels.{key}: {wheels.get(key, 'default')} -> {value}")
    if ask is not None and ask("write it? [y/N] ").strip().lower() not in ("y", "yes"):
        print("nothing written")
        return 1
    overlay.save(path, {"robots": {robot: {"wheels": conclusion.changes}}})
    return 0
