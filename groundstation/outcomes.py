"""What became of an experiment's trials, and what they say together, with intervals. Pure."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Literal

import msgspec

from groundstation import estimates
from groundstation.estimates import Estimate

Ending = Literal["completed", "timeout", "failed", "stopped", "aborted", "error"]


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """One trial. ``aborted``: the experiment was interrupted in it; it is run again and this one stays."""

    trial: str
    robots: int
    targets: int
    profile: str
    seed: int
    repetition: int
    ending: Ending
    why: str = ""
    occupied: int = 0
    mission_s: float | None = None
    ratio_to_lower_bound: float | None = None
    min_distance_m: float | None = None
    collisions: int = 0
    splits: int = 0
    """Frames (lockstep: checks) in which the network was in pieces."""
    folder: str = ""

    @property
    def good(self) -> bool:
        """Completed, never split, no collision."""
        return self.ending == "completed" and not self.splits and not self.collisions


class Group(msgspec.Struct, frozen=True, kw_only=True):
    """All outcomes of one profile and size. Times are of completed missions, shares of all that were not aborted."""

    profile: str
    robots: int
    targets: int
    trials: int
    aborted: int
    completed: Estimate
    without_split: Estimate
    without_collision: Estimate
    mission_s: Estimate
    ratio_to_lower_bound: Estimate
    """Median."""
    least_distance_m: float | None


def groups(outcomes: Iterable[Outcome]) -> list[Group]:
    """By profile, robots and targets, in that order."""
    found: dict[tuple[str, int, int], list[Outcome]] = {}
    for outcome in outcomes:
        found.setdefault((outcome.profile, outcome.robots, outcome.targets), []).append(outcome)
    return [_group(key, members) for key, members in sorted(found.items())]


def _group(key: tuple[str, int, int], members: Sequence[Outcome]) -> Group:
    judged = [entry for entry in members if entry.ending != "aborted"]
    done = [entry for entry in judged if entry.ending == "completed"]
    n = len(judged)
    return Group(
        profile=key[0],
        robots=key[1],
        targets=key[2],
        trials=n,
        aborted=len(members) - n,
        completed=estimates.share(len(done), n),
        without_split=estimates.share(sum(not entry.splits for entry in judged), n),
        without_collision=estimates.share(sum(not entry.collisions for entry in judged), n),
        mission_s=estimates.mean([entry.mission_s for entry in done if entry.mission_s is not None]),
        ratio_to_lower_bound=estimates.median(
            [entry.ratio_to_lower_bound for entry in done if entry.ratio_to_lower_bound is not None]
        ),
        least_distance_m=min((e.min_distance_m for e in judged if e.min_distance_m is not None), default=None),
    )


HEAD = (
    "profile",
    "robots",
    "targets",
    "trials",
    "aborted",
    "completed",
    "no split",
    "no collision",
    "mission, s",
    "ratio",
)


def table(found: Sequence[Group]) -> list[tuple[str, ...]]:
    """The groups as rows of text, head first; every estimate with its 95 % interval."""

    def row(g: Group) -> tuple[str, ...]:
        shares = map(_percent, (g.completed, g.without_split, g.without_collision))
        values = map(_number, (g.mission_s, g.ratio_to_lower_bound))
        return (g.profile, *map(str, (g.robots, g.targets, g.trials, g.aborted)), *shares, *values)

    return [HEAD, *map(row, found)]


def _percent(estimate: Estimate) -> str:
    if estimate.value is None:
        return "-"
    interval = "" if estimate.low is None or estimate.high is None else f" [{estimate.low:.0%}, {estimate.high:.0%}]"
    return f"{estimate.value:.0%}{interval}"


def _number(estimate: Estimate) -> str:
    if estimate.value is None:
        return "-"
    interval = "" if estimate.low is None or estimate.high is None else f" [{estimate.low:.2f}, {estimate.high:.2f}]"
    return f"{estimate.value:.2f}{interval}"


def csv_of(outcomes: Iterable[Outcome]) -> bytes:
    """Every outcome, one a line: the points behind the estimates."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Outcome.__struct_fields__)
    for outcome in outcomes:
        writer.writerow([getattr(outcome, name) for name in Outcome.__struct_fields__])
    return text.getvalue().encode()


def encode(outcome: Outcome) -> bytes:
    """``trial.json``."""
    return msgspec.json.format(msgspec.json.encode(outcome)) + b"\n"
