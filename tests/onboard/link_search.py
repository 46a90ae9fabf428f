"""Every interleaving of a small case of the link protocol, up to a number of proposals and offers a robot.

The radio is the worst there is: whatever was ever sent may arrive at any time, in any order, as often as it likes, or
never. That is delay, loss, duplication and reordering in one, and makes the search finite: a state is the tables and
the set of messages ever sent. Time-outs may strike at any moment; what robots repeat or inquire is sent at once, and
the radio decides when that is heard. Looked at after every step: the graph of links enforced at both ends is
connected. Looked at in the end: from every state a way leads to one in which nothing is left open.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from contract.messages import LinkMessage, TransactionId
from onboard.ahdc.links import Entry, Link, LinkTable, Removal

REPEAT_S, TIMEOUT_S = 0.4, 0.6
"""Ticks at these ages repeat and inquire; and give an unanswered removal up, too."""
Step = tuple[str, object]
State = tuple[int, ...]
"""A table's number for every robot, then the messages ever sent, as a bitmap."""


class Outcome(NamedTuple):
    """What a search found. ``split`` and ``stuck`` are ways there, None where there is none."""

    states: int
    steps: int
    split: list[str] | None
    stuck: list[str] | None
    whole: bool
    """Every state was looked at: the limit did not cut the search short."""


class Search:
    """All states that ``robots`` with the given ``edges`` ON can reach."""

    def __init__(
        self,
        robots: int,
        edges: Iterable[tuple[int, int]],
        table: type[LinkTable] = LinkTable,
        proposals: int = 1,
        offers: int = 0,
        proposers: Iterable[int] | None = None,
        forget: bool = True,
    ) -> None:
        self.names = [f"r{k}" for k in range(robots)]
        self._edges = sorted(edges)
        self._proposals, self._offers = proposals, offers
        self._proposers = set(range(robots) if proposers is None else proposers)
        self._messages: list[tuple[str, LinkMessage]] = []
        self._numbers: dict[tuple[str, LinkMessage], int] = {}
        self._inbox = [0] * robots
        self._tables: list[LinkTable] = []
        self._keys: dict[object, int] = {}
        self._memory: dict[tuple[int, Step], tuple[int, int]] = {}
        self._masks: list[int] = []
        self._forget = forget
        self._removals: dict[TransactionId, int] = {}
        self._about: list[int] = []
        """Messages of each removal, as a bitmap."""
        self._open: list[int] = []
        self._shut: list[int] = []
        """Removals that a table is in, and those it has closed, as bitmaps."""
        self._joined: dict[tuple[int, ...], bool] = {}
        self._paths = {k: list(self._detours(k)) for k in self._proposers}
        self._first = tuple(self._number(self._initial(k, table)) for k in range(robots))

    def run(self, limit: int) -> Outcome:
        """Breadth first, until a split or ``limit`` states."""
        first: State = (*self._first, 0)
        parents: dict[State, tuple[State, Step] | None] = {first: None}
        before: dict[State, list[State]] = {}
        ends: list[State] = []
        steps = 0
        queue = deque([first])
        while queue:
            state = queue.popleft()
            last = True
            for what, new in self._successors(state):
                steps += 1
                last = False
                before.setdefault(new, []).append(state)
                if new in parents:
                    continue
                parents[new] = (state, what)
                if not self._connected(new):
                    return Outcome(len(parents), steps, self._way(parents, new), None, False)
                queue.append(new)
            if last and self._clean(state):
                ends.append(state)
            if len(parents) > limit:
                return Outcome(len(parents), steps, None, None, False)
        ended = set(ends)
        while ends:
            ends += [b for b in before.get(ends.pop(), ()) if b not in ended and not ended.add(b)]  # type: ignore[func-returns-value]
        stuck = next((state for state in parents if state not in ended), None)
        return Outcome(len(parents), steps, None, self._way(parents, stuck) if stuck else None, True)

    def _successors(self, state: State) -> Iterator[tuple[Step, State]]:
        sent = state[-1]
        for k in range(len(self.names)):
            known = state[k]
            for what in self._events(k, known, sent):
                new, out = self._step(k, known, what)
                if new != known or out & ~sent:
                    tables = (*state[:k], new, *state[k + 1 : -1])
                    yield (f"{self.names[k]} {what[0]}", what[1]), (*tables, self._alive(tables, sent | out))

    def _alive(self, tables: State, sent: int) -> int:
        """The messages sent, without those of removals that are over: nobody would do anything on them.

        A removal is over once the far end has closed it and neither end is in it any more. The far end then refuses
        its LOCK and acknowledges its COMMIT, and the coordinator answers an inquiry: all of it without effect.
        """
        if not self._forget:
            return sent
        over = shut = 0
        for number in tables:
            over |= self._open[number]
            shut |= self._shut[number]
        over = shut & ~over
        while over:
            low = over & -over
            over ^= low
            sent &= ~self._about[low.bit_length() - 1]
        return sent

    def _events(self, k: int, known: int, sent: int) -> Iterator[Step]:
        waiting = sent & self._inbox[k]
        while waiting:
            low = waiting & -waiting
            waiting ^= low
            yield "hears", low.bit_length() - 1
        table = self._tables[known]
        if table.removal is not None:
            yield "gives up", None
        elif k in self._proposers and table._counter < self._base[k] + self._proposals:
            for path in self._paths[k]:
                yield "proposes", path
        if self._offers and table._counter < self._base[k] + self._proposals + self._offers:
            for a, b in self._edges:
                if a == k and table.state(self.names[b]) is Link.OFF:
                    yield "offers", self.names[b]

    def _step(self, k: int, known: int, what: Step) -> tuple[int, int]:
        """The table after the event, and what was sent; each computed once."""
        found = self._memory.get((known, what))
        if found is None:
            table = copy_of(self._tables[known])
            kind, detail = what
            if kind == "hears":
                assert isinstance(detail, int)
                table.hear(*self._messages[detail], 0.0)
            elif kind == "gives up":
                table.tick(TIMEOUT_S)
            elif kind == "proposes":
                assert isinstance(detail, tuple)
                table.propose_removal(list(detail), 0.0)
            else:
                assert isinstance(detail, str)
                table.offer(detail, 0.0)
            forget_time(table)
            table.tick(REPEAT_S)
            forget_time(table)
            sent = 0
            for message in table.outbox:
                sent |= 1 << self._message(self.names[k], message)
            table.outbox.clear()
            found = self._memory[known, what] = (self._number(table), sent)
        return found

    def _message(self, sender: str, message: LinkMessage) -> int:
        number = self._numbers.get((sender, message))
        if number is None:
            number = self._numbers[sender, message] = len(self._messages)
            self._messages.append((sender, message))
            self._inbox[self.names.index(message.to)] |= 1 << number
            if message.tx is not None and message.kind not in ("add", "accept", "confirm"):
                self._about[self._removal(message.tx)] |= 1 << number
        return number

    def _removal(self, tx: TransactionId) -> int:
        number = self._removals.get(tx)
        if number is None:
            number = self._removals[tx] = len(self._about)
            self._about.append(0)
        return number

    def _number(self, table: LinkTable) -> int:
        key = key_of(table)
        number = self._keys.get(key)
        if number is None:
            number = self._keys[key] = len(self._tables)
            self._tables.append(table)
            self._masks.append(sum(1 << self.names.index(other) for other in table.enforced()))
            within = {e.tx for e in table.entries.values() if e.state in (Link.DOUBT, Link.LEAVING) and e.tx}
            lives = {e.life for e in table.entries.values()}
            self._open.append(sum(1 << self._removal(tx) for tx in within))
            self._shut.append(sum(1 << self._removal(tx) for tx in table._closed if tx not in lives))
        return number

    def _connected(self, state: State) -> bool:
        masks = tuple(self._masks[number] for number in state[:-1])
        known = self._joined.get(masks)
        if known is None:
            found, frontier = 1, [0]
            while frontier:
                k = frontier.pop()
                for other in range(len(masks)):
                    if masks[k] >> other & masks[other] >> k & ~(found >> other) & 1:
                        found |= 1 << other
                        frontier.append(other)
            known = self._joined[masks] = found == (1 << len(masks)) - 1
        return known

    def _clean(self, state: State) -> bool:
        """Every link is ON at both ends or OFF at both."""
        tables = [self._tables[number] for number in state[:-1]]
        for i, a in enumerate(self.names):
            for j in range(i):
                pair = {tables[i].state(self.names[j]), tables[j].state(a)}
                if pair not in ({Link.ON}, {Link.OFF}):
                    return False
        return True

    def _initial(self, k: int, table: type[LinkTable]) -> LinkTable:
        """All the robot's edges ON, as the handshake leaves them: the lower id has offered."""
        made = table(self.names[k], boot=1)
        for a, b in self._edges:
            if k in (a, b):
                number = 1 + [edge[1] for edge in self._edges if edge[0] == a].index(b)
                life = TransactionId(coordinator=self.names[a], boot=1, number=number)
                made.entries[self.names[b if k == a else a]] = Entry(Link.ON, life, 0.0, life)
        made._counter = self._base[k]
        return made

    @property
    def _base(self) -> list[int]:
        return [sum(a == k for a, _ in self._edges) for k in range(len(self.names))]

    def _detours(self, k: int) -> Iterator[tuple[str, ...]]:
        """Every simple way from a robot to each of its neighbours that is not the link itself."""
        beside: dict[int, list[int]] = {i: [] for i in range(len(self.names))}
        for a, b in self._edges:
            beside[a].append(b)
            beside[b].append(a)
        frontier = [[k]]
        while frontier:
            path = frontier.pop()
            if len(path) > 2 and path[-1] in beside[k]:
                yield tuple(self.names[i] for i in path)
            frontier += [[*path, other] for other in beside[path[-1]] if other not in path]

    def _way(self, parents: dict[State, tuple[State, Step] | None], state: State) -> list[str]:
        words: list[str] = []
        while (parent := parents[state]) is not None:
            state, (who, detail) = parent
            if isinstance(detail, int):
                sender, message = self._messages[detail]
                detail = f"{message.kind} of {sender}"
            words.append(f"{who} {detail or ''}".strip())
        return words[::-1]


def copy_of(table: LinkTable) -> LinkTable:
    """A copy that shares nothing that changes."""
    made = object.__new__(type(table))
    made.__dict__.update(table.__dict__)
    made.entries = {name: Entry(e.state, e.tx, 0.0, e.life) for name, e in table.entries.items()}
    made.outbox = []
    made.removal = table.removal and Removal(table.removal.tx, table.removal.other, 0.0)
    for name in ("_committed", "_closed", "boots", "_lives"):
        setattr(made, name, dict(getattr(table, name)))
    return made


def forget_time(table: LinkTable) -> None:
    for entry in table.entries.values():
        entry.sent_s = 0.0
    if table.removal is not None:
        table.removal.started_s = 0.0


def key_of(table: LinkTable) -> object:
    """Equal for tables that behave alike from now on."""
    links = tuple(sorted((name, e.state.value, ident(e.tx), ident(e.life)) for name, e in table.entries.items()))
    removal = table.removal and (ident(table.removal.tx), table.removal.other)
    closed, committed = (frozenset(map(ident, memory)) for memory in (table._closed, table._committed))
    lives = tuple(sorted((name, ident(tx)) for name, tx in table._lives.items()))
    return (table.robot, table.boot, table._counter, links, removal, closed, committed, lives)


def ident(tx: TransactionId | None) -> tuple[str, int, int]:
    return ("", 0, 0) if tx is None else (tx.coordinator, tx.boot, tx.number)
