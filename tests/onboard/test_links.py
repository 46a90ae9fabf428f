"""The link protocol never splits the enforced graph, always comes to an end, and needs each of its checks."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.ahdc.links import LinkTable
from tests.onboard.link_mutants import ConsentOnly, NoDoubt, NoLastLinkCheck, NoPathCheck
from tests.onboard.link_world import LinkWorld, Split, complete, grid, play, random_graph, ring

GRAPHS = {
    "triangle": (3, complete(3)),
    "ring of 4": (4, ring(4)),
    "ring of 6": (6, ring(6)),
    "two cycles with a common edge": (6, [(0, 1), (1, 2), (2, 3), (3, 0), (2, 4), (4, 5), (5, 3)]),
    "complete 5": (5, complete(5)),
    "grid 3 x 3": (9, grid(3, 3)),
}


@pytest.mark.parametrize("graph", GRAPHS)
@given(seed=st.integers(0, 2**32))
def test_no_schedule_splits_the_enforced_graph_and_all_transactions_end(graph: str, seed: int) -> None:
    robots, edges = GRAPHS[graph]
    rng = random.Random(seed)
    world = LinkWorld(robots, edges)
    play(world, rng, 150)
    world.settle()
    assert world.open_ends() == []


@given(seed=st.integers(0, 2**32), robots=st.integers(3, 12))
def test_random_graphs_stay_whole(seed: int, robots: int) -> None:
    rng = random.Random(seed)
    world = LinkWorld(robots, random_graph(robots, rng))
    play(world, rng, 200)
    world.settle()
    assert world.open_ends() == []


@given(seed=st.integers(0, 2**32))
def test_a_reboot_in_the_middle_splits_nothing(seed: int) -> None:
    rng = random.Random(seed)
    world = LinkWorld(5, random_graph(5, rng))
    play(world, rng, 60)
    world.reboot(rng.choice(world.names))
    world.check()
    play(world, rng, 60)


def test_some_links_are_really_removed() -> None:
    world = LinkWorld(5, complete(5))
    play(world, random.Random(1), 400, loss=0.0)
    world.settle()
    assert len(world.enforced_edges()) < 10
    assert world.removed > 3


RANDOMLY_FOUND = [NoPathCheck, NoLastLinkCheck, NoDoubt, ConsentOnly]
"""The others are rarer: test_link_search.py finds them by looking everywhere."""


@pytest.mark.parametrize("mutant", RANDOMLY_FOUND)
def test_every_check_is_needed(mutant: type[LinkTable]) -> None:
    for seed in range(3000):
        rng = random.Random(seed)
        robots, edges = rng.choice([(3, complete(3)), (4, ring(4)), (4, complete(4)), (6, ring(6)), *GRAPHS.values()])
        world = LinkWorld(robots, edges, mutant)
        try:
            play(world, rng, 120, loss=0.05)
        except Split:
            return
    pytest.fail(f"{mutant.__name__} never split the graph in 3000 runs")
