"""Every interleaving of the link protocol's smallest cases: three and four robots, several removals at once."""

import pytest

from onboard.ahdc.links import LinkTable
from tests.onboard.link_mutants import NoDoubtAfterYes, NoFirstLinkCheck
from tests.onboard.link_search import Search
from tests.onboard.test_link_search import DIAMOND, RING, TRIANGLE

LIMIT = 4_000_000
TWO_SQUARES = (6, [(0, 1), (1, 2), (2, 3), (0, 3), (2, 4), (4, 5), (3, 5)])
CASES = {
    "triangle, removed links come back": (TRIANGLE, {"offers": 1}),
    "triangle, two robots propose twice": (TRIANGLE, {"proposals": 2, "proposers": (0, 1)}),
    "ring of 4, robots 0, 1 and 2 propose": (RING, {"proposers": (0, 1, 2)}),
    "two triangles, robots 0, 1 and 2 propose": (DIAMOND, {"proposers": (0, 1, 2)}),
    "two triangles, robots 1, 2 and 3 propose": (DIAMOND, {"proposers": (1, 2, 3)}),
    "two squares, ends of the common edge propose": (TWO_SQUARES, {"proposers": (2, 3)}),
    "two squares, robots 0 and 4 propose": (TWO_SQUARES, {"proposers": (0, 4)}),
    "two squares, robots 1 and 2 propose": (TWO_SQUARES, {"proposers": (1, 2)}),
}


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", CASES)
def test_every_interleaving(name: str) -> None:
    (robots, edges), options = CASES[name]
    found = Search(robots, edges, **options).run(LIMIT)  # type: ignore[arg-type]
    print(f"{name}: {found.states} states, {found.steps} steps{'' if found.whole else ', cut short'}")
    assert (found.split, found.stuck) == (None, None)


@pytest.mark.parametrize("mutant", [NoFirstLinkCheck, NoDoubtAfterYes])
@pytest.mark.parametrize("case", [TRIANGLE, RING, DIAMOND])
def test_checks_that_others_imply(mutant: type[LinkTable], case: tuple[int, list[tuple[int, int]]]) -> None:
    """These two do not split: PAPER.md says why they stay."""
    found = Search(*case, mutant, proposers=range(3)).run(LIMIT)
    print(f"{mutant.__name__}: {found.states} states{'' if found.whole else ', cut short'}")
    assert found.split is None
