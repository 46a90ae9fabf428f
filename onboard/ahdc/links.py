"""The verified-path link protocol of the ``field`` profile: no removal on one robot's view.

Theory of operation. Every link is kept ("enforced") by both its ends until a *transaction* has verified
a detour hop by hop. An end *enforces* a link in every state but OFF, and *vouches* for it, that is, lets
others' detours lean on it, only in state ON. A coordinator first stops vouching (DOUBT), then sends LOCK
along the detour; each node on it forwards only if it vouches for both its path links, the far end answers
YES only if it vouches for the link in question and for its last path link. After YES the coordinator logs
the transaction and repeats COMMIT until the far end acknowledges. Any edge removed from a verified path
had a coordinator that started later, so replacing removed edges by their own verified paths terminates:
the graph of links enforced at both ends stays connected under any delay, loss, duplication and reordering.

New links come by a three-way handshake (ADD, ACCEPT, CONFIRM); each end enforces from its own first
message on and vouches only once it knows that the other end enforces.

Pure: :meth:`LinkTable.hear` and :meth:`LinkTable.tick` take messages and time (s) and fill an outbox.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final, Literal

from contract.messages import LinkMessage, TransactionId
from onboard.ahdc.link_state import LEAVING, OFF, ON, Entry, Link, Removal

__all__ = ["LEAVING", "OFF", "ON", "Entry", "Link", "LinkTable", "Removal"]

Repeated = Literal["add", "accept", "confirm", "commit", "inquire"]

OFFER_REPEAT_S: Final = 0.1
COMMIT_REPEAT_S: Final = 0.1
INQUIRE_S: Final = 0.3
LOCK_TIMEOUT_S: Final = 0.5
"""Liveness only: a removal that is not answered in time is given up."""
REMEMBERED: Final = 512
"""Closed transactions kept in mind (they are older than any message still under way)."""


@dataclass
class LinkTable:
    """All links of one robot. ``boot`` differs after every restart, so old transactions are known as such."""

    robot: str
    boot: int
    entries: dict[str, Entry] = field(default_factory=dict)
    outbox: list[LinkMessage] = field(default_factory=list)
    removal: Removal | None = None
    fit: bool = True
    """This robot obeys its law: it keeps its links, so that others may lean on them."""
    boots: dict[str, int] = field(default_factory=dict)
    """The newest boot number noted of each other robot."""
    _counter: int = 0
    _committed: dict[TransactionId, None] = field(default_factory=dict)
    _closed: dict[TransactionId, None] = field(default_factory=dict)
    _silent: set[str] = field(default_factory=set)
    _lives: dict[str, TransactionId] = field(default_factory=dict)
    """The newest ADD taken from each robot: an older one that arrives late is not taken."""

    def state(self, other: str) -> Link:
        entry = self.entries.get(other)
        return OFF if entry is None else entry.state

    def enforces(self, other: str) -> bool:
        """Rule 1: the motion bound holds for this link."""
        entry = self.entries.get(other)
        return entry is not None and entry.state is not OFF

    def __contains__(self, other: object) -> bool:
        return isinstance(other, str) and self.enforces(other)

    def vouches(self, other: str) -> bool:
        """Rule 1: others' detours may lean on this link. Never for a neighbour that has gone silent, never of a robot
        that is not where it is told to be."""
        entry = self.entries.get(other)
        return self.fit and entry is not None and entry.state is ON and other not in self._silent

    def enforced(self) -> list[str]:
        return [name for name, entry in self.entries.items() if entry.state is not OFF]

    def vouched(self) -> list[str]:
        return [name for name in self.entries if self.vouches(name)]

    def note_silence(self, silent: Iterable[str]) -> None:
        """Neighbours not heard of lately: their links stay enforced but are not vouched for (rule 8)."""
        self._silent = set(silent)

    def note_boot(self, other: str, boot: int) -> None:
        """A neighbour with a new boot number has lost its memory: enforce, stop vouching, offer anew (rule 8)."""
        known = self.boots.get(other)
        if known == boot:
            return
        self.boots[other] = boot
        if known is None or not self.enforces(other):
            return
        entry = self.entries[other]
        if self.removal is not None and self.removal.other == other:
            self.removal = None
        entry.state, entry.tx, entry.life = Link.DOUBT, None, None

    def release(self) -> None:
        """Give every link up without asking: an operator sends the swarm home. Old transactions stay closed."""
        self.removal = None
        self.outbox.clear()
        for entry in self.entries.values():
            if entry.tx is not None:
                self._close(entry.tx)
            self._close_life(entry)
            entry.state, entry.tx = Link.OFF, None

    def forget(self, other: str) -> None:
        """End one link without the other end's consent: an operator has taken it out of the network."""
        entry = self.entries.get(other)
        if entry is None:
            return
        if self.removal is not None and self.removal.other == other:
            self.removal = None
        if entry.tx is not None:
            self._close(entry.tx)
        self._close_life(entry)
        entry.state, entry.tx = Link.OFF, None

    def offer(self, other: str, now_s: float) -> None:
        """Start a link with a neighbour (rule 7); nothing happens where one exists in good state."""
        entry = self.entries.setdefault(other, Entry())
        if entry.state is Link.OFF or (entry.state is Link.DOUBT and entry.tx is None):
            self._close_life(entry)
            entry.state = Link.OFFERED
            entry.tx = entry.life = self._new_id()
            self._send(entry, now_s, other, "add")

    def renew(self, other: str, now_s: float) -> None:
        """The other end says that it keeps this link no more: enforce, stop vouching, offer anew (rule 8)."""
        entry = self.entries[other]
        entry.state, entry.tx = Link.DOUBT, None
        self.offer(other, now_s)

    def propose_removal(self, path: list[str], now_s: float) -> bool:
        """Coordinate the removal of the link to ``path[-1]`` over a detour ``path``, own id first (rule 2)."""
        other = path[-1]
        if self.removal is not None or len(path) < 3 or not self.vouches(other) or not self.vouches(path[1]):
            return False
        entry = self.entries[other]
        tx = self._new_id()
        entry.state, entry.tx = Link.DOUBT, tx
        self.removal = Removal(tx, other, now_s)
        self.outbox.append(LinkMessage(to=path[1], kind="lock", tx=tx, path=tuple(path), hop=1))
        return True

    def tick(self, now_s: float) -> None:
        """Repetitions and time-outs."""
        if self.removal is not None and now_s - self.removal.started_s > LOCK_TIMEOUT_S:
            self._abort()
        for other, entry in self.entries.items():
            if entry.state is ON or entry.state is OFF:
                continue
            if entry.state is Link.OFFERED and now_s - entry.sent_s >= OFFER_REPEAT_S:
                self._send(entry, now_s, other, "add")
            elif entry.state is Link.ACCEPTED and now_s - entry.sent_s >= OFFER_REPEAT_S:
                self._send(entry, now_s, other, "accept")
            elif entry.state is Link.LEAVING and now_s - entry.sent_s >= COMMIT_REPEAT_S:
                self._send(entry, now_s, other, "commit")
            elif (
                entry.state is Link.DOUBT
                and entry.tx is not None
                and entry.tx.coordinator != self.robot
                and now_s - entry.sent_s >= INQUIRE_S
            ):
                self._send(entry, now_s, other, "inquire")

    def hear(self, sender: str, message: LinkMessage, now_s: float) -> None:
        """One message from ``sender``; anything that does not fit the state is answered or ignored, never obeyed."""
        if message.to != self.robot or message.tx is None or sender == self.robot:
            return
        entry = self.entries.setdefault(sender, Entry())
        tx = message.tx
        match message.kind:
            case "add" if tx.coordinator == sender:
                self._on_add(sender, entry, tx, now_s)
            case "accept":
                self._on_accept(sender, entry, tx, now_s)
            case "confirm":
                if entry.state is Link.ACCEPTED and entry.life == tx:
                    entry.state = Link.ON
            case "lock":
                self._on_lock(sender, message, now_s)
            case "nack":
                self._on_nack(message)
            case "yes":
                self._on_yes(sender, entry, tx, now_s)
            case "commit":
                self._on_commit(sender, entry, tx)
            case "abort" if tx.coordinator == sender:
                self._close(tx)
                if entry.state is Link.DOUBT and entry.tx == tx:
                    entry.state = Link.ON
            case "ack":
                if entry.state is Link.LEAVING and entry.tx == tx:
                    entry.state, entry.tx = Link.OFF, None
                    self._close_life(entry)
            case "inquire":
                self._on_inquire(sender, tx)
            case "unknown":
                self._on_unknown(sender, entry, tx, now_s)

    def _on_add(self, sender: str, entry: Entry, tx: TransactionId, now_s: float) -> None:
        newest = self._lives.get(sender)
        late = newest is not None and newest.boot == tx.boot and tx.number < newest.number
        if tx in self._closed or late or not self._current(tx):
            return
        if entry.state is Link.ON and entry.life == tx:
            return
        crossed = entry.state is Link.OFFERED
        if crossed and self.robot < sender:
            return  # both offered: the lower id's offer counts
        orphaned = entry.state in (Link.ACCEPTED, Link.DOUBT, Link.LEAVING, Link.ON) and entry.life != tx
        if entry.state is Link.OFF or crossed or orphaned:
            if self.removal is not None and self.removal.other == sender:
                self.removal = None
            self._close_life(entry)
            entry.state = Link.ACCEPTED
            entry.tx = entry.life = self._lives[sender] = tx
        if entry.state is Link.ACCEPTED and entry.life == tx:
            self._send(entry, now_s, sender, "accept")

    def _on_accept(self, sender: str, entry: Entry, tx: TransactionId, now_s: float) -> None:
        if entry.life != tx:
            self.outbox.append(LinkMessage(to=sender, kind="unknown", tx=tx))
            return
        if entry.state is Link.OFFERED:
            entry.state = Link.ON
        if entry.state is not Link.OFF:
            self._send(entry, now_s, sender, "confirm", tx)

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        path, hop, tx = message.path, message.hop, message.tx
        assert tx is not None
        if not (len(path) - 1 >= 2 and 1 <= hop < len(path) and path[hop] == self.robot and path[hop - 1] == sender):
            return
        coordinator = path[0]
        if coordinator != tx.coordinator or coordinator == self.robot:
            return
        last = hop == len(path) - 1
        if last:
            entry = self.entries.setdefault(coordinator, Entry())
            again = entry.state is Link.DOUBT and entry.tx == tx
            sound = self.vouches(coordinator) and self.vouches(sender)
            if again or (sound and tx not in self._closed and self._current(tx)):
                entry.state, entry.tx, entry.sent_s = Link.DOUBT, tx, now_s
                self.outbox.append(LinkMessage(to=coordinator, kind="yes", tx=tx))
                return
        elif self.vouches(sender) and self.vouches(path[hop + 1]):
            self.outbox.append(LinkMessage(to=path[hop + 1], kind="lock", tx=tx, path=path, hop=hop + 1))
            return
        self.outbox.append(LinkMessage(to=sender, kind="nack", tx=tx, path=path, hop=hop - 1))

    def _on_nack(self, message: LinkMessage) -> None:
        tx = message.tx
        if self.removal is not None and self.removal.tx == tx:
            self._abort()
        elif 1 <= message.hop < len(message.path) and message.path[message.hop] == self.robot:
            back = message.path[message.hop - 1]
            self.outbox.append(LinkMessage(to=back, kind="nack", tx=tx, path=message.path, hop=message.hop - 1))

    def _on_yes(self, sender: str, entry: Entry, tx: TransactionId, now_s: float) -> None:
        if self.removal is not None and self.removal.tx == tx and self.removal.other == sender:
            self.removal = None
            _remember(self._committed, tx)
            entry.state, entry.tx = Link.LEAVING, tx
            self._send(entry, now_s, sender, "commit")
        elif tx.coordinator == self.robot:
            self._on_inquire(sender, tx)

    def _on_commit(self, sender: str, entry: Entry, tx: TransactionId) -> None:
        if entry.state is Link.DOUBT and entry.tx == tx:
            entry.state, entry.tx = Link.OFF, None
            self._close_life(entry)
            self._close(tx)
        if tx in self._closed:
            self.outbox.append(LinkMessage(to=sender, kind="ack", tx=tx))

    def _on_inquire(self, sender: str, tx: TransactionId) -> None:
        if tx.coordinator != self.robot:
            return
        if tx.boot != self.boot:
            answer: Literal["unknown", "commit", "abort"] = "unknown"
        elif tx in self._committed:
            answer = "commit"
        elif self.removal is not None and self.removal.tx == tx:
            return
        else:
            answer = "abort"
        self.outbox.append(LinkMessage(to=sender, kind=answer, tx=tx))

    def _on_unknown(self, sender: str, entry: Entry, tx: TransactionId, now_s: float) -> None:
        """The other end knows nothing of this removal or this life of the link: enforce, and offer it anew (rule 6)."""
        lost = entry.state is Link.DOUBT and entry.tx == tx and tx.coordinator == sender
        if lost or (entry.state is Link.ACCEPTED and entry.life == tx):
            entry.state, entry.tx = Link.DOUBT, None
            self.offer(sender, now_s)

    def _current(self, tx: TransactionId) -> bool:
        """Not of a boot that its coordinator has left behind, as far as this robot knows."""
        return self.boots.get(tx.coordinator, tx.boot) == tx.boot

    def _abort(self) -> None:
        removal = self.removal
        assert removal is not None
        self.removal = None
        entry = self.entries[removal.other]
        if entry.state is Link.DOUBT and entry.tx == removal.tx:
            entry.state = Link.ON
        self.outbox.append(LinkMessage(to=removal.other, kind="abort", tx=removal.tx))

    def _close(self, tx: TransactionId) -> None:
        _remember(self._closed, tx)

    def _close_life(self, entry: Entry) -> None:
        if entry.life is not None:
            self._close(entry.life)
            entry.life = None

    def _new_id(self) -> TransactionId:
        self._counter += 1
        return TransactionId(coordinator=self.robot, boot=self.boot, number=self._counter)

    def _send(self, entry: Entry, now_s: float, other: str, kind: Repeated, tx: TransactionId | None = None) -> None:
        entry.sent_s = now_s
        self.outbox.append(LinkMessage(to=other, kind=kind, tx=tx or entry.tx))


def _remember(memory: dict[TransactionId, None], tx: TransactionId) -> None:
    memory[tx] = None
    if len(memory) > REMEMBERED:
        del memory[next(iter(memory))]
