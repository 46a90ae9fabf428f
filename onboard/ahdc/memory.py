"""What a robot remembers of targets: those it has seen, and those it knows to be occupied."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from onboard.ahdc.parameters import Vector


@dataclass
class TargetMemory:
    """Targets by index; positions in the arena frame, m."""

    known: dict[int, Vector] = field(default_factory=dict)
    occupied: int = 0
    """Bitmap: bit k for target k."""
    _open: dict[int, Vector] | None = None

    def see(self, index: int, position: Vector) -> None:
        """A target within sensing range, or told of by a neighbour that shares its sightings."""
        if self.known.get(index) != position:
            self.known[index] = position
            self._open = None

    def see_all(self, targets: Mapping[int, Vector]) -> None:
        """Every target within sensing range."""
        known = self.known
        for index, position in targets.items():
            if known.get(index) != position:
                self.see(index, position)

    def occupy(self, index: int) -> None:
        self.merge(1 << index)

    def merge(self, bitmap: int) -> None:
        """Learn of occupied targets; the set only grows."""
        if bitmap & ~self.occupied:
            self.occupied |= bitmap
            self._open = None

    def is_open(self, index: int) -> bool:
        return not self.occupied >> index & 1

    def open(self) -> dict[int, Vector]:
        """Known targets that nobody has occupied yet."""
        if self._open is None:
            self._open = {k: position for k, position in self.known.items() if self.is_open(k)}
        return self._open


def to_hex(bitmap: int) -> str:
    return f"{bitmap:x}" if bitmap else ""


def from_hex(text: str) -> int:
    """Bitmap from the wire.

    :raises ValueError: not hexadecimal.
    """
    return int(text, 16) if text else 0
