"""Comparing runs: grouped, with intervals, none left out."""

import csv
import io
import math
import statistics

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.compare import csv_of, groups, table
from groundstation.history import History
from groundstation.means import mean_of
from groundstation.metrics import Metrics, compute
from tests.groundstation.runs import arena_of, mission


def made(**changes: object) -> Metrics:
    arena = arena_of()
    history = History(arena)
    for _, message, _ in mission(arena, frames=45):
        history.receive(message)
    found = compute(history)
    assert found is not None
    return msgspec.structs.replace(found, **changes)


GOOD = made()


def test_student_by_hand() -> None:
    mean = mean_of([1.0, 2.0, 3.0])
    assert mean.value == 2.0
    assert mean.half == pytest.approx(4.303 / math.sqrt(3))
    assert str(mean_of([])) == "-"
    assert str(mean_of([2.5])) == "2.5"


@given(values=st.lists(st.floats(-100, 100), min_size=2, max_size=80))
def test_the_interval_holds_the_mean_and_narrows(values: list[float]) -> None:
    mean = mean_of(values)
    assert mean.value == pytest.approx(statistics.fmean(values))
    assert mean.half >= 1.96 * statistics.stdev(values) / math.sqrt(len(values))
    assert mean_of(values * 4).half <= mean.half + 1e-9


def test_groups_by_profile_and_size_and_keeps_failures() -> None:
    failed = msgspec.structs.replace(GOOD, completed=False, ratio_to_lower_bound=None, mission_s=99.0)
    split = msgspec.structs.replace(GOOD, disconnected_frames=3)
    paper = msgspec.structs.replace(GOOD, profile="paper")
    found = groups([GOOD, failed, split, paper])
    assert [(g.profile, g.runs, g.completed, g.failed) for g in found] == [("field", 3, 2, 2), ("paper", 1, 1, 0)]
    assert found[0].means["mission_s"].of == 2
    assert found[0].means["mission_s"].value == GOOD.mission_s
    assert found[0].means["min_lambda2"].of == 3
    assert len(table(found)) == 3
    rows = list(csv.DictReader(io.StringIO(csv_of([("a", GOOD), ("b", failed)]).decode())))
    assert [row["run"] for row in rows] == ["a", "b"]
    assert rows[1]["failures"]
