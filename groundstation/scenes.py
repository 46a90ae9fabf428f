"""Moments of a run worth a picture: robots, targets and links as they stood at one frame. Pure."""

from typing import NamedTuple

import numpy as np

from groundstation.connectivity import Edge, disk_graph, lambda2
from groundstation.history import Floats, History, Mission
from groundstation.measures import enforced, within

APART_S = 0.4
"""Pictures are at least this far apart."""
SETTLED_NS = 1_000_000_000
"""Links that go sooner after the start are those of robots lined up too close."""


class Scene(NamedTuple):
    """One frame. Edges join robots by their index in the arena file."""

    seconds: float
    """Since the start of the mission."""
    caption: str
    poses: Floats
    """x, y (m), heading (rad): shape (robots, 3)."""
    trail: Floats
    """Positions of the last seconds: shape (frames, robots, 2)."""
    kept: frozenset[Edge]
    """Links enforced at both ends, the robots no farther apart than r_n."""
    critical: frozenset[Edge]
    """Links enforced at both ends, the robots farther apart than r_n."""
    removed: frozenset[Edge]
    """Robots within r_c of each other whose link was removed in this mission."""
    done: frozenset[int]
    """Targets occupied so far."""
    lambda2: float
    """Of the links enforced at both ends."""


class Film:
    """The frames of a mission, and what stood when."""

    TRAIL_S = 6.0

    def __init__(self, history: History, mission: Mission) -> None:
        rows = within(history.exposure_ns, mission.start_ns, mission.end_ns)
        self.history = history
        self.mission = mission
        self.exposure_ns = history.exposure_ns[rows]
        self.poses = history.last_known()[rows]
        self._changes = sorted(
            {e.exposure_ns for t in history.tracks.values() for e in t.links if e.exposure_ns <= mission.end_ns}
        )
        self._graphs = [enforced(history, stamp_ns) for stamp_ns in self._changes]

    def seconds(self, row: int) -> float:
        return (int(self.exposure_ns[row]) - self.mission.start_ns) / 1e9

    def row(self, stamp_ns: int) -> int:
        """The last frame exposed at ``stamp_ns`` or before, else the first."""
        return max(0, int(np.searchsorted(self.exposure_ns, stamp_ns, side="right")) - 1)

    def lambda2(self) -> Floats:
        """Of the disk graph of every frame: shape (frames,)."""
        radius_m = self.history.arena.control.sensing_radius_m
        n = len(self.history.robots)
        points = self.poses[:, :, :2].tolist()
        return np.array([lambda2(n, disk_graph([(x, y) for x, y in row], radius_m)) for row in points])

    def scene(self, row: int, caption: str = "") -> Scene:
        stamp_ns = int(self.exposure_ns[row])
        control = self.history.arena.control
        points = [(x, y) for x, y, _ in self.poses[row].tolist()]
        near = disk_graph(points, control.noncritical_radius_m)
        reach = disk_graph(points, control.sensing_radius_m)
        links, once = frozenset[Edge](), frozenset[Edge]()
        for change_ns, graph in zip(self._changes, self._graphs, strict=True):
            if change_ns > stamp_ns:
                break
            links, once = graph, once | graph
        first = self.row(stamp_ns - round(self.TRAIL_S * 1e9))
        done = {o.target for o in self.history.occupations.values() if o.stamp_ns <= stamp_ns + 2_000_000}
        return Scene(
            seconds=self.seconds(row),
            caption=caption,
            poses=self.poses[row],
            trail=self.poses[first : row + 1, :, :2],
            kept=links & near,
            critical=links - near,
            removed=(once - links) & reach,
            done=frozenset(done),
            lambda2=lambda2(len(points), links & reach),
        )

    def six(self) -> list[Scene]:
        """Six telling moments in order: start, first target, a removal before and after, sparsest, end."""
        if not len(self.exposure_ns):
            return []
        wanted: list[tuple[int, str]] = [(0, "")]
        occupations = sorted(self.history.occupations.values(), key=lambda entry: entry.stamp_ns)
        robots = self.history.robots
        last = len(self.exposure_ns) - 1
        done = len([o for o in occupations if o.stamp_ns <= self.mission.end_ns + 2_000_000])
        wanted.append((last, f"End: {_count(done, 'target')} done"))
        if occupations:
            first = occupations[0]
            wanted.append((self.row(first.stamp_ns), f"{label(first.robot)} reaches the first target"))
        before, after, gone = self._removal()
        if gone:
            pairs = ", ".join(f"{label(robots[i])}-{label(robots[j])}" for i, j in sorted(gone))
            wanted += [(before, f"Before {pairs} {'goes' if len(gone) == 1 else 'go'}"), (after, "The same links gone")]
        sparse = min(range(last + 1), key=lambda k: (self._enforced_lambda2(k), k)) if self._graphs else last
        wanted.append((sparse, ""))
        chosen: dict[int, str] = {}
        for row, caption in wanted:
            if all(abs(self.seconds(row) - self.seconds(other)) >= APART_S for other in chosen):
                chosen[row] = caption
        fill = [k * last // 12 for k in (6, 3, 9, 2, 4, 8, 10, 5, 7, 1, 11)]
        for row in fill:
            if len(chosen) >= 6:
                break
            if all(abs(self.seconds(row) - self.seconds(other)) >= APART_S for other in chosen):
                chosen[row] = ""
        scenes = [self.scene(row, caption) for row, caption in sorted(chosen.items())]
        return [s if s.caption else s._replace(caption=self._words(s, k == 0)) for k, s in enumerate(scenes)]

    def _words(self, scene: Scene, first: bool) -> str:
        links = len(scene.kept) + len(scene.critical)
        if first:
            return f"Start: {_count(links, 'link')}"
        tree = f"A tree of {_count(links, 'link')}" if links == len(self.history.robots) - 1 else _count(links, "link")
        return f"{tree}, {_count(len(scene.done), 'target')} done"

    def _enforced_lambda2(self, row: int) -> float:
        k = int(np.searchsorted(self._changes, int(self.exposure_ns[row]), side="right")) - 1
        return lambda2(len(self.history.robots), self._graphs[k]) if k >= 0 else np.inf

    def _removal(self) -> tuple[int, int, frozenset[Edge]]:
        """Frames around the moment in which most links go within half a second, and those links."""
        best: tuple[int, int, frozenset[Edge]] = (0, 0, frozenset())
        for k in range(1, len(self._changes)):
            change_ns = self._changes[k]
            if change_ns <= self.mission.start_ns + SETTLED_NS:
                continue
            until_ns = change_ns + round(APART_S * 1e9)
            last = int(np.searchsorted(self._changes, until_ns, side="right")) - 1
            gone = self._graphs[k - 1] - self._graphs[last]
            if len(gone) > len(best[2]):
                best = (max(0, self.row(change_ns) - 1), self.row(until_ns), gone)
        return best


def label(robot: str) -> str:
    """``r06`` as people say it: 6."""
    digits = robot.lstrip("r").lstrip("0")
    return digits if digits.isdigit() else robot


def clock(seconds: float, decimals: int = 0) -> str:
    """1:05 for 65 seconds, 1:05.3 with one decimal; rounded down."""
    units = int(seconds * 10**decimals + 1e-6)
    whole, rest = divmod(units, 10**decimals)
    tail = f".{rest:0{decimals}d}" if decimals else ""
    return f"{whole // 60}:{whole % 60:02d}{tail}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
