"""Does a CAN bus carry one control period's traffic?"""

from collections.abc import Sequence
from typing import NamedTuple

from drivers.bandwidth import USABLE
from drivers.can.frame import CanFrame


def worst_bits(length: int, extended: bool) -> int:
    """Bits of a data frame with every possible stuff bit and the interframe space.

    ``g + 8 s + 13 + floor((g + 8 s - 1) / 4)``, g = 34 (11-bit identifier) or 54 (29-bit), s payload
    bytes: Davis, Burns, Bril and Lukkien, "Controller Area Network (CAN) schedulability analysis:
    Refuted, revisited and revised", Real-Time Systems 35 (2007), eq. 1.
    """
    stuffed = (54 if extended else 34) + 8 * length
    return stuffed + 13 + (stuffed - 1) // 4


class BusLoad(NamedTuple):
    """Bus time of one control period: what this computer sends and what the devices send by themselves."""

    frames: Sequence[CanFrame]
    """Of one period, both directions; payloads count by their length only."""
    bitrate: int
    period_s: float

    @property
    def bits(self) -> int:
        return sum(worst_bits(frame.length, frame.extended) for frame in self.frames)

    @property
    def fits(self) -> bool:
        return self.bits / self.bitrate <= USABLE * self.period_s

    def __str__(self) -> str:
        """The arithmetic in words."""
        busy_s = self.bits / self.bitrate
        return (
            f"{len(self.frames)} frames of {self.bits} bits (stuffed) / {self.bitrate} bit/s = {busy_s * 1e3:.1f} ms "
            f"a cycle, {'more' if not self.fits else 'less'} than {USABLE:.0%} of the {self.period_s * 1e3:.1f} ms "
            f"period ({1 / self.period_s:.0f} Hz)"
        )
