"""Where a free robot stands to hold the network together: between those that pull it apart."""

import math
from collections.abc import Sequence
from typing import Final

from contract.messages import NeighbourState
from onboard.ahdc.parameters import Vector
from onboard.ahdc.view import View

HALVES: Final = 20
"""Steps of the search for the middle; it ends within about a twentieth of the circle's radius."""


def linked(state: NeighbourState, robot: str) -> bool:
    """Whether the one that says this keeps a link with that robot."""
    return robot in state.links_on or robot in state.links_kept


def middle(points: Sequence[Vector]) -> Vector:
    """Nearly the centre of the smallest circle round the points: each step goes towards the farthest one."""
    x = sum(point[0] for point in points) / len(points)
    y = sum(point[1] for point in points) / len(points)
    for step in range(2, HALVES + 2):
        far_x, far_y = max(points, key=lambda point: math.hypot(point[0] - x, point[1] - y))
        x, y = x + (far_x - x) / step, y + (far_y - y) / step
    return (x, y)


def relay_point(view: View, robot: str, hops: int) -> Vector | None:
    """The middle of where a free robot's linked neighbours are bound, as far as they do not follow it; None with few.

    A neighbour with a claim will be at its target, one without stays where it is. Somebody must have a claim.
    """
    ends: list[Vector] = []
    claimed = False
    for name, (state, _, _) in view.heard.items():
        seen = view.sighted.get(name)
        if seen is None or not linked(state, robot):
            continue
        if state.claim_at is not None:
            ends.append(state.claim_at)
            claimed = True
        elif state.hops <= hops:
            ends.append(seen[:2])
    return middle(ends) if claimed and len(ends) > 1 else None
