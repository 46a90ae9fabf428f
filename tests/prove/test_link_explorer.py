"""At least 10^5 random lives of the link protocol: no split, nothing left open; a failing seed is told."""

import multiprocessing
import os
import random

import pytest

from tests.onboard.link_world import LinkWorld, RoamingWorld, Split, complete, grid, play, random_graph, ring, roam

RUNS = int(os.environ.get("AHDC_LINK_RUNS", "100000"))
CHUNK = 500


def live(seed: int) -> str:
    """One life, everything about it drawn from the seed; what went wrong, empty for nothing."""
    rng = random.Random(seed)
    robots = rng.randrange(3, 13)
    kind = rng.choice(["ring", "complete", "grid", "random", "roaming", "roaming", "faults"])
    try:
        if kind in ("roaming", "faults"):
            roaming = RoamingWorld(robots, rng)
            roam(roaming, rng, 150, loss=rng.uniform(0.0, 0.5), faults=0.01 if kind == "faults" else 0.0)
            for _ in range(8):
                roaming.meet()
                roaming.settle(6)
            return "; ".join(roaming.open_ends())
        edges = {"ring": ring(robots), "complete": complete(min(robots, 7)), "grid": grid(3, max(1, robots // 3))}
        size = {"complete": min(robots, 7), "grid": 3 * max(1, robots // 3)}.get(kind, robots)
        world = LinkWorld(size, edges.get(kind) or random_graph(robots, rng))
        play(world, rng, 150, loss=rng.uniform(0.0, 0.5), duplication=rng.uniform(0.0, 0.3))
        world.settle()
        return "; ".join(world.open_ends())
    except Split as split:
        return str(split)


def live_chunk(first: int) -> list[tuple[int, str]]:
    return [(seed, wrong) for seed in range(first, first + CHUNK) if (wrong := live(seed))]


@pytest.mark.timeout(4 * 3600)
def test_random_lives() -> None:
    base = random.SystemRandom().randrange(2**40)
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        for done, wrong in enumerate(pool.imap_unordered(live_chunk, range(base, base + RUNS, CHUNK)), 1):
            assert not wrong, (
                f"seed {wrong[0][0]}: {wrong[0][1]} (tests.prove.test_link_explorer.live(seed) repeats it)"
            )
            if done % 20 == 0:
                print(f"{done * CHUNK} of {RUNS} lives whole, seeds from {base}", flush=True)
