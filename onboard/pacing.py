"""Which frames to step on, and how well that went: a step on every k-th frame number. Pure."""

from collections import deque
from typing import Final

from contract.messages import LoopTiming

WINDOW: Final = 240
"""Intervals kept for rate and jitter: two seconds at 120 Hz."""


class Pacing:
    """k = max(1, round(control_period x measured frame rate)); rate and misses are judged against rate / k."""

    def __init__(self, control_period_s: float, nominal_rate_hz: float) -> None:
        self._control_period_s = control_period_s
        self._set_rate(nominal_rate_hz)
        self.steps = 0
        self.misses = 0
        self._session = -1
        self._last_frame = -1
        self._last_ns = 0
        self._intervals: deque[int] = deque(maxlen=WINDOW)

    def _set_rate(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.divisor = max(1, round(self._control_period_s * rate_hz))
        """k"""
        self.period_s = self.divisor / rate_hz
        """Nominal time between steps."""

    def frame(self, session: int, frame: int, rate_hz: float) -> bool:
        """Whether to step on this frame. After lost frames the next one is stepped on."""
        if rate_hz > 0 and abs(rate_hz - self.rate_hz) > 0.1 * self.rate_hz:
            self._set_rate(rate_hz)
        k = self.divisor
        if session != self._session:
            self._session, self._last_frame = session, frame
            return True
        due = frame // k > self._last_frame // k
        if due:
            skipped = frame // k - self._last_frame // k - 1
            self.misses += skipped
            self._last_frame = frame
        return due

    def stepped(self, now_ns: int) -> None:
        """A step has run at ``now_ns``."""
        self.steps += 1
        if self._last_ns:
            interval = now_ns - self._last_ns
            self._intervals.append(interval)
            if interval > 1.5e9 * self.period_s:
                self.misses += 1
        self._last_ns = now_ns

    def timing(self) -> LoopTiming | None:
        """Rate and 99th-percentile jitter over the window, misses since the start; None before two steps."""
        if not self._intervals:
            return None
        count, nominal_ns = len(self._intervals), 1e9 * self.period_s
        mean_ns = sum(self._intervals) / count
        beyond = count - min(count - 1, int(0.99 * count))
        sizes = sorted(self._intervals)
        farthest = sorted([abs(interval - nominal_ns) for interval in sizes[:beyond] + sizes[-beyond:]])
        return LoopTiming(
            nominal_hz=round(1 / self.period_s, 3),
            rate_hz=round(1e9 / mean_ns, 3),
            jitter_ms=round(farthest[-beyond] * 1e-6, 3),
            steps=self.steps,
            misses=self.misses,
        )
