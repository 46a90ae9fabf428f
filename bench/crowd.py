"""Cost of a robot's step in crowds of constant density: all of lockstep, law and world, in this process.

    ./kit exec python bench/crowd.py [--robots N ...] [--columns N] [--after S ...] [--seconds S] [--json FILE]

Robots on a grid 0.65 m wide, as many targets among them, virtual time under ideal conditions and without the garbage
collector, as ``simulate`` plays. Per number of robots, so long after the start (later on robots know of more and more
targets, and crowd): neighbours and targets known, CPU time per robot step, in it that of the agent's own step and of
its thinking, and what the world needs to come up; last, the time per step of the robots by which this crowd is larger
than the one before it, the first of all.

The cost is linear in the number of robots where each robot added costs the same. In a small square it does not: most
of its robots stand near an edge, and have fewer around them than those that come after. ``--columns`` makes the crowd a
strip of that width, which has the same two ends however long it is: there the last column stays the same.
"""

import argparse
import gc
import json
import math
import random
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from contract.units import metres
from groundstation.conditions import IDEAL
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for, undisturbed
from groundstation.targets import Scenario
from onboard.agent import Agent

ROBOTS = (10, 30, 100, 300, 1000, 2000)
SPACING_M = 0.65
MARGIN_M = 0.5
BLOCK = 8
"""Rows of robots among which their targets are."""
NOBODY: dict[str, Any] = {"robots": 0, "all_us": 0.0}


def crowd(robots: int, columns: int = 0, seed: int = 1) -> World:
    """So many robots, as many targets among them. A crowd begins as a shorter one of as many columns does.

    :param columns: abreast; 0: as many as make the crowd a square.
    """
    rng = random.Random(seed)
    columns = columns or math.ceil(math.sqrt(robots))
    rows = math.ceil(robots / columns)
    width_m, length_m = (2 * MARGIN_M + SPACING_M * count for count in (columns, rows))
    starts, targets = [], []
    for k in range(robots):
        row = k // columns
        first = row - row % BLOCK
        starts.append((MARGIN_M + SPACING_M * (k % columns) + rng.uniform(-0.03, 0.03), MARGIN_M + SPACING_M * row))
        along_m = SPACING_M * rng.uniform(first, min(first + BLOCK, rows))
        targets.append((metres(rng.uniform(MARGIN_M, width_m - MARGIN_M)), metres(MARGIN_M + along_m)))
    few = arena_for(Job(1, 1, seed, "field", "ideal", 60.0))
    (robot,) = few.robots.values()
    names = [f"r{k + 1:04d}" for k in range(robots)]
    arena = replace(
        few,
        arena=replace(few.arena, size_m=(width_m, length_m)),
        robots={name: replace(robot, body=name, start=start) for name, start in zip(names, starts, strict=True)},
    )
    return World(arena, Scenario((width_m, length_m), tuple(starts), tuple(targets), 0.0), IDEAL, seed)


def measured(robots: int, columns: int, after: Sequence[float], seconds: float) -> Iterator[dict[str, Any]]:
    """One crowd's figures, so long after the start each."""
    spent = {"step": 0, "think": 0}
    counted = dict.fromkeys(spent, 0)
    clock = time.process_time_ns

    def timed(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any) -> Any:
            began_ns = clock()
            found = call(*args)
            spent[name] += clock() - began_ns
            counted[name] += 1
            return found

        return run

    began_ns = clock()
    world = crowd(robots, columns)
    up_ns = clock() - began_ns
    calls = {name: getattr(Agent, name) for name in spent}
    for after_s in after:
        world.until(after_s)
        spent.update(step=0, think=0)
        counted.update(step=0, think=0)
        for name, call in calls.items():
            setattr(Agent, name, timed(name, call))
        try:
            began_ns = clock()
            world.until(after_s + seconds)
            all_ns = clock() - began_ns
        finally:
            for name, call in calls.items():
                setattr(Agent, name, call)
        steps = counted["step"]
        agents = world.agents
        near = [len(agent.sensing.sighted(world.hops.pose(name), world.now_ns)) for name, agent in agents.items()]
        yield {
            "robots": robots,
            "after_s": after_s,
            "neighbours": round(sum(near) / robots, 1),
            "known": round(sum(len(agent.controller.tasking.memory.known) for agent in agents.values()) / robots),
            "all_us": round(all_ns / steps / 1e3, 1),
            "step_us": round(spent["step"] / steps / 1e3, 1),
            "think_us": round(spent["think"] / steps / 1e3, 1),
            "up_s": round(up_ns / 1e9, 2),
        }


def added_us(few: dict[str, Any], many: dict[str, Any]) -> float:
    """CPU time per step of the robots that one crowd has beyond another, us."""
    more_us = many["all_us"] * many["robots"] - few["all_us"] * few["robots"]
    return round(more_us / (many["robots"] - few["robots"]), 1)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=list(ROBOTS), metavar="N", help="sizes of crowds")
    parser.add_argument("--columns", type=int, default=0, metavar="N", help="robots abreast (default: a square)")
    parser.add_argument(
        "--after", type=float, nargs="+", default=[0.0], metavar="S", help="virtual times to begin at (default 0)"
    )
    parser.add_argument("--seconds", type=float, default=0.5, metavar="S", help="virtual time of each (default 0.5)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, too")
    options = parser.parse_args()
    found: list[dict[str, Any]] = []
    for robots in options.robots:
        with undisturbed():
            for line in measured(robots, options.columns, options.after, options.seconds):
                before = [other for other in found if other["after_s"] == line["after_s"] and other["robots"] < robots]
                line["added_us"] = added_us(before[-1] if before else NOBODY, line)
                found.append(line)
                if len(found) == 1:
                    print("".join(f"{name:>11}" for name in line))
                print("".join(f"{value:>11}" for value in line.values()), flush=True)
        gc.collect()
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
