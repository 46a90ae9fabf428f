"""``exclude`` and ``readmit``: who belongs to the network, asked of the station's session from any terminal."""

import argparse
import os
import sys
import time
from collections.abc import Collection
from pathlib import Path
from typing import Literal

from contract.arena import Arena
from contract.messages import OrderRequest, RunStatus
from groundstation.current import arena_of
from groundstation.errands import ANSWER_S, no_session, statuses
from groundstation.link import Link, LinkError


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("robots", nargs="+", metavar="ROBOT", help="as named in the arena file")
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    if parser.get_default("verb") == "exclude":
        parser.description = (
            "Take robots out of the network: they stand still, the others end their links with them at once and go on. "
            "The session says which pieces the others are in. For a robot that has crashed or has been carried off; "
            "STOP and disarm still reach it."
        )
    else:
        parser.description = "Take excluded robots into the network again: links are offered anew."


def run(args: argparse.Namespace) -> int:
    """Exit code 0 once the session has done so."""
    arena = arena_of(args.arena)
    if wrong := trouble(arena, args.robots):
        print(f"{args.verb}: {wrong}", file=sys.stderr)
        return 2
    try:
        with Link(arena, f"order-{os.getpid()}", timeout_s=2.0) as link:
            link.subscribe([link.keys.status])
            return ask(link, args.verb, tuple(args.robots))
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1


def trouble(arena: Arena, robots: Collection[str]) -> str:
    """What is wrong with the names; empty for nothing."""
    strangers = [name for name in robots if name not in arena.robots]
    return f"{', '.join(strangers)}: not in the arena file, which has {', '.join(arena.robots)}" if strangers else ""


def ask(link: Link, order: Literal["exclude", "readmit"], robots: tuple[str, ...]) -> int:
    """Ask until the session's status shows it."""
    number = time.time_ns() // 1_000_000
    source = f"terminal {os.getpid()}"
    asked = OrderRequest(stamp_ns=link.now_ns(), source=source, number=number, order=order, robots=robots)
    status: RunStatus | None = None
    for status in statuses(link, ANSWER_S, asked):
        if all((name in status.excluded) == (order == "exclude") for name in robots):
            print(f"excluded: {', '.join(status.excluded) or 'nobody'}; {status.detail}")
            return 0
        if status.detail.startswith(f"{order} refused"):
            print(status.detail, file=sys.stderr)
            return 1
    if status is None:
        return no_session()
    print(f"the session does not {order}", file=sys.stderr)
    return 1
