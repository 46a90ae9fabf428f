"""Every row of the fault matrix: fifty faults a row in lockstep over real bytes, five in the mock arena's processes.

``AHDC_FAULT_REPETITIONS`` and ``AHDC_REAL_REPETITIONS`` set other numbers; ``AHDC_FAULT_PROGRESS`` names a folder to go
on from where an earlier run with the same code was interrupted.
"""

import os
import random
from pathlib import Path

import pytest

from groundstation.faultkept import Kept
from groundstation.faultreal import REAL_ROWS, play_all
from groundstation.faultrows import ROWS, Outcome, Row
from groundstation.faults import play

REPETITIONS = int(os.environ.get("AHDC_FAULT_REPETITIONS", "50"))
REAL_REPETITIONS = int(os.environ.get("AHDC_REAL_REPETITIONS", "5"))
PROGRESS = os.environ.get("AHDC_FAULT_PROGRESS", "")
FOLDER = Path(PROGRESS) if PROGRESS else None


def words(outcomes: list[Outcome]) -> str:
    return "\n".join(f"{entry.row}, seed {entry.seed}: {'; '.join(entry.faults)}" for entry in outcomes if entry.faults)


@pytest.fixture(scope="module")
def kept() -> Kept:
    return Kept(FOLDER, "lockstep")


@pytest.mark.timeout(0)
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_row(row: Row, kept: Kept) -> None:
    draw = random.SystemRandom()
    while len(done := [entry for entry in kept.outcomes.values() if entry.row == row.name]) < REPETITIONS:
        kept.add(play(row, draw.randrange(1 << 30)))
    assert not words(done)


@pytest.mark.timeout(0)
def test_real_processes() -> None:
    real = Kept(FOLDER, "real")
    play_all([(row, number) for number in range(REAL_REPETITIONS) for row in REAL_ROWS], real)
    assert not words(list(real.outcomes.values()))
