"""Several runs beside each other: by profile and size, means with 95 % t-intervals, every run kept. Pure."""

import csv
import io
import math
import statistics
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from groundstation.metrics import Metrics, failures

T_95 = (
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
)  # fmt: skip
"""Two-sided 95 % quantiles of Student's t for 1 to 30 degrees of freedom."""
Z_95 = 1.960
MEASURES = ("mission_s", "ratio_to_lower_bound", "min_lambda2", "min_distance_m", "links_removed")


class Mean(NamedTuple):
    """Mean and half-width of its 95 % interval; NaN half-width for a single value, NaN mean for none."""

    value: float
    half: float
    of: int

    def __str__(self) -> str:
        if not self.of:
            return "-"
        return f"{self.value:.3g}" if math.isnan(self.half) else f"{self.value:.3g} ± {self.half:.2g}"


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


def mean_of(values: Sequence[float]) -> Mean:
    """Mean with its 95 % t-interval (above 30 degrees of freedom 1.96 (1 + 1.25/df), within 0.1 % of t)."""
    n = len(values)
    if n < 2:
        return Mean(values[0] if n else math.nan, math.nan, n)
    t = T_95[n - 2] if n - 2 < len(T_95) else Z_95 * (1 + 1.25 / (n - 1))
    return Mean(statistics.fmean(values), t * statistics.stdev(values) / math.sqrt(n), n)


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
