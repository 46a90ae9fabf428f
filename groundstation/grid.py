"""Robots by square cells of the floor: who may be near whom, without looking at every pair. Pure."""

import math
from collections.abc import Mapping

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

    def around(self, cell: Cell, rings: int = 1) -> list[str]:
        """Everybody in the cell and in so many rings of cells about it."""
        x, y = cell
        cells = self._cells
        span = range(-rings, rings + 1)
        return [name for i in span for j in span for name in cells.get((x + i, y + j), ())]
