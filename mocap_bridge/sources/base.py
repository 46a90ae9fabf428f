"""What every source of poses delivers, and how the bridge drives it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from mocap_bridge.natnet.frame import Body

if TYPE_CHECKING:
    import zenoh

STEADY = "streaming"


class SourceFrame(NamedTuple):
    """All bodies of one instant, as the source gave them, by name."""

    session: int
    """Raised by one whenever the source restarts."""
    number: int
    exposure_ns: int
    """Middle of the exposure, local monotonic clock."""
    transmit_ns: int
    received_ns: int
    clock_error_ns: int
    """Bound on the error of the two stamps of the source."""
    bodies: Mapping[str, Body]
    """Poses in the source's axes and metres."""
    edited: bool = False
    """Played back or edited rather than live."""


class SourceStatus(NamedTuple):
    """How the source itself is, apart from its frames."""

    name: str
    phase: str
    """:data:`STEADY`, "refused", or what it waits for."""
    problem: str = ""
    """What is wrong and what to do, in words; empty when nothing is."""
    nominal_rate_hz: float = 0.0
    """As the source says; 0 when it does not."""
    frames_dropped: int = 0
    malformed: int = 0
    counters: Mapping[str, int] = {}
    names: frozenset[str] = frozenset()
    """Bodies the source knows."""
    duplicate_names: frozenset[str] = frozenset()
    duplicate_ids: frozenset[str] = frozenset()
    """Bodies that share their id with another, so that frames do not tell them apart."""


class Source(Protocol):
    """A source of poses. Nothing blocks but :meth:`wait`."""

    def wait(self, timeout_s: float) -> None:
        """Until something can be received, at most ``timeout_s``."""

    def receive(self, now_ns: int) -> list[SourceFrame]:
        """Everything that has arrived, oldest first; also does the sending that is due."""

    def status(self) -> SourceStatus: ...

    def close(self) -> None: ...


@runtime_checkable
class OnNetwork(Protocol):
    """A source that also listens on the site's own network."""

    def attach(self, session: "zenoh.Session") -> None:
        """Subscribe to what it needs."""
