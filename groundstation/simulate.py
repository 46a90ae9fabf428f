"""Sweeps of missions in virtual time: ``ahdc-groundstation simulate``."""

import argparse
import math
import multiprocessing
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec

from contract.arena import Arena, Control, FieldControl, Floor, Mocap, Robot, Safety, Targets
from groundstation.lockstep import FIELD, IDEAL, Conditions, Result, World
from groundstation.targets import CloudError, scenario

MAX_LIMIT_S = 86_400.0
CONDITIONS = {"ideal": IDEAL, "field": FIELD}
WHEELS: tuple[dict[str, Any], ...] = (
    {"kind": "odrive", "interface": "slcan", "channel": "/dev/null", "left": 0, "right": 1, "watchdog_s": 0.2},
    {"kind": "roboclaw", "port": "/dev/null", "counts_per_revolution": 2048},
)
"""Of the robots in turn; no port is ever opened."""
IDEAL_BRAKE = FieldControl(brake_deceleration_mps2=(100.0, 100.0), motor_lag_s=(0.001, 0.001))


class Job(NamedTuple):
    """One run of a sweep."""

    robots: int
    targets: int
    seed: int
    profile: Literal["field", "paper"]
    conditions: str
    limit_s: float
    wired: bool = False


def arena_for(job: Job) -> Arena:
    """The arena of a sweep's run: the paper's parameters, the scenario's floor, ``robots`` robots."""
    place = scenario(job.robots, job.targets, job.seed)
    field = IDEAL_BRAKE if job.conditions == "ideal" else FieldControl()
    return Arena(
        arena=Floor(name="simulate", size_m=place.size_m, fence_m=0.0),
        robots={
            f"r{i + 1:02d}": Robot(
                body=f"r{i + 1:02d}", start=start, wheels=WHEELS[i % len(WHEELS)], emulate=("wheels", "body")
            )
            for i, start in enumerate(place.starts)
        },
        mocap=Mocap(frame_rate_hz=100.0),
        control=Control(profile=job.profile, field=field),
        safety=Safety(max_slew_mps2=1000.0) if job.conditions == "ideal" else Safety(),
        targets=Targets(count=job.targets, seed=job.seed),
    )


def play(job: Job, conditions: Conditions | None = None) -> Result:
    """One run, from nothing but the job."""
    place = scenario(job.robots, job.targets, job.seed)
    world = World(
        arena_for(job), place, conditions or CONDITIONS[job.conditions], job.seed, job.limit_s, wired=job.wired
    )
    return world.run()


def _play_quietly(job: Job) -> Result:
    try:
        return play(job)
    except CloudError as error:
        return Result(
            job.seed, job.robots, job.targets, False, 0, 0.0, 0, 0, 0.0, 0.0, None, 0, f"no scenario: {error}"
        )


def sweep(jobs: list[Job], workers: int) -> Iterator[Result]:
    """Results in the order of the jobs."""
    if workers <= 1:
        yield from map(_play_quietly, jobs)
        return
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(_play_quietly, jobs, chunksize=1)


def interval(values: list[float]) -> tuple[float, float]:
    """Mean and half-width of its 95 % interval (normal for many values)."""
    if len(values) < 2:
        return (values[0] if values else math.nan, math.nan)
    return (statistics.fmean(values), 1.96 * statistics.stdev(values) / math.sqrt(len(values)))


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Fly missions in virtual time with the very control law of the robots. "
        "Example: ahdc-groundstation simulate --robots 6 --targets 19 --runs 100 --seed 1 --workers 2"
    )
    parser.add_argument("--robots", type=int, default=6, metavar="N", help="robots (default 6)")
    parser.add_argument("--targets", type=int, default=19, metavar="M", help="targets (default 19)")
    parser.add_argument("--runs", type=int, default=10, metavar="R", help="missions, seeds S, S+1, ... (default 10)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="first seed (default 1)")
    parser.add_argument(
        "--profile", choices=("field", "paper"), default="field", help="control profile (default field)"
    )
    parser.add_argument(
        "--conditions", choices=tuple(CONDITIONS), default="ideal", help="what the world does (default ideal)"
    )
    parser.add_argument("--workers", type=int, default=1, metavar="K", help="processes (default 1)")
    parser.add_argument(
        "--limit-s", type=float, default=180.0, help="give a mission up after this virtual time (default 180)"
    )
    parser.add_argument(
        "--wire", action="store_true", help="every hop real bytes: NatNet, JSON, CAN or serial (about as slow as life)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every run as JSON")


def run(args: argparse.Namespace) -> int:
    for name, low in (("robots", 1), ("targets", 1), ("runs", 1), ("workers", 1)):
        if getattr(args, name) < low:
            print(f"simulate: --{name} {getattr(args, name)}: at least {low} needed", file=sys.stderr)
            return 2
    if not 0.0 < args.limit_s <= MAX_LIMIT_S:
        print(f"simulate: --limit-s {args.limit_s:g}: above 0, at most {MAX_LIMIT_S:g} s", file=sys.stderr)
        return 2
    jobs = [
        Job(args.robots, args.targets, args.seed + k, args.profile, args.conditions, args.limit_s, args.wire)
        for k in range(args.runs)
    ]
    results: list[Result] = []
    began = time.monotonic()
    shown = began
    for result in sweep(jobs, args.workers):
        results.append(result)
        now = time.monotonic()
        if now - shown > 1 or len(results) == len(jobs):
            shown = now
            done = sum(r.completed for r in results)
            print(f"\r{len(results)}/{len(jobs)} runs, {done} completed, {now - began:.0f} s", end="", file=sys.stderr)
    print(file=sys.stderr)
    if args.json:
        args.json.write_bytes(msgspec.json.format(msgspec.json.encode({"runs": results})))
    print(summary(results))
    good = all(r.completed and not r.disconnected_steps and not r.collisions for r in results)
    return 0 if good else 1


def summary(results: list[Result]) -> str:
    """The sweep in a few lines."""
    ratios = [r.ratio_to_lower_bound for r in results if r.ratio_to_lower_bound is not None]
    times = [r.mission_s for r in results if r.completed]
    mean, half = interval(times)
    split = [r.seed for r in results if r.disconnected_steps]
    hit = [r.seed for r in results if r.collisions]
    failed = [r.seed for r in results if not r.completed]
    lines = [
        f"completed {len(times)}/{len(results)}" + (f", failed seeds {failed[:20]}" if failed else ""),
        f"mission {mean:.2f} +- {half:.2f} s (mean, 95 %), ratio to the lower bound: median "
        + (f"{statistics.median(ratios):.3f}" if ratios else "none"),
        f"disconnected runs {len(split)}" + (f", seeds {split[:20]}" if split else ""),
        f"runs with collisions {len(hit)}" + (f", seeds {hit[:20]}" if hit else ""),
        f"least distance {min((r.min_distance_m for r in results), default=0.0):.3f} m",
    ]
    return "\n".join(lines)
