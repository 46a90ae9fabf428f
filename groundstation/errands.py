"""``repeat`` and ``home``: orders the station needs time for, followed from the terminal until they are done."""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from contract.arena import Arena
from contract.messages import MocapFrame, OrderRequest, RunStatus
from groundstation.current import arena_of
from groundstation.homeward import timeout_s
from groundstation.link import Link, LinkError
from groundstation.sighting import misplaced

REPEAT_S = 0.2
ANSWER_S = 2.0
HOME_MORE_S = 20.0
"""Given to the way home beyond what the session gives it."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    if parser.get_default("verb") == "home":
        parser.description = (
            "Arm every robot, drive it to its start pose and disarm. Links are released; fence, separation, "
            "failsafes and STOP hold as ever. Ctrl-C disarms."
        )
    else:
        parser.description = (
            "Make the same targets a new mission: robots forget which are occupied. Then arm and start. "
            "The recorder begins a new run folder."
        )


def run(args: argparse.Namespace) -> int:
    arena = arena_of(args.arena)
    try:
        with Link(arena, f"order-{os.getpid()}", timeout_s=2.0) as link:
            link.subscribe([link.keys.status])
            return go_home(arena, link) if args.verb == "home" else repeat(link)
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1


def request(link: Link, order: Literal["repeat", "home", "disarm"]) -> OrderRequest:
    """An order with a number of its own."""
    number = time.time_ns() // 1_000_000
    return OrderRequest(stamp_ns=link.now_ns(), source=f"terminal {os.getpid()}", number=number, order=order)


def statuses(link: Link, patience_s: float, asked: OrderRequest | None = None) -> Iterator[RunStatus]:
    """The session's statuses for so long; the order is sent again and again, the session obeys it once."""
    deadline = time.monotonic() + patience_s
    due = time.monotonic()
    while (now := time.monotonic()) < deadline:
        if asked is not None and now >= due:
            link.publish(link.keys.order, asked, "order")
            due = now + REPEAT_S
        link.wait(min(REPEAT_S, deadline - now))
        yield from (message for _, message in link.drain() if isinstance(message, RunStatus))


def repeat(link: Link) -> int:
    """Ask for the same targets again; 0 once the session has a new mission."""
    before = next(statuses(link, ANSWER_S), None)
    if before is None:
        return no_session()
    for status in statuses(link, ANSWER_S, request(link, "repeat")):
        if status.mission != before.mission:
            print(f"mission {status.mission}: {status.targets} targets open; arm, then start")
            return 0
        if status.detail.startswith("repeat refused"):
            print(f"{status.detail}; disarm first (release), then repeat", file=sys.stderr)
            return 1
    print("the session does not repeat", file=sys.stderr)
    return 1


def go_home(arena: Arena, link: Link) -> int:
    """Ask for it and follow the way home; 0 once every robot is there, as motion capture sees it."""
    link.subscribe([link.keys.mocap_frame])
    going = False
    words = ""
    status: RunStatus | None = None
    try:
        for status in statuses(link, timeout_s(arena) + HOME_MORE_S, request(link, "home")):
            going = going or status.phase == "homing"
            if status.detail.startswith("home refused"):
                print(status.detail, file=sys.stderr)
                return 1
            if going and status.phase != "homing":
                return _arrived(arena, link, status)
            if going and status.detail != words:
                words = status.detail
                print(words, flush=True)
    except KeyboardInterrupt:
        link.publish(link.keys.order, request(link, "disarm"), "order")
        print(f"\ndisarmed {len(arena.robots)} robots", file=sys.stderr)
        return 130
    return no_session() if status is None else 1


def _arrived(arena: Arena, link: Link, status: RunStatus) -> int:
    frame = None
    deadline = time.monotonic() + ANSWER_S
    while frame is None and (left := deadline - time.monotonic()) > 0:
        link.wait(left)
        frame = next((message for _, message in link.drain() if isinstance(message, MocapFrame)), None)
    away = misplaced(arena, {b.robot: (b.x_m, b.y_m) for b in frame.bodies if b.valid}) if frame else ["no poses"]
    if away or status.phase not in ("waiting", "ready"):
        print(f"{status.phase}: {status.detail}; {'; '.join(away)}", file=sys.stderr)
        return 1
    print(f"all {len(arena.robots)} robots at home")
    return 0


def no_session() -> int:
    """Say so; exit code 1."""
    print("no station session answers; run `ahdc-groundstation session` or the demo", file=sys.stderr)
    return 1
