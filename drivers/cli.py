"""``ahdc-drivers``: wheel controllers from the command line."""

import argparse
import importlib
import sys
from collections.abc import Sequence

VERBS = {
    "list": ("drivers.verbs.families", "controller families with every option explained"),
    "check": ("drivers.verbs.check", "check the wheels tables of an arena file"),
    "doctor": ("drivers.verbs.doctor", "find adapters and ports; name what is wrong with the wheels, and the remedy"),
    "jog": ("drivers.verbs.jog", "turn a robot's wheels from the keyboard"),
    "identify": ("drivers.verbs.identify", "find out which wheel is which, and which way it turns"),
    "emulate": ("drivers.verbs.emulate", "run an emulated controller on a pty of its own"),
}
"""Verb to its module and one-line help; a module is imported only when its verb is used."""

EPILOG = """\
examples:
  ahdc-drivers list odrive                            options of one family
  ahdc-drivers check lab6.toml                        every fault with its path and allowed range
  ahdc-drivers doctor lab6.toml --robot r06           what is wrong with its wheels, and what to do
  ahdc-drivers emulate roboclaw --port-link /tmp/rc   a RoboClaw any program can open at /tmp/rc
exit codes: 0 good, 1 failed (says how), 2 bad input"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    verb = next((word for word in arguments if not word.startswith("-")), None)
    parser = argparse.ArgumentParser(
        prog="ahdc-drivers",
        description="Wheel controllers: what there is, whether an arena file fits, and emulated ones to try.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for name, (module, text) in VERBS.items():
        sub = verbs.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".", allow_abbrev=False)
        if name == verb:
            importlib.import_module(module).configure(sub)
    args = parser.parse_args(arguments)
    try:
        return int(importlib.import_module(VERBS[args.verb][0]).run(args))
    except (KeyboardInterrupt, BrokenPipeError):
        return 0
