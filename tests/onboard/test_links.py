"""The link protocol never splits the enforced graph, always comes to an end, and needs each of its checks."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.messages import LinkMessage
from onboard.ahdc.links import Link, LinkTable
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


class NoPathCheck(LinkTable):
    """Mutant of rule 3: path nodes forward without vouching for both their path links."""

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        last = message.hop == len(message.path) - 1
        if not last:
            onwards = message.path[message.hop + 1]
            self.outbox.append(
                LinkMessage(to=onwards, kind="lock", tx=message.tx, path=message.path, hop=message.hop + 1)
            )
            return
        super()._on_lock(sender, message, now_s)


class NoLastLinkCheck(LinkTable):
    """Mutant of rule 4: the far end does not ask itself whether it vouches for its last path link."""

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        kept = self.vouches
        if message.hop == len(message.path) - 1:
            self.vouches = lambda other: other == sender or kept(other)  # type: ignore[method-assign]
        try:
            super()._on_lock(sender, message, now_s)
        finally:
            self.__dict__.pop("vouches", None)


class NoDoubt(LinkTable):
    """Mutant of rule 2: the coordinator goes on vouching for the link it is about to remove."""

    def vouches(self, other: str) -> bool:
        mine = self.removal is not None and self.removal.other == other
        return super().vouches(other) or mine


class ConsentOnly(LinkTable):
    """Mutant: pairwise consent as in eq. 14, no detour verified."""

    def propose_removal(self, path: list[str], now_s: float) -> bool:
        return super().propose_removal(path, now_s) if len(path) < 3 else self._ask(path, now_s)

    def _ask(self, path: list[str], now_s: float) -> bool:
        done = super().propose_removal(path, now_s)
        if done:
            message = self.outbox.pop()
            self.outbox.append(LinkMessage(to=path[-1], kind="lock", tx=message.tx, path=message.path, hop=9))
        return done

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        entry = self.entries[sender]
        if entry.state is Link.ON:
            entry.state, entry.tx = Link.DOUBT, message.tx
            self.outbox.append(LinkMessage(to=sender, kind="yes", tx=message.tx))


MUTANTS = [NoPathCheck, NoLastLinkCheck, NoDoubt, ConsentOnly]


@pytest.mark.parametrize("mutant", MUTANTS)
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
