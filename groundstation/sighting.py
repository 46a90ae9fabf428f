"""The swarm as motion capture sees it: places, pieces, algebraic connectivity, and who is away from its start. Pure."""

import math
from collections.abc import Collection, Mapping

from contract.arena import Arena
from contract.messages import MocapFrame
from contract.units import Point
from groundstation.connectivity import components, disk_graph, summary

MISPLACED_M = 0.10
"""Farther from its start than this, a robot is said to be elsewhere."""


def misplaced(arena: Arena, places: Mapping[str, Point]) -> list[str]:
    """Where each robot seen away from its start belongs, in words."""
    words = []
    for name, robot in arena.robots.items():
        place = places.get(name)
        if place is not None and (away_m := math.dist(place, robot.start)) > MISPLACED_M:
            words.append(f"{name} belongs at x {robot.start[0]:.2f}, y {robot.start[1]:.2f}, {away_m:.2f} m away")
    return words


class Sighting:
    """What the newest frame shows."""

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self.frame_ns = 0
        """Arrival of the newest frame; 0: none yet."""
        self.places: dict[str, Point] = {}
        """Of every robot ever seen, the newest, m."""
        self.seen: frozenset[str] = frozenset()
        """Robots valid in the newest frame."""
        self.points: list[Point] = []
        """The crew's in the newest frame, m."""
        self.lambda2, self.components = 0.0, 0
        """Of the crew's disk graph."""

    def look(self, frame: MocapFrame, crew: Collection[str], now_ns: int) -> None:
        """A new frame."""
        self.frame_ns = now_ns
        seen = {b.robot: (b.x_m, b.y_m) for b in frame.bodies if b.valid and b.robot in self._arena.robots}
        self.places |= seen
        self.seen = frozenset(seen)
        self.points = [place for name, place in seen.items() if name in crew]
        self.lambda2, self.components = summary(self.points, self._arena.control.sensing_radius_m)

    @property
    def nearest_m(self) -> float:
        """Least distance between two of the crew; 0 where fewer are seen."""
        points = self.points
        return min((math.dist(a, b) for i, a in enumerate(points) for b in points[i + 1 :]), default=0.0)

    def left_behind(self, crew: Collection[str]) -> str:
        """The pieces of the crew that remain where they are last seen, in words."""
        radius_m = self._arena.control.sensing_radius_m
        names = [name for name in crew if name in self.places]
        pieces = components(len(names), disk_graph([self.places[name] for name in names], radius_m))
        if len(pieces) < 2:
            return "the others are one piece"
        return "they part into " + " and ".join(", ".join(names[k] for k in piece) for piece in pieces)
