"""One link at one end, and the one removal that a robot coordinates (:mod:`onboard.ahdc.links`)."""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from contract.messages import TransactionId


class Link(Enum):
    """State of one link at one end."""

    OFF = "off"
    OFFERED = "offered"
    """ADD sent: enforce, do not vouch."""
    ACCEPTED = "accepted"
    """ACCEPT sent: enforce, do not vouch."""
    ON = "on"
    DOUBT = "doubt"
    """A removal is open (either end): enforce, do not vouch."""
    LEAVING = "leaving"
    """Committed as coordinator: enforce until the far end has acknowledged."""


ON: Final = Link.ON
OFF: Final = Link.OFF
LEAVING: Final = Link.LEAVING


@dataclass(slots=True)
class Entry:
    """One link's state at this end."""

    state: Link = Link.OFF
    tx: TransactionId | None = None
    """The transaction it is in: an offer's life, or a removal."""
    sent_s: float = -1e9
    life: TransactionId | None = None
    """The ADD that made this link."""


@dataclass
class Removal:
    """The one transaction this robot coordinates."""

    tx: TransactionId
    other: str
    started_s: float
