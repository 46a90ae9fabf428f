"""Cost of one robot's control step, in this process: what the law, the limits and the whole step take.

    ./kit exec python bench/law_step.py [--robots N ...] [--seconds S] [--repeat R] [--json FILE] [--compiled]

Missions in virtual time under field conditions, both profiles, with the garbage collector set as robots set it. Per
number of robots and of neighbours in sight: median and 99th percentile in microseconds of ``act`` (velocity and plan),
``think`` (tasks and links), ``limit`` (fence and separation), ``law`` (the three together), ``cut`` (the limit on what
a robot cut off would do), ``step`` (the agent from newest pose to wheel speeds) and ``announce`` (one state message).
Of machine code (``--compiled``, after ``ahdc-groundstation compile``) only ``step`` can be told. Times of one machine
and one run compare; others do not.
"""

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import onboard.agent as agents
import onboard.guard as guards
from groundstation import compiled
from groundstation.conditions import FIELD
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from onboard.ahdc.controller import Controller
from onboard.service import quiet

ROBOTS = (2, 4, 6, 7, 10, 15, 20)
TARGETS_A_ROBOT = 3
COMPILED = not str(agents.__file__).endswith(".py")
FIGURES = ("step",) if COMPILED else ("act", "think", "limit", "law", "cut", "step", "announce")
FEWEST_STEPS = 50
"""Rows of fewer steps are left out."""

Times = dict[str, list[int]]
Profile = Literal["field", "paper"]


@contextmanager
def timed(owner: Any, name: str, times: list[int]) -> Iterator[None]:
    """Append to ``times`` what every call of ``owner.name`` takes, ns."""
    call: Callable[..., Any] = getattr(owner, name)
    clock = time.perf_counter_ns

    def measured(*args: Any) -> Any:
        began_ns = clock()
        result = call(*args)
        times.append(clock() - began_ns)
        return result

    setattr(owner, name, measured)
    try:
        yield
    finally:
        setattr(owner, name, call)


class Clocked:
    """The way between bodies and agents, timed from outside, for nothing can be put into machine code: a step is what
    happens between feeling the wheels and driving them."""

    def __init__(self, world: World, times: list[int], neighbours: list[int]) -> None:
        self._hops, self._agents, self._times, self._neighbours = world.hops, world.agents, times, neighbours
        self._began_ns = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hops, name)

    def sense(self, name: str, now_ns: int) -> None:
        self._hops.sense(name, now_ns)
        self._began_ns = time.perf_counter_ns()

    def drive(self, name: str, drive: agents.Drive, now_ns: int) -> bool:
        if self._began_ns:
            self._times.append(time.perf_counter_ns() - self._began_ns)
            sensing = self._agents[name].sensing
            own = sensing.own()
            self._neighbours.append(len(sensing.sighted(own[0], now_ns)) if own else 0)
            self._began_ns = 0
        return self._hops.drive(name, drive, now_ns)


def measure(robots: int, profile: Profile, seed: int, seconds: float) -> tuple[Times, list[int]]:
    """Times of every call of one mission, and the neighbours in sight at every step."""
    job = Job(robots, TARGETS_A_ROBOT * robots, seed, profile, "field", seconds)
    world = World(arena_for(job), scenario(job.robots, job.targets, seed), FIELD, seed, seconds)
    times: Times = {name: [] for name in FIGURES}
    neighbours: list[int] = []
    if COMPILED:
        world.hops = Clocked(world, times["step"], neighbours)
        quiet()
        world.run()
        return times, neighbours
    act: Callable[..., Any] = Controller.act

    def counted(controller: Controller, view: Any) -> Any:
        neighbours.append(len(view.sighted))
        return act(controller, view)

    Controller.act = counted  # type: ignore[assignment, method-assign]
    try:
        with (
            timed(Controller, "act", times["act"]),
            timed(Controller, "think", times["think"]),
            timed(Controller, "announce", times["announce"]),
            timed(guards, "limit", times["limit"]),
            timed(guards, "limit_cut", times["cut"]),
            timed(agents.Agent, "step", times["step"]),
        ):
            quiet()
            world.run()
    finally:
        Controller.act = act  # type: ignore[method-assign]
    times["law"] = [sum(parts) for parts in zip(times["act"], times["think"], times["limit"], strict=True)]
    return times, neighbours


def row(profile: str, of: str, count: int, times: Times) -> dict[str, Any]:
    """One line: ``of`` is 'robots' or 'neighbours'."""
    figures: dict[str, Any] = {"profile": profile, "of": of, "count": count, "steps": len(times["step"])}
    for name in FIGURES:
        if times[name]:
            cuts = statistics.quantiles(times[name], n=100, method="inclusive")
            figures[f"{name}_p50_us"] = round(cuts[49] / 1e3, 1)
            figures[f"{name}_p99_us"] = round(cuts[98] / 1e3, 1)
    return figures


def rows(
    profile: Literal["field", "paper"], counts: list[int], seconds: float, repeat: int
) -> Iterator[dict[str, Any]]:
    """By robots, then by neighbours over all of those missions."""
    near: dict[int, Times] = {}
    for count in counts:
        total: Times = {name: [] for name in FIGURES}
        for seed in range(1, repeat + 1):
            times, neighbours = measure(count, profile, seed, seconds)
            steps = {name: times[name][-len(neighbours) :] for name in FIGURES if name != "announce"}
            for name in FIGURES:
                total[name] += times[name]
            for k, seen in enumerate(neighbours):
                kept = near.setdefault(seen, {name: [] for name in FIGURES})
                for name, values in steps.items():
                    kept[name].append(values[k])
        yield row(profile, "robots", count, total)
    for seen in sorted(near):
        if len(near[seen]["step"]) >= FEWEST_STEPS:
            yield row(profile, "neighbours", seen, near[seen])


def cell(line: dict[str, Any], name: str) -> str:
    return f"{line[f'{name}_p50_us']:.0f} / {line[f'{name}_p99_us']:.0f}" if f"{name}_p50_us" in line else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=list(ROBOTS), metavar="N", help="numbers of robots")
    parser.add_argument("--profile", choices=("field", "paper"), action="append", help="default: both")
    parser.add_argument("--seconds", type=float, default=6.0, help="virtual time of a mission (default 6)")
    parser.add_argument("--repeat", type=int, default=1, help="missions a number of robots (default 1)")
    parser.add_argument("--compiled", action="store_true", help="machine code of the law, which has to be there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, too")
    options = parser.parse_args()
    if options.compiled and not COMPILED:
        folder = compiled.current()
        if folder is None:
            print("no machine code of these sources: ahdc-groundstation compile makes it", file=sys.stderr)
            return 2
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, "PYTHONPATH": str(folder)})
    found = []
    print(f"{'p50 / p99, us':>22}" + "".join(f"{name:>14}" for name in FIGURES))
    for profile in options.profile or ("field", "paper"):
        for line in rows(profile, options.robots, options.seconds, options.repeat):
            found.append(line)
            head = f"{profile} {line['count']:>3} {line['of']:<10}   "
            print(head + "".join(f"{cell(line, name):>14}" for name in FIGURES), flush=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
