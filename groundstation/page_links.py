"""The network as the arena page shows it: what each pair of robots is, and one word for the whole. Pure."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

from groundstation.connectivity import Edge, Point, components, disk_graph, lambda2, mutual

KEPT, CRITICAL, REMOVED, UNVERIFIED = range(4)
Word = Literal["Connected", "At risk", "SPLIT", "Unknown"]


class Network(NamedTuple):
    """``pairs``: (i, j, kind), ``i < j``."""

    word: Word
    lambda2: float
    detail: str
    pairs: tuple[tuple[int, int, int], ...]


def names(indices: Sequence[int], labels: Sequence[str]) -> str:
    """6, 8 and 14."""
    words = [labels[i] for i in indices]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def network(
    points: Sequence[Point | None],
    enforced: Sequence[Sequence[int]] | None,
    doubtful: frozenset[int],
    labels: Sequence[str],
    reach_m: float,
    noncritical_m: float,
    fresh: bool,
) -> Network:
    """Judge the network.

    ``points`` in metres, None where a robot was never seen; ``enforced[i]`` the robots to which robot i
    enforces a link, None before any robot has links (then all within ``reach_m`` are); ``doubtful`` the robots
    whose pose or report is not to be trusted; ``fresh`` false while poses are too old to say anything.
    """
    n = len(points)
    seen = [i for i in range(n) if points[i] is not None]
    placed = [points[i] or (0.0, 0.0) for i in seen]
    within = frozenset((seen[i], seen[j]) for i, j in disk_graph(placed, reach_m))
    graph = within if enforced is None else mutual(enforced)
    pairs = []
    for i, j in sorted(within | graph):
        a, b = points[i], points[j]
        length = math.dist(a, b) if a and b else math.inf
        if (i, j) not in graph:
            kind = REMOVED
        elif i in doubtful or j in doubtful:
            kind = UNVERIFIED
        else:
            kind = CRITICAL if length > noncritical_m and enforced is not None else KEPT
        pairs.append((i, j, kind))
    value = lambda2(n, graph)
    word, detail = _verdict(n, graph, doubtful, labels, fresh and len(seen) == n)
    if not detail:
        detail = _counts([kind for _, _, kind in pairs], enforced is not None)
    return Network(word, value, detail, tuple(pairs))


def _verdict(
    n: int, graph: frozenset[Edge], doubtful: frozenset[int], labels: Sequence[str], known: bool
) -> tuple[Word, str]:
    if not known:
        return "Unknown", "not every robot is seen"
    pieces = components(n, graph)
    if len(pieces) > 1:
        smallest = min(pieces, key=len)
        return "SPLIT", f"{names(smallest, labels)} cut off, {len(pieces)} pieces"
    if not doubtful:
        return "Connected", ""
    sure = [i for i in range(n) if i not in doubtful]
    rest = frozenset((sure.index(i), sure.index(j)) for i, j in graph if i in sure and j in sure)
    islands = components(len(sure), rest)
    if len(islands) > 1:
        apart = [sure[i] for i in min(islands, key=len)]
        return "At risk", f"only {names(sorted(doubtful), labels)} joins {names(apart, labels)} to the rest"
    return "At risk", f"links of {names(sorted(doubtful), labels)} not verified"


def _counts(kinds: Sequence[int], enforcing: bool) -> str:
    kept, critical, removed = (kinds.count(kind) for kind in (KEPT, CRITICAL, REMOVED))
    if not enforcing:
        return f"{kept} links, none critical"
    return f"{kept + critical} kept, of these {critical} critical; {removed} removed"
