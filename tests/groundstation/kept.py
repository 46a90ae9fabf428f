"""The recording that CI replays; ``python -m tests.groundstation.kept`` makes it anew after a meant change of the law.

A lockstep mission of two robots in field conditions: virtual time, so it depends on the software alone.
"""

import shutil
import tempfile
from pathlib import Path

from groundstation.sweep import Job, keep

KEPT = Path(__file__).parents[1] / "data" / "kept.mcap"
JOB = Job(2, 2, 5, "field", "field", 60.0)
MOST_BYTES = 300_000


def make(target: Path) -> None:
    """Play the mission and keep its recording."""
    with tempfile.TemporaryDirectory() as folder:
        found = keep(JOB._replace(save=folder))
        assert found.completed, found.why
        target.parent.mkdir(exist_ok=True)
        shutil.copyfile(Path(folder) / "run.mcap", target)


if __name__ == "__main__":
    make(KEPT)
