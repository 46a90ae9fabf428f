"""``faults``: inject every fault of the matrix at random moments of lockstep missions over real bytes, and judge.

What is judged is what the emulated motors decoded and how far the bodies rolled, never what a robot says of itself.
"""

import argparse
import math
import random
import statistics
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from contract.messages import MotorSample
from groundstation.conditions import FIELD
from groundstation.faultrows import ROWS, Row, allowed_m, wire_of
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario

ROBOTS, TARGETS = 3, 19
FIRST_S, LAST_S = 0.5, 3.0
"""Faults come at a random moment between these, of the mission."""
WATCH_S = 2.5
STEP_S = 0.01
REST_MPS = 0.01


class Outcome(msgspec.Struct, frozen=True):
    """What one fault did."""

    row: str
    seed: int
    victim: str
    at_s: float
    speed_mps: float
    """Of the victim when the fault came."""
    zero_s: float | None
    """To the last stretch of zero setpoints or released motors; None: it never began."""
    rest_s: float | None
    rolled_m: float
    failsafe: tuple[str, ...]
    collisions: int
    split: bool
    """The unaffected robots, whole before, came apart, even with the victim between them."""
    faults: tuple[str, ...] = ()
    """What is wrong with it; empty: as the row demands."""


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
    watched = _watch(world, victim, at_s)
    zero_s = zero_after_s(wire.emulated.samples(victim), fault_ns, first=row.resumes)
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
    )
    return msgspec.structs.replace(outcome, faults=tuple(judge(row, outcome, allowed_m(row, world.arena))))


def _watch(world: World, victim: str, at_s: float) -> _Watch:
    """Play on, with an eye on the victim's body and on the others' network."""
    wire = wire_of(world)
    others = [name for name in world.agents if name != victim]
    whole = connected(world, others) and connected(world, list(world.agents))
    place = world.hops.pose(victim)[:2]
    rolled, rest_s, split = 0.0, None, False
    spoken: list[str] = []
    for step in range(round(WATCH_S / STEP_S)):
        world.until(at_s + (step + 1) * STEP_S)
        now = world.hops.pose(victim)[:2]
        rolled += math.dist(place, now)
        place = now
        left, right = wire.emulated.speeds(victim)
        rest = max(abs(left), abs(right)) * world.arena.platform.wheel_radius_m < REST_MPS
        rest_s = None if not rest else (step + 1) * STEP_S if rest_s is None else rest_s
        split = split or (whole and not connected(world, others) and not connected(world, list(world.agents)))
        verdict = world.agents[victim].verdict
        if verdict is not None and verdict.failsafe and verdict.failsafe not in spoken:
            spoken.append(verdict.failsafe)
    return _Watch(rest_s, rolled, tuple(spoken), split)


def connected(world: World, names: Sequence[str]) -> bool:
    """Whether these robots alone are one piece."""
    places = {name: world.hops.pose(name)[:2] for name in names}
    inside, frontier = {names[0]}, [names[0]]
    while frontier:
        first = frontier.pop()
        near = [n for n in names if n not in inside and math.dist(places[first], places[n]) <= world.radius_m]
        inside.update(near)
        frontier += near
    return len(inside) == len(names)


def zero_after_s(samples: Iterable[MotorSample], fault_ns: int, first: bool = False) -> float | None:
    """From the fault to the last, or the first, stretch of zeros or released motors; None: there is none such."""
    began = None
    for sample in samples:
        if sample.stamp_ns < fault_ns:
            continue
        if sample.released or not sample.enabled or (sample.left_radps == 0.0 == sample.right_radps):
            began = sample.stamp_ns if began is None else began
        elif not first:
            began = None
    return None if began is None else round((began - fault_ns) * 1e-9, 4)


def judge(row: Row, outcome: Outcome, allowed: float) -> Iterator[str]:
    """What the row demands and the outcome lacks, in words."""
    if outcome.collisions:
        yield f"{outcome.collisions} collision(s)"
    if outcome.split:
        yield "the others came apart"
    if row.zero_s is None:
        if outcome.failsafe:
            yield f"stopped by {', '.join(outcome.failsafe)}"
        return
    if outcome.zero_s is None and outcome.rest_s is None:
        yield "neither a zero nor rest"
    elif outcome.zero_s is not None and outcome.zero_s > row.zero_s:
        yield f"zero after {outcome.zero_s:g} s, {row.zero_s:g} s allowed"
    if outcome.rest_s is None and not row.resumes:
        yield f"still moving after {WATCH_S:g} s"
    if outcome.rolled_m > allowed:
        yield f"rolled {outcome.rolled_m:g} m, {allowed:.2f} m allowed"
    if row.failsafes and not set(row.failsafes) & set(outcome.failsafe):
        yield f"spoke {', '.join(outcome.failsafe) or 'nothing'}, expected {' or '.join(row.failsafes)}"


def percentiles(values: Sequence[float]) -> tuple[float, float, float] | None:
    """(p50, p99, max); None for no values."""
    if not values:
        return None
    ordered = sorted(values)
    return statistics.median(ordered), ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))], ordered[-1]


def markdown(outcomes: Sequence[Outcome], repetitions: int) -> str:
    """``docs/fault-matrix.md``."""
    lines = [
        "# Fault matrix",
        "",
        f"Written by `ahdc-groundstation faults --repetitions {repetitions} --markdown docs/fault-matrix.md`:",
        f"{len(ROWS)} faults, each injected {repetitions} time(s) at a random millisecond of a lockstep mission of",
        f"{ROBOTS} robots over real bytes ([groundstation/faultrows.py](../groundstation/faultrows.py)).",
        "*Zero* is the time from the fault to the last stretch of zero setpoints or released motors that the emulated",
        "controller decoded; - where it decoded nothing any more. *Rolled* is the way of the victim's body after the",
        "fault. A run is good if both stay within their bounds, the body comes to rest, nobody collides, the other",
        "robots' network stays whole, and the failsafe named speaks.",
        "",
        "| where | fault | action | zero allowed ms | zero p50/p99/max ms | rolled max m | allowed m | spoke | good |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    arena = arena_for(Job(ROBOTS, TARGETS, 1, "field", "field", 60.0))
    for row in ROWS:
        runs = [outcome for outcome in outcomes if outcome.row == row.name]
        zeros = percentiles([run.zero_s * 1e3 for run in runs if run.zero_s is not None]) if row.zero_s else None
        measured = " / ".join(f"{value:.0f}" for value in zeros) if zeros else "-"
        spoke = ", ".join(dict.fromkeys(f"`{name}`" for run in runs for name in run.failsafe)) or "-"
        deadline = "-" if row.zero_s is None else f"{row.zero_s * 1e3:.0f}"
        allowed = "-" if row.zero_s is None else f"{allowed_m(row, arena):.2f}" if not row.resumes else "-"
        rolled = "-" if row.zero_s is None else f"{max((run.rolled_m for run in runs), default=0.0):.2f}"
        good = f"{sum(not run.faults for run in runs)}/{len(runs)}"
        fault = row.fault + (f" ({row.family})" if row.family else "")
        cells = (row.where, fault, row.action, deadline, measured, rolled, allowed, spoke, good)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rows", default="", metavar="TEXT", help="only rows whose name contains this text")
    parser.add_argument("--repetitions", type=int, default=1, metavar="N", help="missions a row (default 1)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="seed of the first repetition (default 1)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every outcome as JSON")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the matrix")
    parser.add_argument("--list", action="store_true", help="list the rows and end")


def run(args: argparse.Namespace) -> int:
    """Exit code 0 where every outcome is as its row demands."""
    rows = [row for row in ROWS if args.rows in row.name]
    if args.list or not rows or args.repetitions < 1:
        print("\n".join(row.name for row in ROWS))
        return 0 if args.list else 2
    outcomes = []
    for row in rows:
        for seed in range(args.seed, args.seed + args.repetitions):
            outcome = play(row, seed)
            outcomes.append(outcome)
            verdict = "good" if not outcome.faults else f"BAD seed {seed}: {'; '.join(outcome.faults)}"
            print(f"{row.name:<50} zero {outcome.zero_s} s, rolled {outcome.rolled_m} m, {verdict}", flush=True)
    if args.json:
        args.json.write_bytes(msgspec.json.format(msgspec.json.encode(outcomes)))
    if args.markdown:
        args.markdown.write_text(markdown(outcomes, args.repetitions), encoding="utf-8")
    bad = [outcome for outcome in outcomes if outcome.faults]
    print(f"{len(outcomes) - len(bad)} of {len(outcomes)} good", file=sys.stderr)
    return 1 if bad else 0
