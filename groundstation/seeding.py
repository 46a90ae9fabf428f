"""``seed``: other targets for the station's session, from a terminal; checked as the arena page checks them."""

import argparse
import json
import os
import sys
import time
from pathlib import Path

from msgspec.structs import replace

from contract.arena import Arena
from contract.messages import RunStatus, TargetCloud
from groundstation.current import arena_of
from groundstation.errands import ANSWER_S, REPEAT_S, no_session
from groundstation.link import Link, LinkError
from groundstation.page_seed import SeedError, cloud, points_of, unreachable
from groundstation.targets import CloudError, cloud_of


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Give the session other targets while the swarm is disarmed: points, a seeded cloud, or a file as the "
        "arena page saves it."
    )
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    wish = parser.add_mutually_exclusive_group(required=True)
    wish.add_argument("--points", nargs="+", metavar="X,Y", help="places in m, such as 1.2,3.0")
    wish.add_argument("--count", type=int, metavar="N", help="a cloud of N targets, drawn with --seed")
    wish.add_argument("--file", type=Path, metavar="FILE", help="JSON: a list of [x, y] in m")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the cloud (%(default)s)")


def wished(arena: Arena, args: argparse.Namespace, mission: str) -> TargetCloud:
    """The cloud asked for.

    :raises SeedError: a target that cannot be.
    :raises CloudError: the floor cannot hold the cloud.
    """
    if args.count is not None:
        if not 1 <= args.count <= 1000:
            raise SeedError(f"--count {args.count}: 1 to 1000")
        return cloud_of(
            replace(arena, targets=replace(arena.targets, count=args.count, seed=args.seed, points=())), mission
        )
    try:
        value = (
            json.loads(args.file.read_text()) if args.file else [list(map(float, p.split(","))) for p in args.points]
        )
    except (OSError, ValueError) as error:
        raise SeedError(f"targets: {error}; X,Y in metres, such as 1.2,3.0") from None
    return cloud(arena, points_of(value.get("targets") if isinstance(value, dict) else value), mission)


def run(args: argparse.Namespace) -> int:
    arena = arena_of(args.arena)
    try:
        wish = wished(arena, args, f"{arena.arena.name}-{time.time_ns() // 1_000_000 % 1_000_000}")
    except (SeedError, CloudError) as error:
        print(error, file=sys.stderr)
        return 2
    far = unreachable([(t.x_m, t.y_m) for t in wish.targets], arena.control.sensing_radius_m)
    for number, distance_m in far:
        print(f"T{number + 1:02d} is {distance_m:.2f} m from the others: out of reach", file=sys.stderr)
    try:
        with Link(arena, f"seed-{os.getpid()}", timeout_s=2.0) as link:
            link.subscribe([link.keys.status])
            return ask(link, wish)
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1


def ask(link: Link, wish: TargetCloud) -> int:
    """Publish it until the session has it; 0 then."""
    status: RunStatus | None = None
    deadline = time.monotonic() + ANSWER_S
    while time.monotonic() < deadline:
        link.publish(link.keys.seed, wish, "seed")
        link.wait(REPEAT_S)
        for _, message in link.drain():
            status = message if isinstance(message, RunStatus) else status
        if status is not None and status.mission == wish.mission:
            print(f"mission {status.mission}: {status.targets} targets open; arm, then start")
            return 0
    if status is None:
        return no_session()
    print(f"{status.detail or status.phase}: targets change only while disarmed", file=sys.stderr)
    return 1
