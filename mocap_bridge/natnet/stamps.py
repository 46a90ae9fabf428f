"""When a frame was exposed and sent, on the local clock: by echoed clock, else by arrivals. Pure."""

from collections import Counter
from typing import NamedTuple

from mocap_bridge.natnet.clock import ASSUMED_NS, ArrivalClock, EchoClock
from mocap_bridge.natnet.frame import Frame

ECHO_PATIENCE_NS = 1_000_000_000
"""After this without an answered echo, stamps are taken from arrivals."""


class Stamped(NamedTuple):
    """A decoded frame with its stamps on the local clock."""

    frame: Frame
    exposure_ns: int
    transmit_ns: int
    received_ns: int
    clock_error_ns: int


class Stamper:
    """Stamps of one server session; make a new one when the server restarts.

    :param tick_hz: ticks per second of the server's stamps, 0 where it has none that can be used.
    """

    def __init__(self, tick_hz: int, counters: Counter[str]) -> None:
        self.clock = EchoClock(max(tick_hz, 1))
        self.ticking = tick_hz > 0
        self.connected_ns = 0
        """When the server last answered CONNECT: frames wait for the first echo from then on."""
        self._arrivals = ArrivalClock()
        self._counters = counters

    def stamp(self, frame: Frame, now_ns: int) -> Stamped | None:
        """None while the first echo is awaited; the frame is counted under ``before_clock`` then."""
        clock = self.clock
        ticks = frame.transmit_ticks if self.ticking else 0
        if ticks and clock.ready:
            transmit_ns = clock.local_ns(ticks)
            return Stamped(frame, transmit_ns - self._latency_ns(frame), transmit_ns, now_ns, clock.error_ns(ticks))
        if ticks:
            if now_ns - self.connected_ns < ECHO_PATIENCE_NS:
                self._counters["before_clock"] += 1
                return None
            self._counters["unsynchronised"] += 1
            server_ns, latency_ns = clock.ns(ticks), self._latency_ns(frame)
        else:
            server_ns = int(frame.timestamp_s * 1e9)
            latency_ns = int(frame.latency_s * 1e9) if 0.0 <= frame.latency_s < 1.0 else 0
        transmit_ns = self._arrivals.local_ns(server_ns, now_ns)
        return Stamped(frame, transmit_ns - latency_ns, transmit_ns, now_ns, ASSUMED_NS)

    def _latency_ns(self, frame: Frame) -> int:
        """Middle of the exposure to transmission; 0 where the server does not know it."""
        if not 0 < frame.exposure_ticks < frame.transmit_ticks:
            return 0
        return self.clock.ns(frame.transmit_ticks - frame.exposure_ticks)
