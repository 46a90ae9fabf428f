"""Server ticks to local monotonic nanoseconds, with skew and a bound on the error. Pure.

An echo that left at t0 and came back at t1 with the server's time s bounds the offset between the
clocks: local - server lies within (t1 - t0)/2 of (t0 + t1)/2 - s, however unequal the two ways.
The line through such samples is the clock; since the true offset is a line as well, the error
between two samples never exceeds the larger of the errors at these samples, and grows linearly
beyond them.
"""

from collections import deque
from typing import NamedTuple

WINDOW_NS = 10_000_000_000
RTT_MARGIN_NS = 200_000
"""Samples this much slower than the fastest are not used."""
SKEW_SPAN_NS = 2_000_000_000
"""Shorter windows do not give a skew."""
MAX_SKEW = 500e-6
"""Skew assumed possible while none is measured."""
ASSUMED_NS = 2_000_000
"""Delay of the fastest arrival where no echo tells it."""


class Sample(NamedTuple):
    """One echo: the server's time, the offset local - server, and how far it may be off."""

    server_ns: int
    offset_ns: int
    bound_ns: int


class EchoClock:
    """Clock of one server session; make a new one when the server restarts."""

    def __init__(self, tick_hz: int) -> None:
        self.tick_hz = tick_hz
        self._samples: deque[Sample] = deque()
        self._reference = Sample(0, 0, 0)
        self._first = self._last = 0
        self._skew = 0.0
        self._bound_ns = 0.0
        self.round_trip_ns = 0
        """Fastest round trip in the window."""

    @property
    def ready(self) -> bool:
        """Whether any echo has come back."""
        return bool(self._samples)

    @property
    def skew(self) -> float:
        """How much faster the local clock runs than the server's; 0 until measured."""
        return self._skew

    def ns(self, ticks: int) -> int:
        """Server ticks as nanoseconds of the server's clock."""
        return ticks * 1_000_000_000 // self.tick_hz

    def echo(self, sent_ns: int, ticks: int, received_ns: int) -> None:
        """An answered echo; one that came back before it left is ignored."""
        if received_ns < sent_ns:
            return
        server_ns = self.ns(ticks)
        tick_ns = 1_000_000_000 // self.tick_hz + 1
        half = (received_ns - sent_ns + 1) // 2
        samples = self._samples
        samples.append(Sample(server_ns, sent_ns + half - server_ns, half + tick_ns))
        while samples[-1].server_ns - samples[0].server_ns > WINDOW_NS:
            samples.popleft()
        self._fit()

    def _fit(self) -> None:
        fastest = min(self._samples, key=lambda sample: sample.bound_ns)
        self.round_trip_ns = 2 * fastest.bound_ns
        kept = [s for s in self._samples if s.bound_ns <= fastest.bound_ns + RTT_MARGIN_NS // 2]
        self._reference = fastest
        self._first, self._last = kept[0].server_ns, kept[-1].server_ns
        self._skew, self._bound_ns = 0.0, float(fastest.bound_ns)
        if self._last - self._first < SKEW_SPAN_NS:
            return
        mean_t = sum(s.server_ns - fastest.server_ns for s in kept) / len(kept)
        mean_o = sum(s.offset_ns - fastest.offset_ns for s in kept) / len(kept)
        spread = sum((s.server_ns - fastest.server_ns - mean_t) ** 2 for s in kept)
        product = sum(
            (s.server_ns - fastest.server_ns - mean_t) * (s.offset_ns - fastest.offset_ns - mean_o) for s in kept
        )
        self._skew = product / spread
        shift = round(mean_o - self._skew * mean_t)
        self._reference = Sample(fastest.server_ns, fastest.offset_ns + shift, fastest.bound_ns)
        self._bound_ns = max(self._worst(kept[0]), self._worst(kept[-1]))

    def _worst(self, sample: Sample) -> float:
        return abs(self._offset(sample.server_ns) - sample.offset_ns) + sample.bound_ns

    def _offset(self, server_ns: int) -> int:
        return self._reference.offset_ns + round(self._skew * (server_ns - self._reference.server_ns))

    def local_ns(self, ticks: int) -> int:
        """Local monotonic time of a server stamp; needs :attr:`ready`."""
        server_ns = self.ns(ticks)
        return server_ns + self._offset(server_ns)

    def error_ns(self, ticks: int) -> int:
        """Bound on the error of :meth:`local_ns`, for a server whose clock runs at a steady rate."""
        server_ns = self.ns(ticks)
        if self._last - self._first < SKEW_SPAN_NS:
            return round(self._bound_ns + MAX_SKEW * abs(server_ns - self._reference.server_ns)) + 1
        beyond = max(server_ns - self._last, self._first - server_ns, 0)
        return round(self._bound_ns * (1.0 + 2.0 * beyond / (self._last - self._first))) + 1


class ArrivalClock:
    """Clock of a server that answers no echo: the fastest arrival in the window counts as no delay.

    The unknown shortest delay is the error; :data:`ASSUMED_NS` stands for it.
    """

    def __init__(self) -> None:
        self._least: deque[tuple[int, int]] = deque()
        self._newest_ns: int | None = None

    def local_ns(self, server_ns: int, received_ns: int) -> int:
        """Local time of a stamp that arrived at ``received_ns``, never later than that.

        A stamp that is not newer than all before tells nothing (some servers leave it at 0): its
        arrival stands for it.
        """
        if self._newest_ns is not None and server_ns <= self._newest_ns:
            return received_ns
        self._newest_ns = server_ns
        offset = received_ns - server_ns
        least = self._least
        while least and least[-1][1] >= offset:
            least.pop()
        least.append((server_ns, offset))
        while server_ns - least[0][0] > WINDOW_NS:
            least.popleft()
        return server_ns + least[0][1]
