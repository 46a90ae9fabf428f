"""Crowds in which robots come late, reboot and vanish from sight: nobody split, nobody hit, everybody comes to move."""

import multiprocessing
import os
import random

import pytest

from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from tests.groundstation.eventful import Befalls, Event, EventfulWorld

RUNS = int(os.environ.get("AHDC_CROWDS", "100"))
LIMIT_S = 9.0
LATEST_S: dict[Befalls, float] = {"late": 0.6, "reboot": 5.0, "occlude": 5.0}
"""By 0.6 s the others have not gone yet: whom nobody knows of cannot be waited for."""


def live(seed: int) -> str:
    """A crowd's first seconds, everything about it drawn from the seed; what went wrong, empty for nothing."""
    rng = random.Random(seed)
    robots = rng.randrange(5, 21)
    struck = rng.sample([f"r{k + 1:02d}" for k in range(robots)], rng.randrange(1, 4))
    script = []
    for name in struck:
        what = rng.choice(list(LATEST_S))
        script.append(Event(rng.uniform(0.1, LATEST_S[what]), what, name, rng.uniform(0.1, 3.0)))
    job = Job(robots, 3 * robots, seed, "field", "field", LIMIT_S)
    place = scenario(robots, 3 * robots, seed)
    world = EventfulWorld(arena_for(job), place, job.faced, seed, LIMIT_S, script=tuple(script))
    result = world.run()
    fields = {name: agent.controller.field for name, agent in world.agents.items()}
    waiting = [name for name, field in fields.items() if field is None or not field.joined]
    wrong = [f"apart at {result.disconnected_steps} looks"] if result.disconnected_steps else []
    wrong += [f"{result.collisions} collisions"] if result.collisions else []
    wrong += [f"{', '.join(waiting)} never came to move"] if waiting else []
    return f"{'; '.join(wrong)}: {robots} robots, {script}" if wrong else ""


@pytest.mark.timeout(4 * 3600)
def test_random_crowds() -> None:
    base = random.SystemRandom().randrange(2**40)
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        for done, wrong in enumerate(pool.imap(live, range(base, base + RUNS)), 1):
            assert not wrong, f"seed {base + done - 1}: {wrong} (tests.prove.test_membership.live(seed) repeats it)"
            if done % 10 == 0 or done == RUNS:
                print(f"{done} of {RUNS} crowds, seeds from {base}", flush=True)
