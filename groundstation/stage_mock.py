"""Trials in the mock arena: processes of their own for each, so every one begins at its starts, in real time."""

import argparse
import os
from pathlib import Path

import tomlkit

from contract.arena import load, table_of, unused_sections
from drivers.registry import wheel_faults
from groundstation import demo, rig
from groundstation.experiment import judged, outcome
from groundstation.outcomes import Outcome
from groundstation.recording import RecordingError
from groundstation.trials import Experiment, Trial

ARENA = "arena.toml"


class MockStage:
    """:class:`groundstation.experiment.Stage` that runs ``demo``.

    :raises ArenaError: the arena file has faults.
    """

    def __init__(self, experiment: Experiment, source: Path) -> None:
        self._experiment = experiment
        self._table = table_of(load(beside(experiment.arena, source), wheel_faults))

    def play(self, trial: Trial, folder: Path) -> Outcome:
        table = {**self._table, "control": dict(self._table["control"])}
        if trial.profile and trial.profile != table["control"]["profile"]:
            unused = unused_sections(trial.profile)
            table["control"] = {key: value for key, value in table["control"].items() if key not in unused}
            table["control"]["profile"] = trial.profile
        plain = {key: value for key, value in table.items() if not isinstance(value, dict)}
        (folder / ARENA).write_text(tomlkit.dumps(plain | table), encoding="utf-8")
        args = argparse.Namespace(
            headless=True,
            arena=str(folder / ARENA),
            seed=trial.seed,
            robots=trial.robots or None,
            targets=trial.targets,
            out=folder,
            timeout=self._experiment.timeout_s,
        )
        code = demo.run(args)
        if code == 130:
            raise KeyboardInterrupt
        if code == 2:
            return outcome(trial, "error", "the scenario cannot be run; see above")
        try:
            return judged(trial, folder)
        except RecordingError as error:
            return outcome(trial, "error", str(error))

    def close(self) -> None:
        return


def beside(arena: str, source: Path) -> Path:
    """An arena file as an experiment file names it: beside it, or an example."""
    path = source.parent / arena
    return path if os.sep in arena or path.exists() else rig.find_arena(arena)
