"""The order in force and the heartbeat that repeats it. Pure."""

from contract.arena import Arena, digest
from contract.messages import SCHEMA_VERSION, Order, StationHeartbeat
from contract.units import Point
from groundstation.crew import Crew


class Will:
    """What the station wants of its robots. Every change of mind is a new ``order_id``, which a robot obeys once."""

    def __init__(self, arena: Arena, boot: int, now_ns: int) -> None:
        self.arena_hash = digest(arena)
        self.order: Order = "disarm"
        self._boot = boot
        self._order_id = 1
        self._ordered_ns = now_ns
        self._seq = 0

    def give(self, order: Order, now_ns: int) -> None:
        """A new order."""
        self.order, self._ordered_ns = order, now_ns
        self._order_id += 1

    def age_s(self, now_ns: int) -> float:
        """Of the order in force."""
        return (now_ns - self._ordered_ns) / 1e9

    def heartbeat(self, crew: Crew, mission: str, aside: dict[str, Point] | None, now_ns: int) -> StationHeartbeat:
        """The next one.

        :param aside: on the way home, who waits where, m; None: this is no way home.
        """
        self._seq += 1
        addressees = (crew.joining,) if crew.joining else crew.addressees
        return StationHeartbeat(
            schema_version=SCHEMA_VERSION,
            boot=self._boot,
            seq=self._seq,
            stamp_ns=now_ns,
            order=self.order,
            order_id=self._order_id,
            robots=() if self.order == "stop" else addressees,
            home=aside is not None,
            aside=aside or {},
            excluded=tuple(sorted(crew.excluded)),
            mission=mission,
            arena_hash=self.arena_hash,
        )
