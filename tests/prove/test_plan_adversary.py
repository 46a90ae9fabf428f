"""10^4 searches of an adversary against the stop-point plan: no link beyond r_c, no robot touched."""

import multiprocessing
import os
import random

import pytest

from tests.onboard.plan_adversary import PARAMETERS, Found, search

SEARCHES = int(os.environ.get("AHDC_SEARCHES", "10000"))
CLIMBS, MANY_CLIMBS = 4, 49
"""Of a search, and of one in fifty: many places to start from, and some ways to the top."""
CASES = [(robots, age_s, close) for robots in (2, 3) for age_s in (0.08, 0.15) for close in (False, True)]


Job = tuple[int, int, int, float, bool]


def search_one(job: Job) -> Found:
    return search(*job)


@pytest.mark.timeout(4 * 3600)
def test_adversary() -> None:
    base = random.SystemRandom().randrange(2**40)
    rounds = max(1, SEARCHES // len(CASES))
    jobs: list[Job] = [(base + k, CLIMBS if k % 50 else MANY_CLIMBS, *case) for k in range(rounds) for case in CASES]
    longest, nearest, flights = 0.0, 9.9, 0
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        for done, (job, found) in enumerate(zip(jobs, pool.imap(search_one, jobs, chunksize=4), strict=True), 1):
            flights += job[1] + 1
            if job[4]:
                nearest = min(nearest, found.nearest_m)
                assert found.nearest_m >= PARAMETERS.diameter_m, f"search{job}: {found}"
            else:
                longest = max(longest, found.longest_m)
                assert found.longest_m <= PARAMETERS.sensing_radius_m, f"search{job}: {found}"
            if done % 500 == 0 or done == len(jobs):
                least = f"longest link {longest:.4f} m, least distance {nearest:.4f} m"
                print(f"{done} searches, {flights} flights, seeds from {base}: {least}", flush=True)
