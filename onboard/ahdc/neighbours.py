"""Sections II-A and II-B: who is a neighbour, and which neighbours are critical (eq. 2-6)."""

import math
from collections.abc import Mapping

from onboard.ahdc.parameters import Vector


def connected(distance_m: float, sensing_radius_m: float) -> bool:
    """e_ij of eq. 2: two robots are connected up to and including r_c."""
    return distance_m <= sensing_radius_m


def neighbours(own: Vector, others: Mapping[str, Vector], sensing_radius_m: float) -> dict[str, float]:
    """N_i: the robots connected to ``own`` (eq. 2), each with its distance r_ij, m."""
    distances = {name: math.dist(own, position) for name, position in others.items()}
    return {name: distance for name, distance in distances.items() if connected(distance, sensing_radius_m)}


def noncritical_direct(distances: Mapping[str, float], noncritical_radius_m: float) -> set[str]:
    """N_i^n1 of eq. 5: neighbours inside the non-critical area S_i^n."""
    return {name for name, distance in distances.items() if distance <= noncritical_radius_m}


def noncritical_covered(
    distances: Mapping[str, float], others: Mapping[str, Vector], noncritical_radius_m: float
) -> set[str]:
    """N_i^n2 of eq. 6: neighbours in the critical area with some robot k in S_i^n and S_j^n at once."""
    inner = noncritical_direct(distances, noncritical_radius_m)
    return {
        name
        for name in distances
        if name not in inner and any(math.dist(others[k], others[name]) <= noncritical_radius_m for k in inner)
    }


def noncritical_robots(
    distances: Mapping[str, float], others: Mapping[str, Vector], noncritical_radius_m: float
) -> set[str]:
    """N_i^n of eq. 4: the direct and the covered ones."""
    return noncritical_direct(distances, noncritical_radius_m) | noncritical_covered(
        distances, others, noncritical_radius_m
    )


def critical_robots(
    distances: Mapping[str, float], others: Mapping[str, Vector], noncritical_radius_m: float
) -> set[str]:
    """N_i^c of eq. 3 (definition 1): neighbours in the critical area that no robot k covers.

    ``distances`` is N_i with r_ij; ``others`` holds the positions of at least those robots, any frame.
    """
    return set(distances) - noncritical_robots(distances, others, noncritical_radius_m)
