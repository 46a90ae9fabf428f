"""Robots by square cells of the floor: who may be near whom, without looking at every pair. Pure."""

import math
from collections.abc import Mapping
from functools import cache

Cell = tuple[int, int]


class Grid:
    """Names by cell; each cell keeps the order of ``places``."""

    def __init__(self, places: Mapping[str, tuple[float, ...]], cell_m: float) -> None:
        self._cell_m = cell_m
        self._cells: dict[Cell, list[str]] = {}
        for name, place in places.items():
            self._cells.setdefault(self.cell(place), []).append(name)

    def cell(self, place: tuple[float, ...]) -> Cell:
        """Of a place, x and y in metres first."""
        return (math.floor(place[0] / self._cell_m), math.floor(place[1] / self._cell_m))

    def within(self, cell: Cell, reach_m: float) -> list[str]:
        """Everybody within that distance of any place in the cell, and more."""
        x, y = cell
        cells = self._cells
        return [name for i, j in _disc(reach_m / self._cell_m) for name in cells.get((x + i, y + j), ())]


@cache
def _disc(reach: float) -> tuple[Cell, ...]:
    """Cells of which a place may be that near to one in cell (0, 0), in cells."""
    span = range(-math.floor(reach) - 1, math.floor(reach) + 2)
    return tuple((i, j) for i in span for j in span if math.hypot(max(0, abs(i) - 1), max(0, abs(j) - 1)) < reach)
