"""A mission's targets by square cells of the floor: which are near, without looking at all of them. Pure."""

import math
from collections.abc import Sequence
from typing import Final

from contract.messages import Target

CELL_M: Final = 1.0

Placed = tuple[int, tuple[float, float]]
"""Index, and where it is, m."""


class Cloud:
    """Targets by cell; an index told twice is where it was told last."""

    def __init__(self, targets: Sequence[Target]) -> None:
        self._cells: dict[tuple[int, int], list[tuple[int, Placed]]] = {}
        places = {target.index: (target.x_m, target.y_m) for target in targets}
        for order, (index, place) in enumerate(places.items()):
            cell = (math.floor(place[0] / CELL_M), math.floor(place[1] / CELL_M))
            self._cells.setdefault(cell, []).append((order, (index, place)))

    def about(self, x_m: float, y_m: float, reach_m: float) -> list[Placed]:
        """Targets at most ``reach_m`` away in x and in y, in the order of the cloud; none of what is nowhere."""
        if not math.isfinite(x_m + y_m):
            return []
        found: list[tuple[int, Placed]] = []
        for i in range(math.floor((x_m - reach_m) / CELL_M), math.floor((x_m + reach_m) / CELL_M) + 1):
            for j in range(math.floor((y_m - reach_m) / CELL_M), math.floor((y_m + reach_m) / CELL_M) + 1):
                for entry in self._cells.get((i, j), ()):
                    x, y = entry[1][1]
                    if abs(x - x_m) <= reach_m and abs(y - y_m) <= reach_m:
                        found.append(entry)
        found.sort()
        return [placed for _, placed in found]


_told: list[tuple[Sequence[Target], Cloud]] = [((), Cloud(()))]


def cells_of(targets: Sequence[Target]) -> Cloud:
    """The cells of those targets; the last ones are kept, since a station repeats them and a simulation's robots share
    them."""
    known = _told[0]
    if known[0] is not targets:
        known = _told[0] = (targets, Cloud(targets))
    return known[1]
