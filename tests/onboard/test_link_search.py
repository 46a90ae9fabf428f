"""Every interleaving of the smallest cases of the link protocol; each check of rules 2 to 4 left out is found."""

import pytest

from onboard.ahdc.links import LinkTable
from tests.onboard.link_mutants import (
    ConsentOnly,
    FarEnd,
    NoBackCheck,
    NoClosedCheck,
    NoDoubt,
    NoLastLinkCheck,
    NoOnwardCheck,
    NoOwnLinkCheck,
    NoPathCheck,
)
from tests.onboard.link_search import Search

TRIANGLE = (3, [(0, 1), (0, 2), (1, 2)])
RING = (4, [(0, 1), (1, 2), (2, 3), (0, 3)])
DIAMOND = (4, [(0, 1), (1, 2), (2, 3), (0, 3), (0, 2)])
LIMIT = 150_000


def test_triangle_every_robot_proposes() -> None:
    found = Search(*TRIANGLE).run(LIMIT)
    assert found.whole
    assert (found.split, found.stuck) == (None, None)
    assert found.states == 69_596


@pytest.mark.parametrize("proposers", [(0, 1), (0, 2)])
@pytest.mark.parametrize("case", [RING, DIAMOND], ids=["ring of 4", "two triangles with a common edge"])
def test_pairs_of_proposers(case: tuple[int, list[tuple[int, int]]], proposers: tuple[int, int]) -> None:
    found = Search(*case, proposers=proposers).run(LIMIT)
    assert found.whole
    assert (found.split, found.stuck) == (None, None)


def test_removed_links_come_back() -> None:
    found = Search(*TRIANGLE, FarEnd, offers=1, proposers=(0, 1), forget=False).run(LIMIT)
    assert found.whole
    assert (found.split, found.stuck) == (None, None)


def test_forgetting_what_is_over_changes_nothing() -> None:
    """The search that keeps every message ever sent agrees with the one that drops those without effect."""
    for proposers in ((0,), (0, 1)):
        lean, full = (Search(*TRIANGLE, proposers=proposers, forget=forget).run(LIMIT) for forget in (True, False))
        assert lean.whole
        assert full.whole
        assert lean.states < full.states
        assert (lean.split, lean.stuck, full.split, full.stuck) == (None, None, None, None)


@pytest.mark.parametrize(
    ("mutant", "case", "proposers"),
    [
        (NoDoubt, TRIANGLE, None),
        (NoPathCheck, RING, (0, 1, 2)),
        (NoBackCheck, RING, (0, 1, 2)),
        (NoOnwardCheck, RING, (0, 1, 2)),
        (NoOwnLinkCheck, TRIANGLE, None),
        (NoLastLinkCheck, TRIANGLE, None),
        (ConsentOnly, TRIANGLE, None),
        (ConsentOnly, RING, None),
    ],
)
def test_a_missing_check_splits(
    mutant: type[LinkTable], case: tuple[int, list[tuple[int, int]]], proposers: tuple[int, ...] | None
) -> None:
    found = Search(*case, mutant, proposers=proposers).run(LIMIT)
    assert found.split, f"{found.states} states, no split"
    assert any("proposes" in step for step in found.split)


def test_a_removal_that_is_over_must_not_come_back_to_life() -> None:
    found = Search(*TRIANGLE, NoClosedCheck, offers=1, proposers=(0, 1), forget=False).run(LIMIT)
    assert found.split
    assert any("offers" in step for step in found.split)
