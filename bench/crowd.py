"""Cost of a robot's step in crowds of constant density: all of lockstep, law and world, in this process.

    ./kit exec python bench/crowd.py [--robots N ...] [--after S ...] [--seconds S] [--json FILE]

Robots on a grid 0.65 m wide, as many targets among them, virtual time under ideal conditions and without the garbage
collector, as ``simulate`` plays. Per number of robots, so long after the start (later on robots know of more and more
targets, and crowd): neighbours and targets known, CPU time per robot step, in it that of the agent's own step and of
its thinking, and what the world needs to come up.
Linear in the number of robots is where the time a step stays the same.
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


def crowd(robots: int, seed: int = 1) -> World:
    """So many robots on a square, each with a target somewhere around."""
    rng = random.Random(seed)
    columns = math.ceil(math.sqrt(robots))
    size_m = 2 * MARGIN_M + SPACING_M * columns
    starts = tuple(
        (MARGIN_M + SPACING_M * (k % columns) + rng.uniform(-0.03, 0.03), MARGIN_M + SPACING_M * (k // columns))
        for k in range(robots)
    )
    targets = tuple(
        (metres(rng.uniform(MARGIN_M, size_m - MARGIN_M)), metres(rng.uniform(MARGIN_M, size_m - MARGIN_M)))
        for _ in starts
    )
    few = arena_for(Job(1, 1, seed, "field", "ideal", 60.0))
    (robot,) = few.robots.values()
    names = [f"r{k + 1:04d}" for k in range(robots)]
    arena = replace(
        few,
        arena=replace(few.arena, size_m=(size_m, size_m)),
        robots={name: replace(robot, body=name, start=start) for name, start in zip(names, starts, strict=True)},
    )
    return World(arena, Scenario((size_m, size_m), starts, targets, 0.0), IDEAL, seed)


def measured(robots: int, after: Sequence[float], seconds: float) -> Iterator[dict[str, Any]]:
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
    world = crowd(robots)
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=list(ROBOTS), metavar="N", help="sizes of crowds")
    parser.add_argument(
        "--after", type=float, nargs="+", default=[0.0], metavar="S", help="virtual times to begin at (default 0)"
    )
    parser.add_argument("--seconds", type=float, default=0.5, metavar="S", help="virtual time of each (default 0.5)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, too")
    options = parser.parse_args()
    found = []
    for robots in options.robots:
        with undisturbed():
            for line in measured(robots, options.after, options.seconds):
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
