"""In which order robots can reach start poses that lie too near to each other to pass between, and where to wait. Pure.

Robots at rest are discs that others go round (:mod:`onboard.homing`). A robot that has a free way out while every
start is taken is of the last wave; without those, others have a way out: they come before. Ways are looked for on a
lattice of :data:`STEP_M`, inside the fence.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from itertools import combinations

from contract.arena import Arena
from contract.units import Point

ROOM_M = 0.045
"""Added to ``safety.min_distance_m``: centres pass a resting robot at this distance."""
CLEAR_M = 0.45
"""Nearer to a start than this, a robot that waits is in the way."""
APART_M = 0.40
"""Between robots that wait."""
STEP_M = 0.02
REACH_M = 0.3
"""Farther from all starts than this, the floor is taken to be open."""
WAIT_STEP_M = 0.1

Cell = tuple[int, int]


class NoWay(ValueError):
    """Start poses that cannot all be taken; the text says which and why."""


@lru_cache(maxsize=8)
def waves(starts: tuple[tuple[str, Point], ...], fence: tuple[float, float, float, float], disc_m: float) -> "Waves":
    """Robots in the order in which they may go home: those of a wave together, each wave when the last is home.

    :param fence: x low, y low, x high, y high, m.
    :param disc_m: least distance of centres to pass a resting robot.
    :raises NoWay: some start has no way in, whatever the order.
    """
    left = dict(starts)
    if all(math.dist(a, b) >= 2 * disc_m for a, b in combinations(left.values(), 2)):
        return (tuple(left),)
    found: list[tuple[str, ...]] = []
    while left:
        lattice = _Lattice(left, fence, disc_m)
        free = tuple(name for name in left if lattice.has_way_out(name))
        if not lattice.has_floor:
            raise NoWay(
                f"no floor is left {REACH_M:g} m away from the starts; set them 0.40 m apart, or the floor larger"
            )
        if not free:
            raise NoWay(_stuck(left, disc_m))
        found.insert(0, free)
        for name in free:
            del left[name]
    return tuple(found)


Waves = tuple[tuple[str, ...], ...]


def waves_of(arena: Arena) -> Waves:
    """:func:`waves` of an arena file's starts.

    :raises NoWay: as there.
    """
    floor = arena.arena
    fence = (floor.fence_m, floor.fence_m, floor.size_m[0] - floor.fence_m, floor.size_m[1] - floor.fence_m)
    starts = tuple((name, robot.start) for name, robot in arena.robots.items())
    return waves(starts, fence, arena.safety.min_distance_m + ROOM_M)


def _stuck(starts: Mapping[str, Point], disc_m: float) -> str:
    (a, place), (b, other) = min(combinations(starts.items(), 2), key=lambda pair: math.dist(pair[0][1], pair[1][1]))
    gap_m = math.dist(place, other)
    return (
        f"no order in which all reach their starts: {a} and {b} start {gap_m:.2f} m apart, and robots at rest are "
        f"passed at {disc_m:.2f} m; set starts farther apart, 0.40 m for no waiting"
    )


class _Lattice:
    """Places inside the fence and who stands too near to each."""

    def __init__(self, starts: Mapping[str, Point], fence: tuple[float, float, float, float], disc_m: float) -> None:
        self._starts = starts
        self._fence = fence
        self._near: dict[Cell, set[str]] = {}
        self._about: set[Cell] = set()
        """Cells within reach of some start; beyond them all is open."""
        for name, place in starts.items():
            for cell, distance_m in self._around(place, REACH_M):
                self._about.add(cell)
                if distance_m < disc_m:
                    self._near.setdefault(cell, set()).add(name)
        self._open = self._flood()

    def _around(self, place: Point, radius_m: float) -> Iterator[tuple[Cell, float]]:
        low = [math.floor((x - radius_m) / STEP_M) for x in place]
        high = [math.ceil((x + radius_m) / STEP_M) for x in place]
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                distance_m = math.dist((i * STEP_M, j * STEP_M), place)
                if distance_m <= radius_m and self._inside((i, j)):
                    yield (i, j), distance_m

    def _inside(self, cell: Cell) -> bool:
        x_m, y_m = cell[0] * STEP_M, cell[1] * STEP_M
        low_x, low_y, high_x, high_y = self._fence
        return low_x - 1e-9 <= x_m <= high_x + 1e-9 and low_y - 1e-9 <= y_m <= high_y + 1e-9

    def _flood(self) -> set[Cell]:
        """Cells near starts, free of all discs, with a way to the open floor."""
        edge = [c for c in self._about if c not in self._near and any(self._is_open(n) for n in _beside(c))]
        found = set(edge)
        while edge:
            for cell in _beside(edge.pop()):
                if cell in self._about and cell not in self._near and cell not in found:
                    found.add(cell)
                    edge.append(cell)
        return found

    @property
    def has_floor(self) -> bool:
        """Whether any start borders on open floor."""
        return any(self._is_open(near) for cell in self._about for near in _beside(cell))

    def _is_open(self, cell: Cell) -> bool:
        return cell not in self._about and self._inside(cell)

    def has_way_out(self, name: str) -> bool:
        """From a start to the open floor while every other start is taken."""
        x_m, y_m = self._starts[name]
        begin = (round(x_m / STEP_M), round(y_m / STEP_M))
        own = {name}
        edge, found = [begin], {begin}
        while edge:
            cell = edge.pop()
            if cell in self._open or self._is_open(cell):
                return True
            for near in _beside(cell):
                if near not in found and near in self._about and self._near.get(near, own) <= own:
                    found.add(near)
                    edge.append(near)
        return False


def _beside(cell: Cell) -> tuple[Cell, Cell, Cell, Cell]:
    i, j = cell
    return (i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)


def aside(arena: Arena, places: Mapping[str, Point], waiting: Collection[str]) -> dict[str, Point]:
    """Where robots wait that are not to go home yet: as near as may be, clear of every start and of each other.

    :param places: where all robots are.
    :raises NoWay: no room is left for one.
    """
    starts = [robot.start for robot in arena.robots.values()]
    found = {name: places[name] for name in waiting if _gap_m(places[name], starts) >= CLEAR_M}
    others = [place for name, place in places.items() if name not in waiting]
    (width_m, height_m), edge_m = arena.arena.size_m, arena.arena.fence_m + WAIT_STEP_M
    columns = math.floor((width_m - 2 * edge_m) / WAIT_STEP_M)
    rows = math.floor((height_m - 2 * edge_m) / WAIT_STEP_M)
    free = [
        place
        for i in range(columns + 1)
        for j in range(rows + 1)
        if _gap_m(place := (edge_m + i * WAIT_STEP_M, edge_m + j * WAIT_STEP_M), starts) >= CLEAR_M
    ]
    for name in waiting:
        if name in found:
            continue
        taken = [*found.values(), *others]
        room = [place for place in free if _gap_m(place, taken) >= APART_M]
        if not room:
            raise NoWay(f"no room for {name} to wait {CLEAR_M:g} m away from the starts; carry it to its start")
        best = min(room, key=lambda place: (math.dist(place, places[name]), place))
        found[name] = (round(best[0], 3), round(best[1], 3))
    return found


def _gap_m(place: Point, others: Collection[Point]) -> float:
    return min((math.dist(place, other) for other in others), default=math.inf)
