"""Order of frames: gaps, duplicates, latecomers, and a source that has started anew. Pure."""

from typing import Literal

Order = Literal["new", "duplicate", "old", "restart"]

LATE_S = 1.0
"""A frame behind by more than this is not late: the source has restarted."""
BACKWARDS_NS = 100_000_000
"""So long with nothing but old frames means a restart, too."""


class Sequence:
    """Judges each frame by its number and the source's own time in seconds."""

    def __init__(self) -> None:
        self.dropped = 0
        """Frames that never came, or came too late."""
        self._number = -1
        self._time_s = 0.0
        self._old_since_ns: int | None = None

    def judge(self, number: int, time_s: float, received_ns: int) -> Order:
        """Whether the frame is the next, a copy, a latecomer (discard both) or the first after a restart.

        After ``restart`` begin a new Sequence.
        """
        if self._number < 0:
            self._advance(number, time_s)
            return "new"
        ahead, elapsed_s = number - self._number, time_s - self._time_s
        if elapsed_s < -LATE_S or (ahead < 0 and elapsed_s >= 0.0) or (ahead > 0 and elapsed_s < 0.0):
            return "restart"
        if ahead > 0:
            self.dropped += ahead - 1
            self._advance(number, time_s)
            return "new"
        if ahead == 0:
            return "duplicate"
        if self._old_since_ns is None:
            self._old_since_ns = received_ns
        return "restart" if received_ns - self._old_since_ns > BACKWARDS_NS else "old"

    def _advance(self, number: int, time_s: float) -> None:
        self._number = number
        self._time_s = time_s
        self._old_since_ns = None
