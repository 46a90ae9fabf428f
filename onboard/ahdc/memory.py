"""What a robot remembers of targets: those it has seen, and those it knows to be occupied.

A swarm's memory grows to all targets of a mission. Whatever is asked of it at every step costs no more for that: it is
kept up to date as targets come and go, and looked through by square cells of the floor.
"""

import math
from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from onboard.ahdc.parameters import Vector

CELL_M: Final = 1.0
RINGS: Final = 6
"""Of cells about a robot; what is farther away is looked at all at once."""
FEW: Final = 40
"""So many targets are."""
GRAINS_PER_M: Final = 100_000
"""Positions add up in whole numbers of the wire's grain: the sum is the same however targets came and went."""


@dataclass
class TargetMemory:
    """Targets by index; positions in the arena frame, m."""

    known: dict[int, Vector] = field(default_factory=dict)
    occupied: int = 0
    """Bitmap: bit k for target k."""
    open: dict[int, Vector] = field(default_factory=dict)
    """Known targets that nobody has occupied yet; for reading."""
    _order: list[int] = field(default_factory=list)
    """Indices of the open ones."""
    _cells: dict[tuple[int, int], list[int]] = field(default_factory=dict)
    """Indices of the open ones, by cell."""
    _sum_x: int = 0
    _sum_y: int = 0
    """Of the open ones, in grains."""

    def see(self, index: int, position: Vector) -> None:
        """A target within sensing range, or told of by a neighbour that shares its sightings."""
        before = self.known.get(index)
        if before != position:
            self.known[index] = position
            if self.is_open(index):
                if before is None:
                    insort(self._order, index)
                else:
                    self._lift(index, before)
                self._put(index, position)

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
        new = bitmap & ~self.occupied
        self.occupied |= new
        while new:
            lowest = new & -new
            new ^= lowest
            index = lowest.bit_length() - 1
            if index in self.open:
                self._lift(index, self.open.pop(index))
                del self._order[bisect_left(self._order, index)]

    def is_open(self, index: int) -> bool:
        return not self.occupied >> index & 1

    def after(self, index: int, most: int) -> list[int]:
        """So many open targets of a higher index; where there is none, from the lowest on."""
        start = bisect_right(self._order, index)
        return self._order[start : start + most] or self._order[:most]

    def middle(self) -> Vector:
        """Of the open targets, of which there is one."""
        grains = len(self.open) * GRAINS_PER_M
        return (self._sum_x / grains, self._sum_y / grains)

    def nearest(self, place: Vector) -> Iterator[tuple[float, int]]:
        """Distance, m, and index of the open targets, the nearest first, of equally near ones the lower index.

        Whoever stops early has not paid for the rest.
        """
        i, j = _cell(place)
        left, swept_m = len(self.open), -1.0
        found: list[tuple[float, int]] = []
        for ring in range(RINGS if left > FEW else 0):
            about = [(math.dist(place, self.open[index]), index) for index in self._ring(i, j, ring)]
            left, swept_m = left - len(about), ring * CELL_M
            found = sorted(found + about, reverse=True)
            while found and found[-1][0] <= swept_m:
                yield found.pop()
        if left:
            all_of_them = ((math.dist(place, there), index) for index, there in self.open.items())
            found = sorted((entry for entry in all_of_them if entry[0] > swept_m), reverse=True)
        yield from reversed(found)

    def _ring(self, i: int, j: int, ring: int) -> Iterator[int]:
        """Open targets in the cells around cell (i, j), so many cells away."""
        for di in range(-ring, ring + 1):
            for dj in range(-ring, ring + 1) if abs(di) == ring else (-ring, ring):
                yield from self._cells.get((i + di, j + dj), ())

    def _put(self, index: int, position: Vector) -> None:
        self.open[index] = position
        self._cells.setdefault(_cell(position), []).append(index)
        self._sum_x += round(position[0] * GRAINS_PER_M)
        self._sum_y += round(position[1] * GRAINS_PER_M)

    def _lift(self, index: int, position: Vector) -> None:
        """Out of the cells and the sums."""
        self._cells[_cell(position)].remove(index)
        self._sum_x -= round(position[0] * GRAINS_PER_M)
        self._sum_y -= round(position[1] * GRAINS_PER_M)


def _cell(place: Vector) -> tuple[int, int]:
    return (math.floor(place[0] / CELL_M), math.floor(place[1] / CELL_M))


def to_hex(bitmap: int) -> str:
    return f"{bitmap:x}" if bitmap else ""


def from_hex(text: str) -> int:
    """Bitmap from the wire.

    :raises ValueError: not hexadecimal.
    """
    return int(text, 16) if text else 0
