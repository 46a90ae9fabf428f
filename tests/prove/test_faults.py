"""Every row of the fault matrix, fifty faults a row, at random moments of lockstep missions over real bytes."""

import os
import random

import pytest

from groundstation.faultrows import ROWS, Row
from groundstation.faults import play

REPETITIONS = int(os.environ.get("AHDC_FAULT_REPETITIONS", "50"))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_row(row: Row) -> None:
    first = random.SystemRandom().randrange(1 << 30)
    bad = [outcome for seed in range(first, first + REPETITIONS) if (outcome := play(row, seed)).faults]
    assert not bad, "\n".join(f"seed {outcome.seed}: {'; '.join(outcome.faults)}" for outcome in bad)
