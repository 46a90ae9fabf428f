"""Judges a lockstep mission from true positions: is the network whole, do robots touch. Pure."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping

from groundstation.grid import Grid

NEAR_M = 0.5
"""Distances above this are not looked at."""
CROWD = 40
"""More robots than this are looked at by cells of the floor, fewer pair by pair."""

Places = Mapping[str, tuple[float, float]]


class Referee:
    """Counts what must not happen, fed with all true positions as often as it should look."""

    def __init__(self, radius_m: float, diameter_m: float) -> None:
        self.disconnected = 0
        """Looks at which the disk graph of radius r_c was in pieces."""
        self.collisions = 0
        """Times a pair came closer than a diameter."""
        self.min_distance_m = math.inf
        self._radius_m = radius_m
        self._diameter_m = diameter_m
        self._touching: set[tuple[str, str]] = set()
        self._tree: list[tuple[str, str]] = []
        self._all_pairs: tuple[list[str], list[tuple[str, str]]] = ([], [])
        """The robots of the last look, where they were few, and every two of them."""

    def look(self, places: Places) -> None:
        """Judge one moment."""
        for pair in self._pairs(places):
            first, second = pair
            x, y = places[first]
            other_x, other_y = places[second]
            dx, dy = other_x - x, other_y - y
            square = dx * dx + dy * dy
            if square < NEAR_M * NEAR_M:
                self._pair(pair, math.sqrt(square))
        if not self._connected(places):
            self.disconnected += 1

    def _pairs(self, places: Places) -> Iterable[tuple[str, str]]:
        """Every two robots that may be near each other, in the order of ``places``."""
        names = list(places)
        if len(names) <= CROWD:
            if names != self._all_pairs[0]:
                self._all_pairs = (names, list(itertools.combinations(names, 2)))
            return self._all_pairs[1]
        return _near_pairs(names, places)

    def _pair(self, pair: tuple[str, str], distance_m: float) -> None:
        if distance_m < self.min_distance_m:
            self.min_distance_m = distance_m
        if distance_m >= self._diameter_m:
            if self._touching:
                self._touching.discard(pair)
        elif pair not in self._touching:
            self._touching.add(pair)
            self.collisions += 1

    def _connected(self, places: Places) -> bool:
        """Whether the tree that joined them last still does, or another."""
        if len(self._tree) == len(places) - 1:
            for a, b in self._tree:
                if math.dist(places[a], places[b]) > self._radius_m:
                    break
            else:
                return True
        names = list(places)
        grid = Grid(places, self._radius_m) if len(names) > CROWD else None
        inside, frontier, tree = {names[0]}, [names[0]], []
        while frontier:
            first = frontier.pop()
            for second in grid.around(grid.cell(places[first])) if grid is not None else names:
                if second not in inside and math.dist(places[first], places[second]) <= self._radius_m:
                    inside.add(second)
                    frontier.append(second)
                    tree.append((first, second))
        self._tree = tree
        return len(inside) == len(names)


def _near_pairs(names: list[str], places: Places) -> Iterator[tuple[str, str]]:
    grid = Grid(places, NEAR_M)
    order = {name: k for k, name in enumerate(names)}
    for first in names:
        for second in grid.around(grid.cell(places[first])):
            if order[first] < order[second]:
                yield first, second
