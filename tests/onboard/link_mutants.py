"""The link protocol with one check left out at a time."""

from contract.messages import LinkMessage, TransactionId
from onboard.ahdc.links import Entry, Link, LinkTable, Removal


class NoPathCheck(LinkTable):
    """Rule 3: path nodes forward without vouching for either of their path links."""

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        if message.hop == len(message.path) - 1:
            super()._on_lock(sender, message, now_s)
        else:
            forward(self, message)


class NoBackCheck(LinkTable):
    """Rule 3: path nodes forward if they vouch for the link onwards."""

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        if message.hop < len(message.path) - 1 and self.vouches(message.path[message.hop + 1]):
            forward(self, message)
        else:
            super()._on_lock(sender, message, now_s)


class NoOnwardCheck(LinkTable):
    """Rule 3: path nodes forward if they vouch for the link back."""

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        if message.hop < len(message.path) - 1 and self.vouches(sender):
            forward(self, message)
        else:
            super()._on_lock(sender, message, now_s)


class NoFirstLinkCheck(LinkTable):
    """Rule 2: the coordinator does not ask itself whether it vouches for its first path link."""

    def propose_removal(self, path: list[str], now_s: float) -> bool:
        other = path[-1]
        if self.removal is not None or not self.vouches(other):
            return False
        tx = self._new_id()
        entry = self.entries[other]
        entry.state, entry.tx = Link.DOUBT, tx
        self.removal = Removal(tx, other, now_s)
        self.outbox.append(LinkMessage(to=path[1], kind="lock", tx=tx, path=tuple(path), hop=1))
        return True


class NoDoubt(LinkTable):
    """Rule 2: the coordinator goes on vouching for the link it is about to remove."""

    def vouches(self, other: str) -> bool:
        mine = self.removal is not None and self.removal.other == other
        return super().vouches(other) or mine


class FarEnd(LinkTable):
    """The far end's part of rule 4, check by check."""

    def own(self, coordinator: str) -> bool:
        return self.vouches(coordinator)

    def last(self, sender: str) -> bool:
        return self.vouches(sender)

    def fresh(self, tx: TransactionId) -> bool:
        return tx not in self._closed and self._current(tx)

    def _on_lock(self, sender: str, message: LinkMessage, now_s: float) -> None:
        path, tx = message.path, message.tx
        assert tx is not None
        if message.hop != len(path) - 1:
            super()._on_lock(sender, message, now_s)
            return
        entry = self.entries.setdefault(path[0], Entry())
        again = entry.state is Link.DOUBT and entry.tx == tx
        if again or (self.own(path[0]) and self.last(sender) and self.fresh(tx)):
            entry.state, entry.tx, entry.sent_s = Link.DOUBT, tx, now_s
            self.outbox.append(LinkMessage(to=path[0], kind="yes", tx=tx))
        else:
            self.outbox.append(LinkMessage(to=sender, kind="nack", tx=tx, path=path, hop=message.hop - 1))


class NoOwnLinkCheck(FarEnd):
    """Rule 4: the far end does not ask itself whether it vouches for the link in question."""

    def own(self, coordinator: str) -> bool:
        return True


class NoLastLinkCheck(FarEnd):
    """Rule 4: the far end does not ask itself whether it vouches for its last path link."""

    def last(self, sender: str) -> bool:
        return True


class NoClosedCheck(FarEnd):
    """Rule 4: the far end agrees to a removal that is over."""

    def fresh(self, tx: TransactionId) -> bool:
        return True


class NoDoubtAfterYes(LinkTable):
    """Rule 4: the far end goes on vouching for the link it has agreed to remove."""

    def vouches(self, other: str) -> bool:
        entry = self.entries.get(other)
        agreed = entry is not None and entry.state is Link.DOUBT and entry.tx is not None
        return super().vouches(other) or (agreed and entry.tx.coordinator == other)  # type: ignore[union-attr]


class ConsentOnly(LinkTable):
    """Pairwise consent as in eq. 14: no detour is verified."""

    def propose_removal(self, path: list[str], now_s: float) -> bool:
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


def forward(table: LinkTable, message: LinkMessage) -> None:
    onwards = message.path[message.hop + 1]
    table.outbox.append(LinkMessage(to=onwards, kind="lock", tx=message.tx, path=message.path, hop=message.hop + 1))


MUTANTS = [
    NoFirstLinkCheck, NoDoubt, NoPathCheck, NoBackCheck, NoOnwardCheck, NoOwnLinkCheck, NoLastLinkCheck,
    NoClosedCheck, NoDoubtAfterYes, ConsentOnly,
]  # fmt: skip
