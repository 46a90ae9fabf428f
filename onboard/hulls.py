"""The line that keeps two ways apart: between the hulls of their points. Pure."""

import math
from typing import Final

ROUNDS: Final = 10
"""Of the search for the nearest points of two hulls; three or four are usual."""
TOLERANCE: Final = 2e-3
MEETING_M2: Final = 1e-8

Point = tuple[float, float]
"""x m, y m, arena frame."""
Way = list[Point]


def least(way: Way, away_x: float, away_y: float) -> float:
    """How far along that direction the rearmost point of a way is, m."""
    found = math.inf
    for x, y in way:
        along = x * away_x + y * away_y
        if along < found:
            found = along
    return found


def nearest(mine: Way, theirs: Way) -> tuple[float, float, float, float] | None:
    """The direction from the hull of ``theirs`` to that of ``mine`` in which they are farthest apart.

    :return: its x and y, how far along it mine begins and theirs ends, m; None where the hulls meet.
    """
    x, y = last_x, last_y = mine[0][0] - theirs[0][0], mine[0][1] - theirs[0][1]
    kept: Point | None = None
    for _ in range(ROUNDS):
        square = x * x + y * y
        if square < MEETING_M2:
            return None
        begins, ends = math.inf, -math.inf
        for point in mine:
            along = point[0] * x + point[1] * y
            if along < begins:
                begins, first = along, point
        for point in theirs:
            along = point[0] * x + point[1] * y
            if along > ends:
                ends, last = along, point
        if square - (begins - ends) <= TOLERANCE * square:
            return _scaled(x, y, begins, ends)
        corner_x, corner_y = first[0] - last[0], first[1] - last[1]
        x, y = _towards(corner_x, corner_y, last_x, last_y)
        if kept is not None:
            if _holds_origin(kept, (last_x, last_y), (corner_x, corner_y)):
                return None
            other_x, other_y = _towards(corner_x, corner_y, *kept)
            if other_x * other_x + other_y * other_y <= x * x + y * y:
                x, y = other_x, other_y
                last_x, last_y = kept
        kept = (last_x, last_y)
        last_x, last_y = corner_x, corner_y
    return _scaled(x, y, least(mine, x, y), -least(theirs, -x, -y))


def _scaled(x: float, y: float, begins: float, ends: float) -> tuple[float, float, float, float]:
    length = math.sqrt(x * x + y * y)
    return x / length, y / length, begins / length, ends / length


def _towards(corner_x: float, corner_y: float, other_x: float, other_y: float) -> Point:
    """The point between two that is nearest to the origin."""
    edge_x, edge_y = corner_x - other_x, corner_y - other_y
    square = edge_x * edge_x + edge_y * edge_y
    share = -(other_x * edge_x + other_y * edge_y) / square if square > 0.0 else 0.0
    if share <= 0.0:
        return other_x, other_y
    if share >= 1.0:
        return other_x + edge_x, other_y + edge_y
    return other_x + share * edge_x, other_y + share * edge_y


def _holds_origin(a: Point, b: Point, c: Point) -> bool:
    """Whether the triangle does."""
    ab = a[0] * b[1] - a[1] * b[0]
    bc = b[0] * c[1] - b[1] * c[0]
    ca = c[0] * a[1] - c[1] * a[0]
    return (ab > 0.0 and bc > 0.0 and ca > 0.0) or (ab < 0.0 and bc < 0.0 and ca < 0.0)
