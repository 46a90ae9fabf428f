"""Who may matter to whom in a crowd: each robot is given only the bodies and the words of those around it. Pure."""

import math
from collections.abc import Callable, Iterable, Mapping

from msgspec.structs import replace

from contract.messages import MocapFrame
from groundstation.grid import Cell, Grid

Pose = tuple[float, float, float]
"""x and y, m, and heading, rad, in the arena frame."""
CROWD = 40
"""So many robots, or fewer, are given everything."""
BEYOND_M = 0.8
"""Words carry this much farther than r_c."""
CELL_M = 0.6
"""Robots of one cell are shown the same bodies."""


class Vicinity:
    """Robots by where they truly were at the last frame."""

    def __init__(self, radius_m: float, forgotten_m: float) -> None:
        """:param forgotten_m: the way of the fastest robot until it forgets a body: till then it comes not within r_c
        of where that was last shown."""
        self._radius_m = radius_m
        self._shown_m = radius_m + forgotten_m
        self._grid: Grid | None = None

    def shown(self, frame: MocapFrame, places: Mapping[str, Pose]) -> dict[str, MocapFrame]:
        """For each robot the frame with the bodies around it; robots of one cell share it."""
        grid = self._grid = Grid(places, CELL_M)
        bodies = {body.robot: body for body in frame.bodies}
        frames: dict[Cell, MocapFrame] = {}
        shown = {}
        for name, place in places.items():
            cell = grid.cell(place)
            if cell not in frames:
                near = tuple(bodies[other] for other in grid.within(cell, self._shown_m) if other in bodies)
                frames[cell] = replace(frame, bodies=near)
            shown[name] = frames[cell]
        return shown

    def hearers(self, sender: str, everybody: Iterable[str], pose: Callable[[str], Pose]) -> Iterable[str]:
        """Whom a robot's words may reach, by where all are now; before a crowd's first frame, everybody."""
        if self._grid is None:
            return everybody
        place = pose(sender)[:2]
        reach_m = self._radius_m + BEYOND_M
        near = self._grid.within(self._grid.cell(place), reach_m)
        return [name for name in near if math.dist(place, pose(name)[:2]) <= reach_m]
