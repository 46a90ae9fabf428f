"""Judges a lockstep mission from true positions: is the network whole, do robots touch. Pure."""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping

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
        self._ties: dict[Pair, None] = {}
        """Pairs within r_c at the last look that together join everybody in ``_joined``."""
        self._joined: list[str] = []
        self._crew: list[str] = []
        self._boxes: list[tuple[float, float, float, float]] = []
        """Where each of the crew may be, x low and high, y low and high, with nothing changed but what is watched."""
        self._close: list[Pair] = []
        """Pairs that may come nearer than any before, touch, or part."""
        self._stretched: dict[Pair, None] = {}
        """Ties that may tear."""
        self._around: Callable[[str], list[str]] = lambda _: []
        """Robots about one, and more, as they were when everybody was looked at."""
        self._all_pairs: tuple[list[str], list[Pair]] = ([], [])
        """The robots of the last look, where they were few, and every two of them."""

    def look(self, places: Places) -> None:
        """Judge one moment."""
        if self._calm(places):
            self._judge(self._close, places)
            if self._tied(self._stretched, places):
                return
            near = self._pairs(places)
        else:
            self._touching = {pair for pair in self._touching if self._touch(pair, places)}
            near = self._pairs(places)
            self._judge(near, places)
        self._crew = []
        if not self._connected(places):
            self.disconnected += 1
            return
        least_m = max(min(self.min_distance_m, NEAR_M), self._diameter_m) + DRIFT_M
        self._close = [(a, b) for a, b in near if math.dist(places[a], places[b]) < least_m]
        taut_m = self._radius_m - DRIFT_M
        self._stretched = {(a, b): None for a, b in self._ties if math.dist(places[a], places[b]) > taut_m}
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

    def _pairs(self, places: Places) -> list[Pair]:
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

    def _tied(self, ties: dict[Pair, None], places: Places) -> bool:
        """Whether all these hold, where two others through a third robot have taken the place of one that has torn."""
        radius_m = self._radius_m
        torn = [(a, b) for a, b in ties if math.dist(places[a], places[b]) > radius_m]
        for a, b in torn:
            for third in self._around(a):
                if max(math.dist(places[a], places[third]), math.dist(places[third], places[b])) <= radius_m:
                    del self._ties[a, b]
                    self._stretched.pop((a, b), None)
                    self._ties.update(detour := {(a, third): None, (third, b): None})
                    self._stretched.update(detour)
                    break
            else:
                return False
        return True

    def _connected(self, places: Places) -> bool:
        """Whether the ties that joined them last still do, or others."""
        names = list(places)
        self._around = self._surroundings(places)
        if self._joined == names and len(self._ties) < 2 * len(names) and self._tied(self._ties, places):
            return True
        inside, frontier = {names[0]}, [names[0]]
        ties: dict[Pair, None] = {}
        while frontier:
            first = frontier.pop()
            for second in self._around(first):
                if second not in inside and math.dist(places[first], places[second]) <= self._radius_m:
                    inside.add(second)
                    frontier.append(second)
                    ties[first, second] = None
        whole = len(inside) == len(names)
        self._ties, self._joined = ties, names if whole else []
        return whole

    def _surroundings(self, places: Places) -> Callable[[str], list[str]]:
        """Who may be within r_c of a robot until somebody has moved far."""
        names = list(places)
        if len(names) <= CROWD:
            return lambda _: names
        reach_m = self._radius_m + DRIFT_M
        grid = Grid(places, reach_m)
        cells = {name: grid.cell(place) for name, place in places.items()}
        return lambda name: grid.within(cells[name], reach_m)


def _near_pairs(names: list[str], places: Places) -> list[Pair]:
    reach_m = NEAR_M + DRIFT_M
    grid = Grid(places, reach_m)
    order = {name: k for k, name in enumerate(names)}
    return [
        (first, second)
        for first in names
        for second in grid.within(grid.cell(places[first]), reach_m)
        if order[first] < order[second]
    ]
