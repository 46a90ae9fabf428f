"""The link protocol never splits the enforced graph, always comes to an end, and needs each of its checks."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.messages import LinkMessage
from onboard.ahdc.links import Link, LinkTable
from tests.onboard.link_ends import life, linked
from tests.onboard.link_mutants import ConsentOnly, NoDoubt, NoLastLinkCheck, NoPathCheck
from tests.onboard.link_world import LinkWorld, RoamingWorld, Split, complete, grid, play, random_graph, ring, roam

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


@given(seed=st.integers(0, 2**32), faults=st.sampled_from([0.0, 0.01]))
def test_robots_that_roam_crash_and_reboot_stay_within_reach_of_each_other(seed: int, faults: float) -> None:
    rng = random.Random(seed)
    world = RoamingWorld(rng.randrange(3, 9), rng)
    roam(world, rng, 120, faults=faults)
    for _ in range(8):
        world.meet()
        world.settle(6)
    assert world.open_ends() == []


def test_roaming_robots_really_move_and_part() -> None:
    worlds, parted = [], 0
    for seed in range(4):
        rng = random.Random(seed)
        worlds.append(RoamingWorld(6, rng))
        linked = worlds[-1].enforced_edges()
        roam(worlds[-1], rng, 900)
        parted += sum(worlds[-1].distance_m(a, b) > RoamingWorld.RANGE_M for a, b in linked)
    assert sum(world.moves for world in worlds) > 100
    assert parted > 0
    assert sum(world.removed for world in worlds) > 20


def test_an_offer_that_comes_late_changes_nothing() -> None:
    table = linked("r02", "r01")
    table.hear("r01", LinkMessage(to="r02", kind="add", tx=life("r01", 4)), 0.0)
    assert table.state("r01") is Link.ON
    assert table.outbox == []


def test_a_newer_offer_is_taken_while_an_older_one_is_open() -> None:
    table = LinkTable("r02", boot=1)
    for number in (4, 5):
        table.hear("r01", LinkMessage(to="r02", kind="add", tx=life("r01", number)), 0.0)
    table.hear("r01", LinkMessage(to="r02", kind="confirm", tx=life("r01", 5)), 0.0)
    assert table.state("r01") is Link.ON


def test_an_accepted_offer_that_its_maker_forgot_is_made_anew_by_the_other_side() -> None:
    table, maker = LinkTable("r02", boot=1), linked("r01", "r02", number=0)
    table.hear("r01", LinkMessage(to="r02", kind="add", tx=life("r01", 4)), 0.0)
    maker.hear("r02", table.outbox.pop(), 0.0)
    assert [message.kind for message in maker.outbox] == ["unknown"]
    table.hear("r01", maker.outbox.pop(), 0.0)
    assert table.state("r01") is Link.OFFERED
    maker.hear("r02", table.outbox.pop(), 0.0)
    table.hear("r01", maker.outbox.pop(), 0.0)
    maker.hear("r02", table.outbox.pop(), 0.0)
    assert (table.state("r01"), maker.state("r02")) == (Link.ON, Link.ON)


def test_a_removal_from_before_a_reboot_is_refused() -> None:
    table = linked("r03", "r01")
    for kind in ("add", "confirm"):
        table.hear("r02", LinkMessage(to="r03", kind=kind, tx=life("r02", 1)), 0.0)
    table.outbox.clear()
    table.note_boot("r01", 2)
    lock = LinkMessage(to="r03", kind="lock", tx=life("r01", 7), path=("r01", "r02", "r03"), hop=2)
    table.hear("r02", lock, 0.0)
    assert table.state("r01") is Link.ON
    assert [message.kind for message in table.outbox] == ["nack"]


def test_a_removal_its_coordinator_forgot_ends_in_a_new_offer() -> None:
    table = linked("r03", "r01")
    for kind in ("add", "confirm"):
        table.hear("r02", LinkMessage(to="r03", kind=kind, tx=life("r02", 1)), 0.0)
    lock = LinkMessage(to="r03", kind="lock", tx=life("r01", 7), path=("r01", "r02", "r03"), hop=2)
    table.hear("r02", lock, 0.0)
    assert table.state("r01") is Link.DOUBT
    table.outbox.clear()
    table.hear("r01", LinkMessage(to="r03", kind="unknown", tx=life("r01", 7)), 0.0)
    assert table.enforces("r01")
    assert [message.kind for message in table.outbox] == ["add"]


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
