"""``ahdc-onboard``: the commands of a robot computer."""

import argparse
import os
import sys
from pathlib import Path

EXIT_GOOD, EXIT_FAILED, EXIT_INPUT = 0, 1, 2


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(
        prog="ahdc-onboard",
        allow_abbrev=False,
        description="One robot: poses and neighbours in, wheel speeds out. Wheels turn only after the "
        "ground station has armed and started the robot, and stop when the station falls silent.",
        epilog="exit codes: 0 good, 1 failed (says how), 2 bad input",
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    run = verbs.add_parser(
        "run",
        allow_abbrev=False,
        help="be one robot of an arena until SIGTERM",
        description="Be one robot of an arena. Prints READY and its id once it works; SIGTERM brings the wheels to "
        "zero, disables the motors and ends with code 0.",
    )
    run.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file (TOML)")
    run.add_argument("--robot", required=True, metavar="ID", help="which robot of the arena file, such as r06")
    check = verbs.add_parser(
        "check",
        allow_abbrev=False,
        help="read the arena file as `run` would, and say what was found",
        description="Read the arena file and load everything that a run needs, open nothing. Prints name=value lines: "
        "software, release, python, arena (the hash every robot must agree on).",
    )
    check.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file (TOML)")
    check.add_argument("--robot", required=True, metavar="ID", help="which robot of the arena file")
    doctor = verbs.add_parser(
        "doctor",
        allow_abbrev=False,
        help="check this computer for what makes the loop late",
        description="Look at governor, clock, Wi-Fi, FTDI, CAN, chrony, limits and interpreter; changes nothing.",
    )
    doctor.add_argument("--json", action="store_true", help="the findings as JSON, to standard output")
    doctor.add_argument("--strict", action="store_true", help="exit code 1 for a warning too")
    doctor.add_argument(
        "--jitter", action="store_true", help="measure how late a loop wakes, with and without each setting"
    )
    doctor.add_argument("--turns", type=int, default=5, metavar="N", help="with --jitter: turns (%(default)s)")
    doctor.add_argument(
        "--seconds", type=float, default=1.0, metavar="S", help="with --jitter: of each try (%(default)g s)"
    )
    doctor.add_argument(
        "--switch",
        action="store_true",
        help="with --jitter, as root: turn the machine's own settings (governor, Wi-Fi power save) to and fro, too",
    )
    verbs.add_parser(
        "failsafes",
        allow_abbrev=False,
        help="what stops a robot, and how each cause clears",
        description="Print the table of failsafes: trigger, threshold, action, and how it clears (Markdown).",
    )
    return top


def main(argv: list[str] | None = None) -> int:
    arguments = parser().parse_args(argv)
    try:
        code = {"run": run, "check": check, "doctor": doctor, "failsafes": failsafes}[arguments.verb](arguments)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    return code


def failsafes(arguments: argparse.Namespace) -> int:
    from onboard.failsafes import markdown

    print(markdown())
    return EXIT_GOOD


def check(arguments: argparse.Namespace) -> int:
    from contract.arena import ArenaError
    from onboard import runtime

    try:
        print(runtime.check(arguments.arena, arguments.robot))
    except ArenaError as error:
        print(error, file=sys.stderr)
        return EXIT_INPUT
    return EXIT_GOOD


def doctor(arguments: argparse.Namespace) -> int:
    from onboard import doctor as verb

    return verb.run(arguments)


def run(arguments: argparse.Namespace) -> int:
    from contract.arena import ArenaError
    from onboard import runtime

    try:
        return runtime.run(arguments.arena, arguments.robot)
    except ArenaError as error:
        print(error, file=sys.stderr)
        return EXIT_INPUT
    except KeyboardInterrupt:
        return EXIT_GOOD
    except Exception as error:
        if type(error).__name__ != "ZError":
            raise
        print(f"{arguments.robot}: the router does not answer ({error}); start the mocap bridge", file=sys.stderr)
        return EXIT_FAILED
