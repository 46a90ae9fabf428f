"""``ahdc-drivers jog``: turn a robot's wheels from the keyboard. Let go and they stop.

Put the robot on a stand first. Nothing else may hold its port: end the robot's own process.
"""

import argparse
import os
import select
import sys
import termios
import time
import tty

from drivers.base import DriverError
from drivers.gated import GatedDrive
from drivers.jog import HELP, MAX_MPS, Jog
from drivers.registry import open_robot
from drivers.verbs import robots

PERIOD_S = 0.02


def configure(parser: argparse.ArgumentParser) -> None:
    robots.take(parser)
    parser.add_argument(
        "--speed", type=float, default=MAX_MPS, metavar="M/S", help=f"greatest speed (at most {MAX_MPS})"
    )


def run(args: argparse.Namespace) -> int:
    arena = robots.given(args)
    if arena is None:
        return 2
    if not 0.0 < args.speed <= MAX_MPS:
        print(f"--speed {args.speed}: above 0, at most {MAX_MPS} m/s", file=sys.stderr)
        return 2
    drive = open_robot(arena, args.robot)
    print(HELP)
    try:
        follow(drive, Jog(arena.platform.wheel_radius_m, args.speed), sys.stdin.fileno())
    except DriverError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def follow(drive: GatedDrive, jog: Jog, keyboard: int) -> None:
    """Until the end key, the end of input or a fault; wheels at zero and disabled on every way out.

    :raises DriverError: of the drive.
    """
    before = termios.tcgetattr(keyboard) if os.isatty(keyboard) else None
    try:
        drive.configure()
        drive.activate(time.monotonic_ns())
        if before is not None:
            tty.setcbreak(keyboard)
        while not jog.ended:
            readable, _, _ = select.select([keyboard], [], [], PERIOD_S)
            keys = os.read(keyboard, 64).decode(errors="replace") if readable else ""
            if readable and not keys:
                return
            turn(drive, jog, keys, time.monotonic_ns())
    finally:
        if before is not None:
            termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
        drive.close()


def turn(drive: GatedDrive, jog: Jog, keys: str, now_ns: int) -> None:
    """One turn of the loop.

    :raises DriverError: of the drive.
    """
    for key in keys:
        jog.press(key, now_ns)
    drive.write(jog.speeds(now_ns), now_ns)
    drive.poll(now_ns)
    drive.read(now_ns)
    drive.check(now_ns)
