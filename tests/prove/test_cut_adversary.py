"""10^4 flights of two and three robots, one of them cut off: nobody is touched."""

import os
import random

import pytest

from tests.onboard.cut_adversary import DIAMETER_M, FaultKind, search

FLIGHTS = int(os.environ.get("AHDC_FLIGHTS", "10000"))
CASES: list[tuple[FaultKind, float]] = [
    ("hung", 0.0),
    ("hung", 0.08),
    ("hung", 0.15),
    ("unheard", 0.0),
    ("unheard", 0.08),
    ("unheard", 0.15),
    ("deaf", 0.03),
    ("deaf", 0.08),
    ("deaf", 0.15),
]
"""Kind of fault, and age of the oldest poses and messages, s."""


@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize(("fault", "oldest_s"), CASES)
def test_adversary(fault: FaultKind, oldest_s: float) -> None:
    base = random.SystemRandom().randrange(2**40)
    found = search(base, FLIGHTS // len(CASES), oldest_s, fault=fault)
    touched = [(least, seed) for least, seed in found if least < DIAMETER_M]
    print(
        f"{fault}, ages to {oldest_s} s: {len(found)} flights, seeds from {base}: nearest {found[0][0]:.4f} m",
        flush=True,
    )
    assert not touched, touched[:8]
