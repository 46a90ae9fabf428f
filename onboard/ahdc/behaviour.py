"""Section III-A: the node's velocity from cohesion, separation and alignment (eq. 12).

Each part is a vector of at most unit length; eq. 12's sum saturates at one and scales u_max.
"""

import math
from collections.abc import Iterable
from typing import Final

from onboard.ahdc.parameters import Vector

SHARPNESS_PER_M: Final = 30.0
"""zeta: how fast separation fades beyond r_a."""
REAR_WEIGHT: Final = 0.5
"""mu: weight of a robot straight behind, against 1 straight ahead."""
FADED_M: Final = 0.3
"""Separation is naught farther than this beyond r_a."""
SIDE_STEP: Final = 0.3
"""Share of the separation that turns to the right-hand side, so that head-on robots pass."""


def cohesion(own: Vector, others: Iterable[Vector], sensing_radius_m: float) -> Vector:
    """u_i^c: mean of the ways to the neighbours, in units of r_c."""
    points = list(others)
    if not points:
        return (0.0, 0.0)
    scale = 1 / (sensing_radius_m * len(points))
    return (sum(p[0] - own[0] for p in points) * scale, sum(p[1] - own[1] for p in points) * scale)


def separation(own: Vector, others: Iterable[Vector], ahead: Vector, avoidance_radius_m: float) -> Vector:
    """u_i^s: away from each neighbour by exp(zeta (r_a - d)), weighted ahead, with a side-step to the right.

    ``ahead`` is the unit direction of travel, (0, 0) where there is none. Coincident robots part along x.
    """
    x, y = own
    ahead_x, ahead_y = ahead
    range_m = avoidance_radius_m + FADED_M
    ux = uy = 0.0
    for other_x, other_y in others:
        dx, dy = other_x - x, other_y - y
        distance = math.hypot(dx, dy)
        if distance > range_m:
            continue
        rx, ry = (dx / distance, dy / distance) if distance > 1e-9 else (1.0, 0.0)
        cosine = rx * ahead_x + ry * ahead_y
        weight = REAR_WEIGHT + (1 - REAR_WEIGHT) * (1 + cosine) / 2
        fade = SHARPNESS_PER_M * (avoidance_radius_m - distance)
        push = weight * math.exp(fade if fade < 5.0 else 5.0)
        ux += push * (-rx + SIDE_STEP * ry)
        uy += push * (-ry - SIDE_STEP * rx)
    return saturate((ux, uy))


def alignment(own: Vector, goal: Vector) -> Vector:
    """u_i^a: unit vector towards the goal."""
    dx, dy = goal[0] - own[0], goal[1] - own[1]
    distance = math.hypot(dx, dy)
    return (dx / distance, dy / distance) if distance > 1e-9 else (0.0, 0.0)


def velocity(parts: tuple[Vector, Vector, Vector], weights: tuple[float, float, float], max_speed_mps: float) -> Vector:
    """u_i of eq. 12, m/s: alpha u_c + beta u_s + gamma u_a, saturated at u_max."""
    (cx, cy), (sx, sy), (ax, ay) = parts
    alpha, beta, gamma = weights
    x, y = saturate((alpha * cx + beta * sx + gamma * ax, alpha * cy + beta * sy + gamma * ay))
    return (x * max_speed_mps, y * max_speed_mps)


def saturate(vector: Vector, limit: float = 1.0) -> Vector:
    """The vector, shortened to ``limit`` where it is longer."""
    x, y = vector
    length = math.hypot(x, y)
    return vector if length <= limit else (x * limit / length, y * limit / length)
