"""A slice of the fault matrix: bytes the emulated motors decoded, and how far the bodies rolled."""

from typing import Any

import msgspec
import pytest

from contract.messages import MotorSample
from groundstation.faultrows import ROWS, Row, allowed_m
from groundstation.faults import Outcome, judge, markdown, percentiles, play, zero_after_s
from groundstation.sweep import Job, arena_for

BY_NAME = {row.name: row for row in ROWS}
SLICE = (
    "wheels: commands lost (roboclaw)",
    "motion capture: occlusion",
    "motion capture: duplicate",
    "station: STOP",
    "process: hung",
)
GOOD = Outcome(
    row="", seed=1, victim="r01", at_s=1.0, speed_mps=0.5, zero_s=0.1, rest_s=0.5, rolled_m=0.1,
    failsafe=("pose_invalid",), collisions=0, split=False,
)  # fmt: skip


def test_the_matrix_has_forty_rows_and_more_each_of_its_own_name() -> None:
    assert len(BY_NAME) == len(ROWS) >= 40
    assert {row.where for row in ROWS} >= {"wheels", "motion capture", "messages", "station", "radio", "process"}


@pytest.mark.parametrize("name", SLICE)
def test_a_row(name: str) -> None:
    outcome = play(BY_NAME[name], 1)
    assert outcome.faults == ()


def test_a_fault_at_the_same_moment_is_the_same_fault() -> None:
    row = BY_NAME["station: STOP"]
    assert play(row, 2) == play(row, 2)


BAD: dict[str, dict[str, Any]] = {
    "late": {"zero_s": 0.5},
    "never": {"zero_s": None, "rest_s": None},
    "still moving": {"rest_s": None},
    "too far": {"rolled_m": 3.0},
    "collision": {"collisions": 1},
    "split": {"split": True},
    "wrong word": {"failsafe": ("loop_overrun",)},
    "no word": {"failsafe": ()},
}


@pytest.mark.parametrize("case", BAD)
def test_everything_a_row_demands_is_judged(case: str) -> None:
    row = BY_NAME["motion capture: occlusion"]
    allowed = allowed_m(row, arena_for(Job(3, 19, 1, "field", "field", 60.0)))
    assert not list(judge(row, GOOD, allowed))
    assert list(judge(row, msgspec.structs.replace(GOOD, **BAD[case]), allowed))


def test_a_fault_that_must_not_stop_anybody_is_bad_when_it_does() -> None:
    row = BY_NAME["motion capture: duplicate"]
    assert list(judge(row, GOOD, float("inf")))
    assert not list(judge(row, msgspec.structs.replace(GOOD, failsafe=(), zero_s=None, rest_s=None), float("inf")))


def sample(stamp_ns: int, speed: float, enabled: bool = True, released: bool = False) -> MotorSample:
    return MotorSample(stamp_ns=stamp_ns, left_radps=speed, right_radps=-speed, enabled=enabled, released=released)


def test_zero_begins_where_no_motion_follows() -> None:
    moving = [sample(1, 1.0), sample(2, 0.0), sample(3, 1.0)]
    assert zero_after_s(moving, 0) is None
    assert zero_after_s([], 0) is None
    assert zero_after_s(moving, 0, first=True) == 0.0
    stopped = [*moving, sample(500_000_000, 0.0), sample(600_000_000, 0.0)]
    assert zero_after_s(stopped, 0) == 0.5
    assert zero_after_s([*moving, sample(500_000_000, 1.0, released=True)], 0) == 0.5
    assert zero_after_s([*moving, sample(500_000_000, 1.0, enabled=False)], 0) == 0.5
    assert zero_after_s([sample(1, 0.0), sample(700_000_000, 0.0)], 500_000_000) == 0.2


def test_the_page_has_every_row_and_its_figures() -> None:
    row: Row = BY_NAME["motion capture: occlusion"]
    page = markdown([msgspec.structs.replace(GOOD, row=row.name)], 1)
    assert all(f"| {entry.where} | {entry.fault}" in page for entry in ROWS)
    assert "| 100 / 100 / 100 | 0.10 |" in page
    assert "| 1/1 |" in page
    assert percentiles([3.0, 1.0, 2.0]) == (2.0, 3.0, 3.0)
    assert percentiles([]) is None
