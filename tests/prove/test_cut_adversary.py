"""10^4 flights of two and three robots, one of them cut off: nobody is touched."""

import os
import random

import pytest

from tests.onboard.cut_adversary import DIAMETER_M, search

FLIGHTS = int(os.environ.get("AHDC_FLIGHTS", "10000"))


@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize("oldest_s", [0.0, 0.08])
def test_adversary(oldest_s: float) -> None:
    base = random.SystemRandom().randrange(2**40)
    found = search(base, FLIGHTS // 2, oldest_s)
    touched = [(least, seed) for least, seed in found if least < DIAMETER_M]
    print(f"{len(found)} flights, ages to {oldest_s} s, seeds from {base}: nearest {found[0][0]:.4f} m", flush=True)
    assert not touched, touched[:8]
