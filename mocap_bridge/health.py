"""How the pose stream is: rate, silence, latency, faults, as one MocapHealth message. Pure."""

import statistics
from collections import deque
from typing import Literal

from contract.messages import BodyHealth, MocapHealth
from mocap_bridge.checks import REASONS
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus
from mocap_bridge.track import Track

WINDOW_NS = 1_000_000_000
DEGRADED_PERIODS = 3.0
STALE_NS = 100_000_000
LOST_NS = 500_000_000
RATE_TOLERANCE = 0.10
LATENCY_WARN_MS = 20.0
LATENCY_ERROR_MS = 100.0
CLOCK_WARN_MS = 2.0

State = Literal["connecting", "ok", "degraded", "stale", "lost", "refused"]


class Health:
    """Watches one stream; ``nominal_rate_hz`` is the arena file's, used where the source says none."""

    def __init__(self, nominal_rate_hz: float) -> None:
        self._nominal_hz = nominal_rate_hz
        self._received: deque[int] = deque()
        self._latency_ms: deque[float] = deque()
        self._last: SourceFrame | None = None

    def frame(self, frame: SourceFrame, publish_ns: int) -> None:
        """A frame has been published."""
        if self._last is not None and frame.session != self._last.session:
            self._received.clear()
            self._latency_ms.clear()
        self._last = frame
        self._received.append(frame.received_ns)
        self._latency_ms.append((publish_ns - frame.exposure_ns) * 1e-6)
        self._trim(frame.received_ns)

    def _trim(self, now_ns: int) -> None:
        while self._received and now_ns - self._received[0] > WINDOW_NS:
            self._received.popleft()
            self._latency_ms.popleft()

    @property
    def rate_hz(self) -> float:
        """Frames a second over the window, 0 until two have come."""
        times = self._received
        if len(times) < 2 or times[-1] <= times[0]:
            return 0.0
        return min(round((len(times) - 1) * 1e9 / (times[-1] - times[0]), 2), 2000.0)

    def nominal_hz(self, status: SourceStatus) -> float:
        """The source's own rate, else the arena file's."""
        return status.nominal_rate_hz or self._nominal_hz

    def state(self, status: SourceStatus, now_ns: int) -> tuple[State, str]:
        """The state and what is wrong, with the remedy, in words."""
        if status.phase == "refused":
            return "refused", status.problem
        if self._last is None:
            return "connecting", status.problem or f"{status.name}: waiting ({status.phase})"
        silence_ns = now_ns - self._last.received_ns
        period_ns = 1e9 / self.nominal_hz(status)
        if silence_ns > max(LOST_NS, 5.0 * period_ns):
            return "lost", f"no frame for {silence_ns * 1e-9:.1f} s: check server, cable and network ({status.phase})"
        if silence_ns > max(STALE_NS, 4.0 * period_ns):
            return "stale", f"no frame for {silence_ns * 1e-6:.0f} ms"
        if silence_ns > DEGRADED_PERIODS * period_ns:
            return "degraded", f"no frame for {silence_ns / period_ns:.0f} frame periods"
        warning = self._warning(status, now_ns)
        return ("degraded", warning) if warning else ("ok", "")

    def _warning(self, status: SourceStatus, now_ns: int) -> str:
        if status.problem:
            return status.problem
        if status.phase != STEADY:
            return f"{status.name}: {status.phase}"
        nominal, rate = self.nominal_hz(status), self.rate_hz
        settled = len(self._received) > 1 and self._received[-1] - self._received[0] > 0.8 * WINDOW_NS
        if settled and abs(rate - nominal) > RATE_TOLERANCE * nominal:
            return f"{rate:.0f} frames/s, {nominal:g} nominal: frames are lost, or the source's rate differs"
        if warning := self._latency_warning():
            return warning
        if self.clock_error_ms > CLOCK_WARN_MS:
            return f"clock of the source known to {self.clock_error_ms:.1f} ms only: a slow or busy network"
        return ""

    def _latency_warning(self) -> str:
        newest = self._latency_ms
        if not newest or (-self.clock_error_ms <= min(newest) and max(newest) <= LATENCY_WARN_MS):
            return ""
        latency_ms = self.latency_ms
        if latency_ms > LATENCY_WARN_MS:
            grave = "far too old to drive on" if latency_ms > LATENCY_ERROR_MS else "high"
            return f"{latency_ms:.0f} ms from exposure to publication: {grave}"
        if latency_ms < -self.clock_error_ms:
            return f"frames from {-latency_ms:.1f} ms ahead of now: the clock is wrong"
        return ""

    @property
    def latency_ms(self) -> float:
        """Mid-exposure to publication, median over the window."""
        return statistics.median(self._latency_ms) if self._latency_ms else 0.0

    @property
    def clock_error_ms(self) -> float:
        """Bound on the error of the last frame's stamps."""
        return self._last.clock_error_ns * 1e-6 if self._last else 0.0

    def message(self, status: SourceStatus, tracks: list[Track], session: int, now_ns: int) -> MocapHealth:
        """The whole health record."""
        self._trim(now_ns)
        state, detail = self.state(status, now_ns)
        return MocapHealth(
            stamp_ns=now_ns,
            state=state,
            detail=detail[:400],
            source=status.name[:64],
            session=session,
            frame=self._last.number if self._last else 0,
            rate_hz=self.rate_hz,
            nominal_rate_hz=self.nominal_hz(status),
            frames_dropped=status.frames_dropped,
            malformed=status.malformed,
            latency_ms=round(self.latency_ms, 3),
            clock_error_ms=round(self.clock_error_ms, 3),
            counters=dict(status.counters),
            bodies=tuple(_body(track, status) for track in tracks),
        )


def _body(track: Track, status: SourceStatus) -> BodyHealth:
    reason = track.reason
    if reason == "missing" and track.body in status.duplicate_names:
        reason = "duplicate_name"
    elif reason == "missing" and track.body in status.duplicate_ids:
        reason = "duplicate_id"
    elif reason == "missing" and status.names and track.body not in status.names:
        reason = "not_in_model_list"
    return BodyHealth(robot=track.robot, valid=not track.reason, reason=reason, faults=dict(track.faults))


BODY_REASONS = {
    **REASONS,
    "duplicate_name": "more than one body of the source has this name",
    "duplicate_id": "another body of the source has the same streaming id",
    "not_in_model_list": "the source has no body of this name",
}
"""Reasons that :attr:`contract.messages.BodyHealth.reason` can have."""
