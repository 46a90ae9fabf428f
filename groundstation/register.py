"""Which certificates a site has given out, and which one stands for each holder now. Pure.

A revoked holder's next certificate has another common name (``r06``, then ``r06.2``): the router's rules name the one
that counts, so the old one is worth nothing although it has not expired.
"""

from datetime import datetime, timedelta

import msgspec

from groundstation.certificates import About

SOON = timedelta(days=7)
"""A certificate that ends within this is warned of."""


class Entry(msgspec.Struct, frozen=True):
    """One certificate that was given out."""

    name: str
    """Robot or role."""
    common_name: str
    serial: str
    not_after: datetime
    fingerprint: str
    revoked: bool = False


class Register(msgspec.Struct, frozen=True):
    """Every certificate in the order of its making; the newest of a name counts, unless it is revoked."""

    site: str
    entries: tuple[Entry, ...] = ()

    def current(self, name: str) -> Entry | None:
        """The certificate that stands for a holder; None: it has none, or it is revoked."""
        newest = next((entry for entry in reversed(self.entries) if entry.name == name), None)
        return None if newest is None or newest.revoked else newest

    def is_revoked(self, name: str) -> bool:
        """It had a certificate, and none counts now."""
        return self.current(name) is None and any(entry.name == name for entry in self.entries)

    def common_names(self) -> dict[str, str]:
        """Robot or role to its common name, revoked ones left out: what the router's rules are made from."""
        found = {entry.name: self.current(entry.name) for entry in self.entries}
        return {name: entry.common_name for name, entry in found.items() if entry is not None}

    def next_common_name(self, name: str) -> str:
        """``r06``, or ``r06.2`` once a certificate of r06 has been revoked."""
        spent = {entry.common_name for entry in self.entries if entry.name == name and entry.revoked}
        return f"{name}.{len(spent) + 1}" if spent else name

    def issued(self, name: str, about: About) -> "Register":
        """With one more certificate."""
        entry = Entry(name, about.common_name, about.serial, about.not_after, about.fingerprint)
        return msgspec.structs.replace(self, entries=(*self.entries, entry))

    def revoked(self, name: str) -> "Register":
        """With every certificate of that holder revoked."""
        entries = tuple(
            msgspec.structs.replace(entry, revoked=True) if entry.name == name else entry for entry in self.entries
        )
        return msgspec.structs.replace(self, entries=entries)


def lifetime(not_after: datetime, now: datetime) -> tuple[str, bool]:
    """How long a certificate still lives, in words, and whether that is long enough."""
    left = not_after - now
    if left <= timedelta():
        return f"expired {_words(-left)} ago", False
    return f"ends in {_words(left)}", left > SOON


def _words(span: timedelta) -> str:
    if span.days:
        return f"{span.days} day{'s' * (span.days > 1)}"
    hours, seconds = divmod(span.seconds, 3600)
    return f"{hours} h" if hours else f"{seconds // 60} min"
