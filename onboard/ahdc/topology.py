"""Section II-C: polygon and chain topologies, and the link that a polygon keeps (defs. 3-4, eq. 11)."""

import math
from collections.abc import Collection, Mapping, Set

from onboard.ahdc.parameters import Vector

Graph = Mapping[str, Collection[str]]
"""Adjacency by id, as heard: each robot names its links; a link named by one end is a link (eq. 2)."""


def undirected(graph: Graph) -> dict[str, set[str]]:
    """The graph with every link named at both ends: e_ij = e_ji."""
    both: dict[str, set[str]] = {}
    for first, ends in graph.items():
        for second in ends:
            both.setdefault(first, set()).add(second)
            both.setdefault(second, set()).add(first)
    return both


def reachable(graph: Graph, start: str, without: Set[str]) -> set[str]:
    """Robots joined to ``start`` by some path that avoids ``without``."""
    found, frontier = {start}, [start]
    while frontier:
        for name in graph.get(frontier.pop(), ()):
            if name not in found and name not in without:
                found.add(name)
                frontier.append(name)
    return found


def polygon_groups(own: str, links: Collection[str], graph: Graph) -> list[set[str]]:
    """The groups N_i^g: the ends of own links joined pairwise by a path that avoids the robot itself.

    Definition 3: two links of one group are sides of a polygon; definition 4: a group of one is a chain.
    """
    left, groups = set(links), []
    both = undirected(graph)
    while left:
        start = min(left)
        group = (reachable(both, start, {own}) & left) | {start}
        groups.append(group)
        left -= group
    return groups


def is_chain(group: Collection[str]) -> bool:
    """Definition 4: no path but the link itself joins the robot to this group."""
    return len(group) == 1


def link_angle_rad(own: Vector, other: Vector, goal_direction: Vector) -> float:
    """theta_ij: angle between the velocity towards the goal and the link, in [0, pi]."""
    dx, dy = other[0] - own[0], other[1] - own[1]
    gx, gy = goal_direction
    return abs(math.atan2(gx * dy - gy * dx, gx * dx + gy * dy))


def kept_link(angles: Mapping[str, float]) -> str:
    """Eq. 11: the link of a group with the smallest theta_ij is kept; equal angles: the lower id."""
    return min(angles, key=lambda name: (angles[name], name))
