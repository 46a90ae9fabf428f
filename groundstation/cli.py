"""``ahdc-groundstation``: one table of verbs, each imported only when it is used.

A verb's module has ``configure(parser)`` (its options) and ``run(args) -> int`` (its work); one
that serves several verbs reads ``args.verb``. Exit codes: 0 good, 1 failed and said how, 2 bad
input.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import NamedTuple

from contract.arena import ArenaError
from groundstation import compiled
from groundstation.current import NoArenaError

PROGRAM = "ahdc-groundstation"


class Verb(NamedTuple):
    """Where a verb is written and what it does, in one line."""

    module: str
    help: str
    group: str


VERBS: dict[str, Verb] = {
    "demo": Verb("groundstation.demo", "run a whole mission in the mock arena, every hop real bytes", "Try"),
    "simulate": Verb("groundstation.simulate", "run many missions in lockstep virtual time", "Try"),
    "compile": Verb("groundstation.compiled", "make simulate faster: machine code of the control law, once", "Try"),
    "experiment": Verb("groundstation.experiment", "run a file's trials, resumable, and aggregate them", "Try"),
    "faults": Verb("groundstation.faults", "inject every fault of the matrix in virtual time and judge", "Try"),
    "radio": Verb("groundstation.radio", "the same mission over a worse and worse radio, as a table", "Try"),
    "mock-arena": Verb("groundstation.mock_arena", "emulate wheels, bodies and motion capture of an arena", "Try"),
    "keys": Verb("groundstation.keys", "certificates of a site on a network: init, issue, revoke, list", "Run"),
    "router": Verb("groundstation.router", "the router of a site with keys: mutual TLS, rules for every robot", "Run"),
    "deploy": Verb("groundstation.deploy", "bring this software and arena file to the robots' computers", "Run"),
    "doctor": Verb("groundstation.doctor", "check the whole fleet before it gets power", "Run"),
    "fleet": Verb("groundstation.fleet", "every robot's state, log and version, side by side", "Run"),
    "seed": Verb("groundstation.seeding", "give the mission other targets: points, a seeded cloud, a file", "Run"),
    "arm": Verb("groundstation.orders", "let the robots' wheels be driven", "Run"),
    "start": Verb("groundstation.orders", "start the mission", "Run"),
    "hold": Verb("groundstation.orders", "pause: robots hold their place under control", "Run"),
    "stop": Verb("groundstation.orders", "STOP every robot now; latches until released", "Run"),
    "release": Verb("groundstation.orders", "release a STOP; never resumes motion", "Run"),
    "repeat": Verb("groundstation.errands", "make the same targets a new mission, all of them open", "Run"),
    "exclude": Verb("groundstation.exclusion", "take robots out of the network; the others go on without them", "Run"),
    "readmit": Verb("groundstation.exclusion", "take excluded robots into the network again", "Run"),
    "home": Verb("groundstation.errands", "drive every robot to its start pose, then disarm", "Run"),
    "status": Verb("groundstation.orders", "show what every robot does, once", "Run"),
    "watch": Verb("groundstation.watch", "show progress and every robot, live", "Run"),
    "page": Verb("groundstation.page_server", "the arena page: see, seed, arm, start and STOP in a browser", "Run"),
    "session": Verb("groundstation.conduct", "conduct a mission: heartbeat, targets, completion", "Run"),
    "record": Verb("groundstation.recorder", "record everything the swarm says", "Judge"),
    "recover": Verb("groundstation.recover", "repair a recording that was cut off", "Judge"),
    "metrics": Verb("groundstation.runfolder", "recompute metrics.json from a recording alone", "Judge"),
    "calibrate": Verb("groundstation.calibrate", "a robot's true dimensions and brakes, from a recording", "Judge"),
    "report": Verb("groundstation.report", "figures and a page to hand on, from a run's recording", "Judge"),
    "replay": Verb("groundstation.replay", "feed a recording to the same agents and compare, bit for bit", "Judge"),
    "foxglove": Verb("groundstation.visualise", "add channels that Foxglove and rerun show without a plug-in", "Judge"),
    "topics": Verb("groundstation.topics", "list every topic, its message and its quality of service", "Judge"),
}

USAGE = f"{PROGRAM} VERB [options]        {PROGRAM} VERB --help explains one verb"


def overview() -> str:
    """The help text: verbs by purpose, then what to try first."""
    lines = ["Run, watch, stop, record and judge a robot swarm.", "", f"usage: {USAGE}"]
    for group in dict.fromkeys(verb.group for verb in VERBS.values()):
        lines += ["", f"{group}:"]
        lines += [f"  {name:<12}{verb.help}" for name, verb in VERBS.items() if verb.group == group]
    lines += [
        "",
        "First steps:",
        f"  {PROGRAM} demo --out run1       a mission with emulated robots, recorded in run1/",
        f"  {PROGRAM} report run1           its figures and run1/report.html",
        f"  {PROGRAM} stop                  from any terminal, at any time",
        "",
        "Exit codes: 0 good, 1 failed (says how), 2 bad input.",
    ]
    return "\n".join(lines)


def parser_of(name: str, module: ModuleType) -> argparse.ArgumentParser:
    """The argument parser of one verb."""
    parser = argparse.ArgumentParser(
        prog=f"{PROGRAM} {name}",
        description=VERBS[name].help[0].upper() + VERBS[name].help[1:] + ".",
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(verb=name)
    module.configure(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    if not words or words[0] in ("-h", "--help", "help"):
        print(overview())
        return 0 if words else 2
    name = words[0]
    if name == "--version":
        from importlib.metadata import PackageNotFoundError, version

        try:
            print(f"{PROGRAM} {version('ahdc-fieldkit')}")
        except PackageNotFoundError:
            print(f"{PROGRAM}, not installed")
        return 0
    if name not in VERBS:
        return _unknown(name)
    if argv is None and name == "simulate":
        compiled.take()
    try:
        module = importlib.import_module(VERBS[name].module)
    except ImportError as error:
        return _missing(name, error)
    try:
        args = parser_of(name, module).parse_args(words[1:])
    except SystemExit as ending:
        return ending.code if isinstance(ending.code, int) else 2
    try:
        code: int = module.run(args)
        sys.stdout.flush()
        return code
    except (ArenaError, NoArenaError) as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _unknown(name: str) -> int:
    import difflib

    close = difflib.get_close_matches(name, VERBS, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"verbs: {', '.join(VERBS)}"
    print(f"{PROGRAM}: no verb {name!r}; {hint}", file=sys.stderr)
    return 2


def _missing(name: str, error: ImportError) -> int:
    """A package that this verb needs is not installed: name it and the remedy."""
    package = error.name or str(error)
    print(
        f"{PROGRAM} {name}: needs {package}, which is not installed; remedy: pip install 'ahdc-fieldkit[station]'",
        file=sys.stderr,
    )
    return 1
