"""10^4 flights of an adversary against the stop-point plan: no link beyond r_c, no robot touched."""

import multiprocessing
import os
import random

import pytest

from tests.onboard.plan_adversary import PARAMETERS, Found, search

FLIGHTS = int(os.environ.get("AHDC_FLIGHTS", "10000"))
CLIMBS = 49
CASES = [(robots, age_s, close) for robots in (2, 3) for age_s in (0.08, 0.15) for close in (False, True)]


def fly_one(job: tuple[int, int, float, bool]) -> Found:
    seed, robots, age_s, close = job
    return search(seed, CLIMBS, robots, age_s, close)


@pytest.mark.timeout(4 * 3600)
def test_adversary() -> None:
    base = random.SystemRandom().randrange(2**40)
    rounds = max(1, FLIGHTS // (CLIMBS + 1) // len(CASES))
    jobs = [(base + k, *case) for k in range(rounds) for case in CASES]
    longest, nearest = 0.0, 9.9
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        for job, found in zip(jobs, pool.imap(fly_one, jobs), strict=True):
            if job[3]:
                nearest = min(nearest, found.nearest_m)
                assert found.nearest_m >= PARAMETERS.diameter_m, f"search{job}: {found}"
            else:
                longest = max(longest, found.longest_m)
                assert found.longest_m <= PARAMETERS.sensing_radius_m, f"search{job}: {found}"
    print(f"{len(jobs) * (CLIMBS + 1)} flights: longest link {longest:.4f} m, least distance {nearest:.4f} m")
