"""Graphs of a swarm: who is within reach of whom, is it one piece, and lambda_2 of section II-A. Pure.

A graph is a number of nodes ``n`` and a collection of edges ``(i, j)``, ``i < j``, nodes counted from 0.
"""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np

FEW = 12
"""Up to so many points pairs are compared one by one, which is faster."""

Edge = tuple[int, int]
Point = tuple[float, float]


def disk_graph(points: Sequence[Point], radius_m: float) -> frozenset[Edge]:
    """Eq. 2: an edge for every pair at a distance of at most ``radius_m``; points in metres."""
    if len(points) > FEW:
        places = np.array(points)
        ways = places[:, None, :] - places[None, :, :]
        close = np.argwhere(np.triu((ways**2).sum(axis=2) <= (radius_m * (1.0 + 1e-12)) ** 2, 1))
        return frozenset((i, j) for i, j in close.tolist() if math.dist(points[i], points[j]) <= radius_m)
    return frozenset(
        (i, j)
        for i, first in enumerate(points)
        for j in range(i + 1, len(points))
        if math.dist(first, points[j]) <= radius_m
    )


def mutual(enforced: Sequence[Iterable[int]]) -> frozenset[Edge]:
    """Links enforced at both ends: ``enforced[i]`` are the nodes to which node i enforces a link."""
    sets = [set(others) for others in enforced]
    return frozenset((i, j) for i, others in enumerate(sets) for j in others if i < j < len(sets) and i in sets[j])


def components(n: int, edges: Iterable[Edge]) -> list[list[int]]:
    """The pieces of the graph, each in order, the piece of node 0 first."""
    parent = list(range(n))

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    for i, j in edges:
        parent[root(i)] = root(j)
    pieces: dict[int, list[int]] = {}
    for node in range(n):
        pieces.setdefault(root(node), []).append(node)
    return list(pieces.values())


@lru_cache(maxsize=4096)
def lambda2(n: int, edges: frozenset[Edge]) -> float:
    """Second smallest eigenvalue of the graph's Laplacian; exactly 0.0 when it is in pieces or n < 2."""
    if n < 2 or len(components(n, edges)) > 1:
        return 0.0
    laplacian = np.zeros((n, n))
    for i, j in edges:
        laplacian[i, j] = laplacian[j, i] = -1.0
        laplacian[i, i] += 1.0
        laplacian[j, j] += 1.0
    return float(np.linalg.eigvalsh(laplacian)[1])


def tree_floor(n: int) -> float:
    """Least lambda_2 of any connected graph of ``n`` nodes: that of the path, 2(1 - cos(pi/n))."""
    return 2.0 * (1.0 - math.cos(math.pi / n)) if n > 1 else 0.0


def summary(points: Sequence[Point], radius_m: float) -> tuple[float, int]:
    """(lambda_2, number of pieces) of the disk graph."""
    edges = disk_graph(points, radius_m)
    return lambda2(len(points), edges), len(components(len(points), edges))
