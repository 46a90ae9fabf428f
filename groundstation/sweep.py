"""Many lockstep missions: what one run is, and runs one after the other, on many processes, or on a cluster.

Every run is made from nothing but its :class:`Job`, so it is the same wherever it is played.
"""

import gc
import multiprocessing
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

from contract.arena import Arena, Control, FieldControl, Floor, Mocap, Platform, Robot, Safety, Targets
from groundstation.conditions import PRESETS, Conditions, Interval
from groundstation.lockstep import World
from groundstation.result import Result
from groundstation.targets import CloudError, scenario

WHEELS: tuple[dict[str, Any], ...] = (
    {"kind": "odrive", "interface": "slcan", "channel": "/dev/null", "left": 0, "right": 1, "watchdog_s": 0.2},
    {"kind": "roboclaw", "port": "/dev/null", "counts_per_revolution": 2048},
)
"""Of the robots in turn; no port is ever opened."""
MAX_DECELERATION_MPS2 = 100.0
MIN_LAG_S = 0.001
SHORTEST_COMMAND_AGE_S = 0.02
SHORTEST_WATCHDOG_S = 0.021
"""Robots that stop at once, as the paper's do, stop at once when cut off, too."""
SURE_AGE_S = 0.05
"""The supervisor tolerates poses older than the conditions make them by this."""
POLL_S = 0.5


class Calibrated(NamedTuple):
    """The brake interval the robots were told, where it is not that of their motors."""

    deceleration_mps2: Interval
    lag_s: Interval


class Job(NamedTuple):
    """One run of a sweep."""

    robots: int
    targets: int
    seed: int
    profile: str
    conditions: str
    """A preset's name."""
    limit_s: float
    wired: bool = False
    world: Conditions | None = None
    """In place of the preset."""
    told: Calibrated | None = None
    """None: the motors' own interval."""
    save: str = ""
    """Folder of this run's recording, empty for none."""

    @property
    def faced(self) -> Conditions:
        return self.world or PRESETS[self.conditions]


def arena_for(job: Job) -> Arena:
    """The arena of a sweep's run: the paper's parameters, the scenario's floor, ``robots`` robots."""
    place, world = scenario(job.robots, job.targets, job.seed), job.faced
    (weak, strong), (quick, slow) = job.told or (world.deceleration_mps2, world.lag_s)
    field = FieldControl(
        brake_deceleration_mps2=(min(weak, MAX_DECELERATION_MPS2), min(strong, MAX_DECELERATION_MPS2)),
        motor_lag_s=(max(quick, MIN_LAG_S), max(slow, MIN_LAG_S)),
    )
    usual, at_once = Safety(), weak >= MAX_DECELERATION_MPS2
    safety = Safety(
        max_slew_mps2=1000.0 if at_once else usual.max_slew_mps2,
        watchdog_s=SHORTEST_WATCHDOG_S if at_once and not job.wired else usual.watchdog_s,
        command_age_s=SHORTEST_COMMAND_AGE_S if at_once and not job.wired else usual.command_age_s,
        max_pose_age_s=max(usual.max_pose_age_s, world.pose_age_s[1] + SURE_AGE_S),
    )
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
        platform=Platform(coast_deceleration_mps2=50.0) if at_once else Platform(),
        safety=safety,
        targets=Targets(count=job.targets, seed=job.seed),
    )


def play(job: Job, conditions: Conditions | None = None) -> Result:
    """One run, from nothing but the job.

    :raises CloudError: the job's scenario cannot be.
    """
    *_, found = stages(job if conditions is None else job._replace(world=conditions))
    assert found is not None
    return found


def stages(job: Job) -> Iterator[Result | None]:
    """One run, with None after every second of it, and at last its result."""
    arena = arena_for(job)
    place = scenario(job.robots, job.targets, job.seed)
    if not job.save:
        yield from _stages(World(arena, place, job.faced, job.seed, job.limit_s, wired=job.wired))
        return
    from groundstation.saving import SavedRun

    with SavedRun(arena, Path(job.save), f"simulate-{job.robots}-{job.targets}-{job.seed}") as saved:
        world = World(arena, place, job.faced, job.seed, job.limit_s, wired=job.wired, tap=saved.hear)
        found = None
        for found in _stages(world):
            if found is None:
                yield None
    yield found


def _stages(world: World) -> Iterator[Result | None]:
    done, at_s = False, 0
    while not done and at_s < world.limit_s:
        at_s += 1
        done = world.until(min(at_s, world.limit_s))
        yield None
    yield world.result(done)


def kept(job: Job) -> Iterator[Result | None]:
    """:func:`stages`, but whatever goes wrong becomes a result that says so."""
    try:
        yield from stages(job)
    except CloudError as error:
        yield _failed(job, "no scenario", str(error))
    except Exception as error:
        yield _failed(job, "error", f"{type(error).__name__}: {error}")


def keep(job: Job) -> Result:
    """The result of a run, whatever goes wrong."""
    *_, found = kept(job)
    assert found is not None
    return found


def _failed(job: Job, ending: Literal["no scenario", "error"], why: str) -> Result:
    return Result(
        seed=job.seed,
        robots=job.robots,
        targets=job.targets,
        completed=False,
        occupied=0,
        mission_s=0.0,
        disconnected_steps=0,
        collisions=0,
        min_distance_m=0.0,
        lower_bound_s=0.0,
        ratio_to_lower_bound=None,
        run_steps=0,
        ending=ending,
        why=why,
    )


def local(jobs: list[Job], workers: int) -> Iterator[Result | None]:
    """Results in the order of the jobs; None now and then in between, so that progress can be shown."""
    if workers <= 1:
        with undisturbed():
            for job in jobs:
                yield from kept(job)
                gc.collect()
        return
    with multiprocessing.get_context("spawn").Pool(min(workers, len(jobs)), _leave_interrupts) as pool:
        results = pool.imap(_keep_undisturbed, jobs, chunksize=1)
        yield from polled(len(jobs), lambda _: results.next(timeout=POLL_S), multiprocessing.TimeoutError)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Keep the garbage collector out of missions: until these are over they leave it nothing, and then all at once."""
    working = gc.isenabled()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        if working:
            gc.enable()
        gc.unfreeze()


def _keep_undisturbed(job: Job) -> Result:
    with undisturbed():
        found = keep(job)
        gc.collect()
    return found


def polled(count: int, fetch: Callable[[int], Result], late: type[Exception]) -> Iterator[Result | None]:
    """``fetch(0)`` to ``fetch(count - 1)``, with None each time it is ``late``."""
    for k in range(count):
        result = None
        while result is None:
            try:
                result = fetch(k)
            except late:
                yield None
        yield result


def _leave_interrupts() -> None:
    """Ctrl-C is for the process that gathers the results."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
