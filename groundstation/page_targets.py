"""The targets of the arena page: which are open, seen, tracked, held, done. Pure."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from contract.messages import RobotReport, TargetCloud


class TargetBoard:
    """One cloud and what has become of it; ``version`` grows with every new cloud."""

    def __init__(self, sensing_radius_m: float) -> None:
        self.cloud: TargetCloud | None = None
        self.version = 0
        self.done: set[int] = set()
        self._radius_m = sensing_radius_m
        self._points: Any = np.zeros((0, 2))
        self._seen: Any = np.zeros(0, dtype=bool)

    def take(self, cloud: TargetCloud) -> None:
        if self.cloud != cloud:
            self.cloud = cloud
            self.version += 1
            self._points = np.array([(t.x_m, t.y_m) for t in cloud.targets]).reshape(-1, 2)
            self._seen = np.zeros(len(cloud.targets), dtype=bool)

    def message(self) -> dict[str, Any]:
        """For the browser, when they change."""
        points = [] if self.cloud is None else [(t.x_m, t.y_m) for t in self.cloud.targets]
        return {"kind": "targets", "version": self.version, "points": points}

    def letters(self, reports: Iterable[RobotReport], running: Sequence[tuple[float, float]]) -> str:
        """A letter a target: open, seen, tracked, held (occupied just now), done; ``running`` robots' places, m."""
        if self.cloud is None:
            return ""
        if running and len(unseen := np.flatnonzero(~self._seen)):
            places = np.array(running)
            ways_x = self._points[unseen, 0, None] - places[:, 0]
            ways_y = self._points[unseen, 1, None] - places[:, 1]
            near = (ways_x**2 + ways_y**2).min(axis=1) <= self._radius_m**2
            self._seen[unseen[near]] = True
        letters = ["s" if seen else "o" for seen in self._seen.tolist()]
        for k in self.done:
            if k < len(letters):
                letters[k] = "d"
        for report in reports:
            if 0 <= report.claim < len(letters) and report.run in ("running", "holding", "stopped"):
                if report.task == "tracking" and report.claim not in self.done:
                    letters[report.claim] = "t"
                elif report.task == "occupied":
                    letters[report.claim] = "h" if report.run == "running" else "d"
        return "".join(letters)
