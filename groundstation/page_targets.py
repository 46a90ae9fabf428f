"""The targets of the arena page: which are open, seen, tracked, held, done. Pure."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from contract.messages import RobotReport, TargetCloud
from groundstation.page_seed import unreachable


class TargetBoard:
    """One cloud and what has become of it; ``version`` grows with every new cloud."""

    def __init__(self, sensing_radius_m: float) -> None:
        self.cloud: TargetCloud | None = None
        self.version = 0
        self.done: set[int] = set()
        self.strays: list[tuple[int, float]] = []
        """(target, distance in m to the nearest other piece) of those that the swarm cannot reach from the rest."""
        self._radius_m = sensing_radius_m
        self._points: Any = np.zeros((0, 2))
        self._seen: Any = np.zeros(0, dtype=bool)
        self._letters = bytearray()
        """Which are seen, whatever is done or done to them just now."""

    def take(self, cloud: TargetCloud) -> None:
        if self.cloud != cloud:
            self.cloud = cloud
            self.version += 1
            self._points = np.array([(t.x_m, t.y_m) for t in cloud.targets]).reshape(-1, 2)
            self._seen = np.zeros(len(cloud.targets), dtype=bool)
            self._letters = bytearray(b"o" * len(cloud.targets))
            self.strays = unreachable([(t.x_m, t.y_m) for t in cloud.targets], self._radius_m)

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
            for k in unseen[near].tolist():
                self._letters[k] = ord("s")
        letters = bytearray(self._letters)
        for k in self.done:
            if k < len(letters):
                letters[k] = ord("d")
        for report in reports:
            if 0 <= report.claim < len(letters) and report.run in ("running", "holding", "stopped"):
                if report.task == "tracking" and report.claim not in self.done:
                    letters[report.claim] = ord("t")
                elif report.task == "occupied":
                    letters[report.claim] = ord("h" if report.run == "running" else "d")
        return letters.decode()
