"""Packets of Qualisys Track Manager to frames by name. Pure."""

import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Sequence as Items
from typing import NamedTuple

from mocap_bridge.natnet.clock import ASSUMED_NS, ArrivalClock
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.sequence import Sequence
from mocap_bridge.sources.base import SourceFrame


class Packet(NamedTuple):
    """What one 6D packet holds."""

    number: int
    timestamp_us: int
    bodies: Items[tuple[Items[float], Items[float], float]]
    """Position in mm, rotation matrix, nine numbers column by column, both NaN while not tracked; residual in mm."""
    received_ns: int


def quaternion(matrix: Items[float]) -> tuple[float, float, float, float]:
    """(x, y, z, w) of a rotation matrix given column by column, as QTM sends it."""
    a, d, g, b, e, h, c, f, i = matrix
    w = 0.5 * math.sqrt(max(0.0, 1.0 + a + e + i))
    x = math.copysign(0.5 * math.sqrt(max(0.0, 1.0 + a - e - i)), h - f)
    y = math.copysign(0.5 * math.sqrt(max(0.0, 1.0 - a + e - i)), c - g)
    z = math.copysign(0.5 * math.sqrt(max(0.0, 1.0 - a - e + i)), d - b)
    return x, y, z, w


class Setup(NamedTuple):
    """What QTM's parameters tell."""

    names: tuple[str, ...] = ()
    """Of the 6DOF bodies, in the order of the packets."""
    rate_hz: float = 0.0
    """Of the cameras; 0 where it is not told."""


def setup_of(parameters: str | bytes) -> Setup:
    """The parameters "general" and "6d", in XML.

    :raises ValueError: not XML.
    """
    try:
        root = ElementTree.fromstring(parameters)
    except ElementTree.ParseError as error:
        raise ValueError(f"QTM's parameters: {error}") from None
    names = tuple((name.text or "").strip() for name in root.iterfind(".//The_6D//Body/Name"))
    frequency = root.findtext(".//General/Frequency") or "0"
    return Setup(names, float(frequency) if frequency.strip().replace(".", "", 1).isdigit() else 0.0)


class QualisysReceiver:
    """Packets in, frames by name out. Pure."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.session = 0
        self.counters: Counter[str] = Counter()
        self._clock = ArrivalClock()
        self._sequence = Sequence()
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """Frames that never came."""
        return self._dropped + self._sequence.dropped

    def receive(self, packet: Packet) -> SourceFrame | None:
        """One packet; bodies that are not tracked are passed on as such."""
        order = self._sequence.judge(packet.number, packet.timestamp_us * 1e-6, packet.received_ns)
        if order != "new":
            self.counters[order] += 1
            if order == "restart":
                self.session += 1
                self._dropped += self._sequence.dropped
                self._sequence, self._clock = Sequence(), ArrivalClock()
            return None
        bodies: dict[str, Body] = {}
        for name, (position, matrix, residual_mm) in zip(self.setup.names, packet.bodies, strict=False):
            tracked = all(map(math.isfinite, (*position, *matrix)))
            x, y, z = (0.001 * value for value in position) if tracked else (0.0, 0.0, 0.0)
            rotation = quaternion(matrix) if tracked else (0.0, 0.0, 0.0, 1.0)
            error_m = 0.001 * residual_mm if residual_mm >= 0.0 else 0.0
            bodies[name] = (0, x, y, z, *rotation, error_m, TRACKING_VALID if tracked else 0)
        stamp_ns = self._clock.local_ns(packet.timestamp_us * 1000, packet.received_ns)
        return SourceFrame(self.session, packet.number, stamp_ns, stamp_ns, packet.received_ns, ASSUMED_NS, bodies)
