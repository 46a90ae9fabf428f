"""HELP: a tracker that makes no progress floods a request; the lowest id wins and the others come nearer."""

from collections.abc import Iterable
from dataclasses import dataclass

from contract.messages import Help

PROGRESS_M = 0.02
PATIENCE_S = 1.5
LIMIT_S = 15.0
SKIP_S = 5.0
"""A target given up after ``LIMIT_S`` is left alone this long."""


@dataclass
class Assist:
    """One robot's part in HELP: its own request, and the best request heard."""

    robot: str
    robots: int
    request: Help | None = None
    heard: Help | None = None
    """The request it serves, with its own hop count."""
    via: str = ""
    """The neighbour one hop nearer to the one that asks."""
    _best_m: float = float("inf")
    _progress_s: float = 0.0
    _asked_s: float = 0.0
    _number: int = 0

    def start_tracking(self, now_s: float) -> None:
        """A new target: progress counts from here."""
        self._best_m, self._progress_s = float("inf"), now_s
        self.request = None

    def track(self, distance_m: float, now_s: float) -> bool:
        """Watch progress towards the target; True when the request has run out and the target must be skipped."""
        if distance_m < self._best_m - PROGRESS_M:
            self._best_m, self._progress_s = distance_m, now_s
        if self.request is None:
            if now_s - self._progress_s > PATIENCE_S:
                self._number += 1
                self._asked_s = now_s
                self.request = Help(robot=self.robot, hops=0, number=self._number)
            return False
        return now_s - self._asked_s > LIMIT_S

    def stop_tracking(self) -> None:
        self.request = None

    def listen(self, requests: Iterable[tuple[str, Help]]) -> None:
        """Requests as (neighbour, its Help); keeps the lowest id at its fewest hops, hops below N."""
        best: Help | None = None
        via = ""
        for neighbour, help_ in sorted(requests):
            if help_.robot == self.robot or help_.hops + 1 >= self.robots:
                continue
            if best is None or (help_.robot, help_.hops + 1) < (best.robot, best.hops):
                best = Help(robot=help_.robot, hops=help_.hops + 1, number=help_.number)
                via = neighbour
        if self.request is not None and best is not None and self.request.robot < best.robot:
            best = None
        self.heard, self.via = best, via if best is not None else ""

    @property
    def told(self) -> Help | None:
        """What it tells its neighbours: the better of its own request and the one it serves."""
        return self.heard if self.heard is not None else self.request
