"""Judges a lockstep mission from true positions: is the network whole, do robots touch. Pure."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping

from groundstation.grid import Grid

NEAR_M = 0.5
"""Distances above this are not looked at."""
CROWD = 40
"""More robots than this are looked at by cells of the floor, fewer pair by pair."""
STIR_M = 0.03
"""Until a robot has moved this far in x or y since everybody was looked at, only what can have changed is."""
DRIFT_M = 2 * math.sqrt(2) * STIR_M + 1e-9
"""What the distance of two robots can change by meanwhile."""

Places = Mapping[str, tuple[float, float]]
Pair = tuple[str, str]


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
        self._touching: set[Pair] = set()
        self._tree: list[Pair] = []
        self._joined: list[str] = []
        """Whom the tree joins."""
        self._crew: list[str] = []
        self._boxes: list[tuple[float, float, float, float]] = []
        """Where each of the crew may be, x low and high, y low and high, with nothing changed but what is watched."""
        self._close: list[Pair] = []
        """Pairs that may come nearer than any before, touch, or part."""
        self._stretched: list[Pair] = []
        """Edges of the tree that may tear."""
        self._all_pairs: tuple[list[str], list[Pair]] = ([], [])
        """The robots of the last look, where they were few, and every two of them."""

    def look(self, places: Places) -> None:
        """Judge one moment."""
        if self._calm(places):
            self._judge(self._close, places)
            if self._holds(self._stretched, places):
                return
        else:
            self._touching = {pair for pair in self._touching if self._touch(pair, places)}
            self._judge(self._pairs(places), places)
        self._crew = []
        if not self._connected(places):
            self.disconnected += 1
            return
        least_m = max(min(self.min_distance_m, NEAR_M), self._diameter_m) + DRIFT_M
        self._close = [(a, b) for a, b in self._pairs(places) if math.dist(places[a], places[b]) < least_m]
        taut_m = self._radius_m - DRIFT_M
        self._stretched = [(a, b) for a, b in self._tree if math.dist(places[a], places[b]) > taut_m]
        self._crew = list(places)
        self._boxes = [(x - STIR_M, x + STIR_M, y - STIR_M, y + STIR_M) for x, y in places.values()]

    def _calm(self, places: Places) -> bool:
        """Whether the same robots are about where everybody was looked at."""
        if list(places) != self._crew:
            return False
        for (x, y), (low_x, high_x, low_y, high_y) in zip(places.values(), self._boxes, strict=True):
            if not (low_x < x < high_x and low_y < y < high_y):
                return False
        return True

    def _judge(self, pairs: Iterable[Pair], places: Places) -> None:
        for pair in pairs:
            first, second = pair
            x, y = places[first]
            other_x, other_y = places[second]
            dx, dy = other_x - x, other_y - y
            square = dx * dx + dy * dy
            if square < NEAR_M * NEAR_M:
                self._pair(pair, math.sqrt(square))

    def _pairs(self, places: Places) -> Iterable[Pair]:
        """Every two robots that may be near each other, in the order of ``places``."""
        names = list(places)
        if len(names) <= CROWD:
            if names != self._all_pairs[0]:
                self._all_pairs = (names, list(itertools.combinations(names, 2)))
            return self._all_pairs[1]
        return _near_pairs(names, places)

    def _pair(self, pair: Pair, distance_m: float) -> None:
        if distance_m < self.min_distance_m:
            self.min_distance_m = distance_m
        if distance_m >= self._diameter_m:
            if self._touching:
                self._touching.discard(pair)
        elif pair not in self._touching:
            self._touching.add(pair)
            self.collisions += 1

    def _touch(self, pair: Pair, places: Places) -> bool:
        first, second = pair
        return first in places and second in places and math.dist(places[first], places[second]) < self._diameter_m

    def _holds(self, edges: Iterable[Pair], places: Places) -> bool:
        radius_m = self._radius_m
        return all(math.dist(places[a], places[b]) <= radius_m for a, b in edges)

    def _connected(self, places: Places) -> bool:
        """Whether the tree that joined them last still does, or another."""
        names = list(places)
        if self._joined == names and self._holds(self._tree, places):
            return True
        grid = Grid(places, self._radius_m) if len(names) > CROWD else None
        inside, frontier, tree = {names[0]}, [names[0]], []
        while frontier:
            first = frontier.pop()
            for second in grid.around(grid.cell(places[first])) if grid is not None else names:
                if second not in inside and math.dist(places[first], places[second]) <= self._radius_m:
                    inside.add(second)
                    frontier.append(second)
                    tree.append((first, second))
        whole = len(inside) == len(names)
        self._tree, self._joined = tree, names if whole else []
        return whole


def _near_pairs(names: list[str], places: Places) -> Iterator[Pair]:
    grid = Grid(places, NEAR_M + DRIFT_M)
    order = {name: k for k, name in enumerate(names)}
    for first in names:
        for second in grid.around(grid.cell(places[first])):
            if order[first] < order[second]:
                yield first, second
