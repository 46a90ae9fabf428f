"""Several runs beside each other: by profile and size, means with 95 % t-intervals, every run kept. Pure."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from groundstation.means import Mean, mean_of
from groundstation.metrics import Metrics, failures

MEASURES = ("mission_s", "ratio_to_lower_bound", "min_lambda2", "min_distance_m", "links_removed")


class Group(NamedTuple):
    """Runs of one profile and size. Means of time and ratio are over completed runs, the others over all."""

    profile: str
    robots: int
    targets: int
    runs: int
    completed: int
    failed: int
    """Not completed, split, or collided."""
    means: dict[str, Mean]


def groups(runs: Iterable[Metrics]) -> list[Group]:
    """Runs grouped by profile, robots and targets, in that order."""
    sorted_runs: dict[tuple[str, int, int], list[Metrics]] = {}
    for run in runs:
        sorted_runs.setdefault((run.profile, len(run.robots), run.targets), []).append(run)
    return [_group(key, members) for key, members in sorted(sorted_runs.items())]


def _group(key: tuple[str, int, int], runs: list[Metrics]) -> Group:
    done = [run for run in runs if run.completed]

    def values(name: str) -> list[float]:
        among = done if name in ("mission_s", "ratio_to_lower_bound") else runs
        found = [getattr(run, name) for run in among]
        return [float(value) for value in found if value is not None]

    means = {name: mean_of(values(name)) for name in MEASURES}
    return Group(*key, len(runs), len(done), sum(bool(failures(run)) for run in runs), means)


def table(found: Sequence[Group]) -> list[tuple[str, ...]]:
    """The groups as rows of text, head first."""
    head = ("profile", "robots", "targets", "runs", "completed", "failed", *MEASURES)
    rows = [
        (*map(str, (g.profile, g.robots, g.targets, g.runs, g.completed, g.failed)), *map(str, g.means.values()))
        for g in found
    ]
    return [head, *rows]


def csv_of(runs: Iterable[tuple[str, Metrics]]) -> bytes:
    """Every run with its name, one a line: the raw points behind the means."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("run", "profile", "robots", "targets", "seed", "completed", "ending", *MEASURES, "failures"))
    for name, run in runs:
        measures = [getattr(run, measure) for measure in MEASURES]
        fixed = (name, run.profile, len(run.robots), run.targets, run.seed, run.completed, run.ending)
        writer.writerow((*fixed, *measures, "; ".join(failures(run))))
    return text.getvalue().encode()
