"""Trials in lockstep virtual time: each from its starts, so that nobody has to drive home."""

from pathlib import Path

import msgspec

from groundstation.experiment import outcome
from groundstation.outcomes import Ending, Outcome
from groundstation.sweep import Job, keep
from groundstation.trials import Experiment, Trial


class LockstepStage:
    """:class:`groundstation.experiment.Stage` in virtual time."""

    def __init__(self, experiment: Experiment) -> None:
        self._experiment = experiment

    def play(self, trial: Trial, folder: Path) -> Outcome:
        experiment = self._experiment
        profile = trial.profile
        save = str(folder) if experiment.record else ""
        job = Job(
            trial.robots, trial.targets, trial.seed, profile, experiment.conditions, experiment.timeout_s, save=save
        )
        found = keep(job)
        endings: dict[str, Ending] = {"completed": "completed", "error": "error", "no scenario": "error"}
        return msgspec.structs.replace(
            outcome(trial, endings.get(found.ending, "timeout"), found.why),
            occupied=found.occupied,
            mission_s=found.mission_s,
            ratio_to_lower_bound=found.ratio_to_lower_bound,
            min_distance_m=found.min_distance_m,
            collisions=found.collisions,
            splits=found.disconnected_steps,
        )

    def close(self) -> None:
        return
