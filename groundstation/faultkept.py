"""What faults did, kept in a file line by line: a run that was interrupted goes on where it was."""

import contextlib
from pathlib import Path

import msgspec

from groundstation.faultrows import Outcome


class Kept:
    """Outcomes by row and seed; those of an earlier run are there. Without a folder nothing is written."""

    def __init__(self, folder: Path | None, name: str) -> None:
        self._file = None if folder is None else folder / f"{name}.jsonl"
        self.outcomes = {} if self._file is None else read(self._file)

    def add(self, outcome: Outcome) -> None:
        """Keep it, and say it."""
        verdict = "good" if not outcome.faults else f"BAD seed {outcome.seed}: {'; '.join(outcome.faults)}"
        print(f"{outcome.row:<50} zero {outcome.zero_s} s, rolled {outcome.rolled_m} m, {verdict}", flush=True)
        self.outcomes[outcome.row, outcome.seed] = outcome
        if self._file is not None:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with self._file.open("ab") as file:
                file.write(msgspec.json.encode(outcome) + b"\n")


def read(progress: Path) -> dict[tuple[str, int], Outcome]:
    """What an earlier run has done, by row and seed; a line cut short by its end is left out."""
    found = {}
    for line in progress.read_bytes().splitlines() if progress.exists() else []:
        with contextlib.suppress(msgspec.DecodeError):
            outcome = msgspec.json.decode(line, type=Outcome)
            found[outcome.row, outcome.seed] = outcome
    return found
