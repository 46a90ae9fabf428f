"""What the wheels have been asked, and how much of it they can have heard. Pure.

A robot whose wheels are silent may have been cut off: then they do what they were asked before, whatever it commands.
Neighbours keep clear of what a robot tells them, so it tells the command that its wheels answered last.
"""

from typing import Final

DOUBT_NS: Final = 50_000_000
"""Wheels silent for longer may hear nothing either."""

Rims = tuple[float, float]
"""Rim speeds, left and right, m/s."""


class Asked:
    """The last command, and the last that stood when the wheels were heard."""

    def __init__(self) -> None:
        self.latest: Rims = (0.0, 0.0)
        self._answered: Rims = (0.0, 0.0)
        self._heard_ns = 0

    def command(self, left_mps: float, right_mps: float) -> None:
        """Asked from now on."""
        self.latest = (left_mps, right_mps)

    def feedback(self, stamp_ns: int) -> None:
        """The wheels were heard; what was measured no later than before says nothing new."""
        if stamp_ns > self._heard_ns:
            self._heard_ns = stamp_ns
            self._answered = self.latest

    def silent(self, now_ns: int) -> bool:
        """Whether the wheels may hear nothing."""
        return now_ns - self._heard_ns > DOUBT_NS

    def standing(self, now_ns: int) -> Rims:
        """What the wheels follow, as far as they are known to hear."""
        return self._answered if self.silent(now_ns) else self.latest

    def silence_s(self, now_ns: int) -> float:
        """Since the wheels were heard."""
        return (now_ns - self._heard_ns) * 1e-9
