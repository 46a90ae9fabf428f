"""A message-level world for the link protocol: any delay, loss, duplication, reordering, crash and reboot.

Robots propose removals along random detours that they believe in; nothing else is modelled. The invariant is
checked after every delivery: the graph of links enforced at both ends is connected.
"""

import math
import random
from collections.abc import Iterable

from contract.messages import LinkMessage
from onboard.ahdc.links import Link, LinkTable

Edge = tuple[str, str]


class Split(AssertionError):
    """The enforced graph fell apart."""


class LinkWorld:
    """Robots ``r00``... with all given edges ON, and a radio with a mind of its own."""

    def __init__(self, robots: int, edges: Iterable[tuple[int, int]], table: type[LinkTable] = LinkTable) -> None:
        self.names = [f"r{k:02d}" for k in range(robots)]
        self._table = table
        self.tables = {name: table(name, boot=1) for name in self.names}
        self.radio: list[tuple[str, LinkMessage]] = []
        self.now_s = 0.0
        self.removed = 0
        self.dead: set[str] = set()
        self.must_join: set[str] = set()
        for a, b in edges:
            self._join(self.names[a], self.names[b])

    def _join(self, a: str, b: str) -> None:
        self.tables[a].offer(b, self.now_s)
        for _ in range(3):
            self.collect()
            for sender, message in self.radio:
                self.tables[message.to].hear(sender, message, self.now_s)
            self.radio.clear()
        assert self.tables[a].state(b) is Link.ON
        assert self.tables[b].state(a) is Link.ON

    def collect(self) -> None:
        """Outboxes to the radio."""
        for name, table in self.tables.items():
            if name not in self.dead:
                self.radio += [(name, message) for message in table.outbox]
            table.outbox.clear()

    def propose(self, rng: random.Random) -> None:
        """Some robot proposes to remove one of its links over a detour that looks good from where it stands."""
        name = rng.choice([n for n in self.names if n not in self.dead])
        table = self.tables[name]
        vouched = table.vouched()
        if len(vouched) < 2:
            return
        other = rng.choice(vouched)
        path = self._detour(rng, name, other)
        if path:
            self.removed += table.propose_removal(path, self.now_s)

    def _detour(self, rng: random.Random, start: str, end: str) -> list[str]:
        """A random simple path of enforced links other than the direct one; it may be out of date on arrival."""
        frontier = [[start]]
        while frontier:
            path = frontier.pop(rng.randrange(len(frontier)))
            for name in self.tables[path[-1]].enforced():
                if name == end and len(path) > 1:
                    return [*path, end]
                if name not in path and name != end and len(path) < 6:
                    frontier.append([*path, name])
        return []

    def deliver(self, index: int, *, lose: bool = False, duplicate: bool = False) -> None:
        """One message, whichever: the radio keeps no order."""
        sender, message = self.radio[index]
        if not duplicate:
            del self.radio[index]
        if lose or message.to in self.dead:
            return
        self.tables[message.to].hear(sender, message, self.now_s)
        self.collect()
        self.check()

    def tick(self, elapsed_s: float) -> None:
        """Time passes for everybody."""
        self.now_s += elapsed_s
        for name, table in self.tables.items():
            if name not in self.dead:
                table.tick(self.now_s)
        self.collect()
        self.check()

    def reboot(self, name: str) -> None:
        """A robot loses its memory; by rule 8 it stands still, which enforces every link, until joined again."""
        others = [other for other in self.names if other != name]
        self.tables[name] = self._table(name, boot=self.tables[name].boot + 1)
        self.must_join.add(name)
        for other in others:
            self.tables[other].note_boot(name, self.tables[name].boot - 1)
            self.tables[other].note_boot(name, self.tables[name].boot)

    def enforced_edges(self) -> set[Edge]:
        """Links enforced at both ends; a robot that stands still (dead or not yet joined) enforces all."""
        edges = set()
        for i, a in enumerate(self.names):
            for b in self.names[i + 1 :]:
                if self._holds(a, b) and self._holds(b, a):
                    edges.add((a, b))
        return edges

    def _holds(self, a: str, b: str) -> bool:
        still = a in self.dead or a in self.must_join
        return self.tables[a].enforces(b) or (still and self.tables[b].enforces(a))

    def check(self) -> None:
        """The invariant."""
        edges = self.enforced_edges()
        found, frontier = {self.names[0]}, [self.names[0]]
        while frontier:
            name = frontier.pop()
            for a, b in edges:
                other = b if a == name else a if b == name else None
                if other is not None and other not in found:
                    found.add(other)
                    frontier.append(other)
        if len(found) < len(self.names):
            raise Split(f"{sorted(found)} apart from {sorted(set(self.names) - found)} at {self.now_s:.2f} s")

    def settle(self, rounds: int = 60) -> None:
        """A perfect radio for a while: every transaction must come to an end."""
        for _ in range(rounds):
            self.tick(0.11)
            while self.radio:
                self.deliver(0)

    def open_ends(self) -> list[str]:
        """Links that are not simply ON or OFF, alike at both ends: must be empty after :meth:`settle`."""
        wrong = []
        for i, a in enumerate(self.names):
            for b in self.names[i + 1 :]:
                pair = (self.tables[a].state(b), self.tables[b].state(a))
                if pair not in ((Link.ON, Link.ON), (Link.OFF, Link.OFF)):
                    wrong.append(f"{a}-{b}: {pair[0].value}/{pair[1].value}")
        return wrong


class RoamingWorld(LinkWorld):
    """Robots on a plane that move, hear each other only within range, offer links, crash and reboot.

    A robot moves only while every link it enforces to a robot within range stays within range; one that is dead or
    has not been joined again stands still. What must hold: the robots are connected on the plane, at all times.
    """

    RANGE_M = 1.0
    OFFER_M = 0.8
    STEP_M = 0.15

    def __init__(self, robots: int, rng: random.Random, table: type[LinkTable] = LinkTable) -> None:
        self.places = [(0.0, 0.0)]
        while len(self.places) < robots:
            x, y = rng.choice(self.places)
            self.places.append((x + rng.uniform(-0.7, 0.7), y + rng.uniform(-0.7, 0.7)))
        edges = [(a, b) for b in range(robots) for a in range(b) if math.dist(self.places[a], self.places[b]) <= 1.0]
        super().__init__(robots, edges, table)
        self.moves = self.lost = 0
        self._way = [rng.uniform(-math.pi, math.pi) for _ in range(robots)]
        """Where each would rather go."""

    def distance_m(self, a: str, b: str) -> float:
        return math.dist(self.places[self.names.index(a)], self.places[self.names.index(b)])

    def deliver(self, index: int, *, lose: bool = False, duplicate: bool = False) -> None:
        sender, message = self.radio[index]
        out_of_range = self.distance_m(sender, message.to) > self.RANGE_M
        self.lost += out_of_range
        super().deliver(index, lose=lose or out_of_range, duplicate=duplicate and not out_of_range)

    def wander(self, rng: random.Random) -> None:
        """One robot takes a step, if its links let it."""
        k = rng.randrange(len(self.names))
        name = self.names[k]
        if name in self.dead or name in self.must_join:
            return
        x, y = self.places[k]
        angle, step_m = self._way[k] + rng.uniform(-1.5, 1.5), rng.uniform(0.0, self.STEP_M)
        new = (x + step_m * math.cos(angle), y + step_m * math.sin(angle))
        for other in self.tables[name].enforced():
            place = self.places[self.names.index(other)]
            if math.dist((x, y), place) <= self.RANGE_M < math.dist(new, place):
                return
        self.places[k] = new
        self.moves += 1
        self.check()

    def meet(self) -> None:
        """Offers as the law makes them: the lower id to who is near enough, and everybody around a newcomer."""
        for i, a in enumerate(self.names):
            for b in self.names[i + 1 :]:
                if a in self.dead or b in self.dead:
                    continue
                new = a in self.must_join or b in self.must_join
                if self.distance_m(a, b) <= (self.RANGE_M if new else self.OFFER_M):
                    for one, other in ((a, b), (b, a)) if new else ((a, b),):
                        self.tables[one].offer(other, self.now_s)
        for name in list(self.must_join):
            around = [b for b in self.names if b != name and self.distance_m(name, b) <= self.RANGE_M]
            if all(self.tables[name].state(b) is Link.ON for b in around):
                self.must_join.discard(name)
        self.collect()
        self.check()

    def crash(self, name: str) -> None:
        """It falls silent for good and stands still; the others notice and vouch for it no more."""
        self.dead.add(name)
        for other, table in self.tables.items():
            if other != name:
                table.note_silence(self.dead)

    def _holds(self, a: str, b: str) -> bool:
        """Standing still holds every link within range."""
        still = a in self.dead or a in self.must_join
        return self.tables[a].enforces(b) or (still and self.distance_m(a, b) <= self.RANGE_M)

    def check(self) -> None:
        """The invariant: the links enforced at both ends, none longer than the range, join everybody."""
        for a, b in self.enforced_edges():
            if self.distance_m(a, b) > self.RANGE_M + 1e-9:
                raise Split(f"{a}-{b} is enforced at both ends and {self.distance_m(a, b):.3f} m long")
        super().check()

    def open_ends(self) -> list[str]:
        """Only among living robots within range: the others cannot know."""
        return [words for words in super().open_ends() if not self._excused(words)]

    def _excused(self, words: str) -> bool:
        a, b = words.partition(":")[0].split("-")
        return a in self.dead or b in self.dead or self.distance_m(a, b) > self.RANGE_M


def roam(world: RoamingWorld, rng: random.Random, steps: int, loss: float = 0.15, faults: float = 0.0) -> None:
    """Random life on the plane; ``faults`` is the chance of a crash or a reboot at each step."""
    for _ in range(steps):
        dice = rng.random()
        if rng.random() < faults:
            alive = [name for name in world.names if name not in world.dead]
            if rng.random() < 0.3 and len(alive) > 2:
                world.crash(rng.choice(alive))
            else:
                world.reboot(rng.choice(alive))
            world.check()
        if dice < 0.12:
            world.propose(rng)
            world.collect()
        elif dice < 0.17:
            world.meet()
        elif dice < 0.40:
            world.wander(rng)
        elif dice < 0.50 or not world.radio:
            world.tick(rng.choice((0.02, 0.1, 0.35)))
        else:
            lose, duplicate = rng.random() < loss, rng.random() < 0.1
            world.deliver(rng.randrange(len(world.radio)), lose=lose, duplicate=duplicate)
        if len(world.radio) > 400:
            del world.radio[: len(world.radio) - 400]


def play(world: LinkWorld, rng: random.Random, steps: int, loss: float = 0.15, duplication: float = 0.1) -> None:
    """Random life: proposals, deliveries in any order, loss, duplicates, time."""
    for _ in range(steps):
        dice = rng.random()
        if dice < 0.15:
            world.propose(rng)
            world.collect()
        elif dice < 0.25 or not world.radio:
            world.tick(rng.choice((0.02, 0.1, 0.35)))
        else:
            world.deliver(
                rng.randrange(len(world.radio)), lose=rng.random() < loss, duplicate=rng.random() < duplication
            )
        if len(world.radio) > 400:
            del world.radio[: len(world.radio) - 400]


def ring(n: int) -> list[tuple[int, int]]:
    return [(k, (k + 1) % n) for k in range(n)]


def complete(n: int) -> list[tuple[int, int]]:
    return [(a, b) for a in range(n) for b in range(a + 1, n)]


def grid(columns: int, rows: int) -> list[tuple[int, int]]:
    edges = []
    for k in range(columns * rows):
        if k % columns < columns - 1:
            edges.append((k, k + 1))
        if k + columns < columns * rows:
            edges.append((k, k + columns))
    return edges


def random_graph(n: int, rng: random.Random) -> list[tuple[int, int]]:
    """A connected graph: a random tree and some more edges."""
    edges = {(rng.randrange(k), k) for k in range(1, n)}
    for _ in range(rng.randrange(2 * n)):
        a, b = rng.sample(range(n), 2)
        edges.add((min(a, b), max(a, b)))
    return sorted(edges)
