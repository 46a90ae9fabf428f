"""Graphs of the swarm against networkx and against the laws of lambda_2."""

import math

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.connectivity import components, disk_graph, lambda2, mutual, summary, tree_floor

COORDINATE = st.floats(0, 4, allow_nan=False)
POINTS = st.lists(st.tuples(COORDINATE, COORDINATE), min_size=2, max_size=12)


def graph_of(points: list[tuple[float, float]], radius_m: float) -> nx.Graph:
    graph = nx.Graph()
    graph.add_nodes_from(range(len(points)))
    pairs = [(i, j) for i in range(len(points)) for j in range(i) if math.dist(points[i], points[j]) <= radius_m]
    graph.add_edges_from(pairs)
    return graph


@given(points=POINTS, radius_m=st.floats(0.1, 3))
def test_like_networkx(points: list[tuple[float, float]], radius_m: float) -> None:
    oracle = graph_of(points, radius_m)
    edges = disk_graph(points, radius_m)
    assert {frozenset(edge) for edge in edges} == {frozenset(edge) for edge in oracle.edges}
    pieces = components(len(points), edges)
    assert {frozenset(piece) for piece in pieces} == {frozenset(piece) for piece in nx.connected_components(oracle)}
    adjacency = nx.to_numpy_array(oracle)
    spectrum = sorted(np.linalg.eigvals(np.diag(adjacency.sum(axis=0)) - adjacency).real)
    assert lambda2(len(points), edges) == pytest.approx(spectrum[1], abs=1e-9)
    assert summary(points, radius_m) == (lambda2(len(points), edges), len(pieces))
    assert (lambda2(len(points), edges) > 0) == (len(pieces) == 1)


@given(n=st.integers(2, 12), random=st.randoms(use_true_random=False))
def test_no_connected_graph_is_below_the_floor(n: int, random: object) -> None:
    tree = {(random.randrange(i), i) for i in range(1, n)}  # type: ignore[attr-defined]
    assert lambda2(n, frozenset(tree)) >= tree_floor(n) - 1e-9
    path = frozenset((i, i + 1) for i in range(n - 1))
    assert lambda2(n, path) == pytest.approx(tree_floor(n))


def test_six_robots_of_the_paper() -> None:
    assert tree_floor(6) == pytest.approx(0.26795, abs=1e-5)
    branched = frozenset({(0, 1), (1, 2), (2, 3), (3, 4), (1, 5)})
    assert lambda2(6, branched) == pytest.approx(0.3249, abs=1e-4)  # the value marked in Fig. 5


@given(sets=st.lists(st.sets(st.integers(0, 5)), min_size=6, max_size=6))
def test_a_mutual_link_needs_both_ends(sets: list[set[int]]) -> None:
    found = mutual(sets)
    for i in range(6):
        for j in range(i + 1, 6):
            assert ((i, j) in found) == (j in sets[i] and i in sets[j])


def test_small_swarms() -> None:
    assert summary([], 1.0) == (0.0, 0)
    assert summary([(0.0, 0.0)], 1.0) == (0.0, 1)
    assert tree_floor(1) == 0.0
