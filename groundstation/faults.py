"""``faults``: inject every fault of the matrix at random moments of lockstep missions over real bytes, and judge.

What is judged is what the emulated motors decoded and how far the bodies rolled, never what a robot says of itself.
"""

import argparse
import math
import random
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from groundstation import faultreal
from groundstation.conditions import FIELD
from groundstation.faultkept import Kept
from groundstation.faultpage import markdown
from groundstation.faultreal import REAL_ROWS
from groundstation.faultrows import ROWS, Outcome, Row, allowed_m, wire_of
from groundstation.faultwords import gentle_radps, judge, zero_after_s
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario

ROBOTS, TARGETS = 3, 19
FIRST_S, LAST_S = 0.5, 3.0
"""Faults come at a random moment between these, of the mission."""
WATCH_S = 2.5
LONGEST_S = 10.0
"""A fault that only turning wheels show is looked at until it has shown, but no longer than this."""
STEP_S = 0.01
REST_MPS = 0.01
NOWHERE: Mapping[str, tuple[float, float]] = {}


class _Watch(NamedTuple):
    rest_s: float | None
    rolled_m: float
    failsafes: tuple[str, ...]
    split: bool


def play(row: Row, seed: int) -> Outcome:
    """One fault of one row in one mission."""
    draw = random.Random(f"{row.name} {seed}")
    job = Job(ROBOTS, TARGETS, seed, "field", "field", 60.0, wired=True)
    world = World(arena_for(job), scenario(ROBOTS, TARGETS, seed), FIELD, seed, 60.0, wired=True)
    robots = world.arena.robots
    victim = draw.choice([name for name in robots if row.family in ("", robots[name].wheels["kind"])])
    at_s = round(draw.uniform(FIRST_S, LAST_S), 3)
    world.until(at_s)
    wire = wire_of(world)
    for name in robots:
        wire.emulated.samples(name)
    before, collisions = wire.emulated.speeds(victim), world.referee.collisions
    speed = abs(before.left_radps + before.right_radps) / 2 * world.arena.platform.wheel_radius_m
    fault_ns = world.now_ns
    row.inject(world, victim)
    watched = _watch(world, row, victim, at_s)
    zero_s = zero_after_s(wire.emulated.samples(victim), fault_ns, row.resumes, gentle_radps(row, world.arena))
    outcome = Outcome(
        row=row.name,
        seed=seed,
        victim=victim,
        at_s=at_s,
        speed_mps=round(speed, 3),
        zero_s=zero_s,
        rest_s=watched.rest_s,
        rolled_m=round(watched.rolled_m, 4),
        failsafe=watched.failsafes,
        collisions=world.referee.collisions - collisions,
        split=watched.split,
        state=world.agents[victim].run_state,
    )
    return msgspec.structs.replace(outcome, faults=tuple(judge(row, outcome, allowed_m(row, world.arena))))


def _watch(world: World, row: Row, victim: str, at_s: float) -> _Watch:
    """Play on, with an eye on the victim's body and on the others' network.

    Where no program can keep the victim where it is, those that hang together by it alone when it says so may part. One
    that is cut off rolls on for a while: they must be whole with it where it is, or where it was cut off.
    """
    wire = wire_of(world)
    hopeless = row.action == "named"
    everybody = list(world.agents)
    others = [name for name in everybody if name != victim]
    whole = connected(world, others) and connected(world, everybody) and not hopeless
    began = place = world.hops.pose(victim)[:2]
    left_at = {victim: began} if row.action == "CUT" else {}
    rolled, rest_s, split = 0.0, None, False
    spoken: list[str] = []
    for step in range(1, round(LONGEST_S / STEP_S) + 1):
        world.until(at_s + step * STEP_S)
        now = world.hops.pose(victim)[:2]
        rolled += math.dist(place, now)
        place = now
        left, right = wire.emulated.speeds(victim)
        rest = max(abs(left), abs(right)) * world.arena.platform.wheel_radius_m < REST_MPS
        rest_s = None if not rest else step * STEP_S if rest_s is None else rest_s
        split = split or (
            whole and not any(connected(world, *who) for who in ((others,), (everybody,), (everybody, left_at)))
        )
        verdict = world.agents[victim].verdict
        if verdict is not None and verdict.failsafe and verdict.failsafe not in spoken:
            if hopeless and not spoken:
                whole = connected(world, others) and linked(world, others)
            spoken.append(verdict.failsafe)
        if step * STEP_S >= WATCH_S and not (row.turning and world.agents[victim].run_state not in row.ends):
            break
    return _Watch(rest_s, rolled, tuple(spoken), split)


def connected(world: World, names: Sequence[str], left_at: Mapping[str, tuple[float, float]] = NOWHERE) -> bool:
    """Whether these robots alone are one piece: by who is within r_c of whom.

    :param left_at: places of robots that count instead of where they are.
    """
    places = {name: left_at.get(name) or world.hops.pose(name)[:2] for name in names}
    return _one_piece(names, lambda a, b: math.dist(places[a], places[b]) <= world.radius_m)


def linked(world: World, names: Sequence[str]) -> bool:
    """Whether these robots alone are one piece: by the links that neither end is offering or giving up."""
    held = {name: world.agents[name].controller.link_states() for name in names}
    return _one_piece(names, lambda a, b: held[a].get(b) == "on" == held[b].get(a))


def _one_piece(names: Sequence[str], together: Callable[[str, str], bool]) -> bool:
    inside, frontier = {names[0]}, [names[0]]
    while frontier:
        first = frontier.pop()
        near = [name for name in names if name not in inside and together(first, name)]
        inside.update(near)
        frontier += near
    return len(inside) == len(names)


def _judge_again(kept: Kept) -> None:
    """By the rows as they are now, not as they were when it was played; rows that have gone are left out."""
    arena = arena_for(Job(ROBOTS, TARGETS, 1, "field", "field", 60.0))
    rows = {row.name: row for row in ROWS}
    kept.outcomes = {
        key: msgspec.structs.replace(outcome, faults=tuple(judge(row, outcome, allowed_m(row, arena))))
        for key, outcome in kept.outcomes.items()
        if (row := rows.get(outcome.row)) is not None
    }


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rows", default="", metavar="TEXT", help="only rows whose name contains this text")
    parser.add_argument(
        "--repetitions", type=int, default=1, metavar="N", help="missions a row (default 1); 0: what --progress has"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="seed of the first repetition (default 1)")
    parser.add_argument("--real", action="store_true", help="the rows of real processes, in the real-time arena")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every outcome as JSON")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the matrix")
    parser.add_argument(
        "--progress", type=Path, metavar="DIR", help="keep every outcome there and skip what is there: go on later"
    )
    parser.add_argument("--list", action="store_true", help="list the rows and end")


def run(args: argparse.Namespace) -> int:
    """Exit code 0 where every outcome is as its row demands."""
    rows = [row for row in (REAL_ROWS if args.real else ROWS) if args.rows in row.name]
    if args.list or not rows or args.repetitions < (0 if args.progress else 1):
        print("\n".join(row.name for row in (REAL_ROWS if args.real else ROWS)))
        return 0 if args.list else 2
    kept = {True: Kept(args.progress, "real"), False: Kept(args.progress, "lockstep")}
    wanted = [(row, seed) for seed in range(args.seed, args.seed + args.repetitions) for row in rows]
    if args.real:
        faultreal.play_all(wanted, kept[True])
    else:
        for row, seed in wanted:
            if (row.name, seed) not in kept[False].outcomes:
                kept[False].add(play(row, seed))
    _judge_again(kept[False])
    outcomes = list(kept[args.real].outcomes.values())
    if args.json:
        args.json.write_bytes(msgspec.json.format(msgspec.json.encode(outcomes)))
    if args.markdown:
        arena = arena_for(Job(ROBOTS, TARGETS, 1, "field", "field", 60.0))
        lockstep, real = (list(kept[key].outcomes.values()) for key in (False, True))
        args.markdown.write_text(markdown(lockstep, real, arena), encoding="utf-8")
    bad = [outcome for outcome in outcomes if outcome.faults]
    print(f"{len(outcomes) - len(bad)} of {len(outcomes)} good", file=sys.stderr)
    return 1 if bad else 0
