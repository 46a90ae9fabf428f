"""Does a serial line carry one control period's traffic?"""

from typing import NamedTuple, Protocol

BITS_PER_BYTE = 10
"""8N1: start bit, eight data bits, stop bit."""
USABLE = 0.8
"""Share of the control period the wire may be busy."""


class Load(Protocol):
    """One control period's traffic on some wire; as a string, the arithmetic."""

    @property
    def fits(self) -> bool: ...


class Bandwidth(NamedTuple):
    """Wire time of one control period."""

    bytes_per_cycle: int
    baud: int
    period_s: float
    extra_s: float = 0.0
    """Device turn-around a cycle."""

    @property
    def busy_s(self) -> float:
        return self.bytes_per_cycle * BITS_PER_BYTE / self.baud + self.extra_s

    @property
    def fits(self) -> bool:
        return self.busy_s <= USABLE * self.period_s

    def __str__(self) -> str:
        """The arithmetic in words."""
        return (
            f"{self.bytes_per_cycle} bytes x {BITS_PER_BYTE} bits / {self.baud} baud = {self.busy_s * 1e3:.1f} ms "
            f"a cycle, {'more' if not self.fits else 'less'} than {USABLE:.0%} of the {self.period_s * 1e3:.1f} ms "
            f"period ({1 / self.period_s:.0f} Hz)"
        )
