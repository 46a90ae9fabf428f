"""What a pose has to keep to before it is believed. Numbers alone."""

import math
from typing import NamedTuple

from contract.arena import Arena

QUATERNION_NORM_ERROR = 0.01
FREEZE_NS = 250_000_000
"""Numbers that have not changed for longer are frozen."""
MARKER_ERROR_WARN_M = 0.002
MARKER_ERROR_M = 0.010
FAR_M = 50.0
TILT_COS = math.cos(math.radians(45.0))
BOX_MARGIN_M = 0.1
BOX_HEIGHT_M = 2.5


class Box(NamedTuple):
    """Where bodies of an arena are, m: from ``least`` to the other three in x and y, to either side of 0 in z."""

    least: float
    width: float
    depth: float
    height: float


def box_of(arena: Arena) -> Box:
    """The floor of the arena file and a margin."""
    width_m, depth_m = arena.arena.size_m
    return Box(-BOX_MARGIN_M, width_m + BOX_MARGIN_M, depth_m + BOX_MARGIN_M, BOX_HEIGHT_M)
