"""HELP: a tracker that makes no progress asks, and those that hold it back come nearer.

A robot heeds a request that comes over a taut link, and passes it on over its own: so it goes along what holds the
tracker back, and leaves alone who does not. One that stays open for ``OPEN_S`` concerns everybody.

The shortest way left wins, the lower id between equals. A tracker nearer to its own target than the one that asks
asks at once rather than turn away from it: two that pull the swarm apart would else both end far from their targets.
"""

import math
from collections.abc import Container, Iterable
from dataclasses import dataclass, field
from typing import Final

import msgspec

from contract.messages import Help
from contract.units import metres

PROGRESS_M: Final = 0.02
PATIENCE_S: Final = 0.6
OPEN_S: Final = 3.0
LIMIT_S: Final = 15.0
SKIP_S: Final = 5.0
"""A target given up after ``LIMIT_S`` is left alone this long."""


def _rank(help_: Help) -> tuple[float, str]:
    return (help_.left_m, help_.robot)


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
    _since_s: dict[tuple[str, int], float] = field(default_factory=dict)
    """When each request that is told around here was first heard."""

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
                self._ask(distance_m, now_s)
            return False
        return now_s - self._asked_s > LIMIT_S

    def _ask(self, left_m: float, now_s: float) -> None:
        self._number += 1
        self._asked_s = now_s
        self.request = Help(robot=self.robot, hops=0, number=self._number, left_m=metres(left_m))

    def stop_tracking(self) -> None:
        self.request = None

    def listen(
        self,
        requests: Iterable[tuple[str, Help]],
        left_m: float = math.inf,
        now_s: float = 0.0,
        taut: Container[str] = (),
    ) -> None:
        """Requests as (neighbour, its Help); keeps the first in rank at its fewest hops, hops below N.

        :param left_m: own way to the tracked target, infinite without one.
        :param taut: neighbours whose link with this robot is taut.
        """
        best: Help | None = None
        via = ""
        since_s, self._since_s = self._since_s, {}
        for neighbour, help_ in sorted(requests):
            if help_.robot == self.robot or help_.hops + 1 >= self.robots:
                continue
            key = (help_.robot, help_.number)
            first_s = self._since_s.setdefault(key, since_s.get(key, now_s))
            if neighbour not in taut and now_s - first_s < OPEN_S and not self._serves(key):
                continue
            if best is None or (*_rank(help_), help_.hops + 1) < (*_rank(best), best.hops):
                best = msgspec.structs.replace(help_, hops=help_.hops + 1)
                via = neighbour
        if self.request is None and best is not None and left_m < best.left_m:
            self._ask(left_m, now_s)
        if self.request is not None and best is not None and _rank(self.request) < _rank(best):
            best = None
        self.heard, self.via = best, via if best is not None else ""

    def _serves(self, request: tuple[str, int]) -> bool:
        return self.heard is not None and (self.heard.robot, self.heard.number) == request

    @property
    def told(self) -> Help | None:
        """What it tells its neighbours: the better of its own request and the one it serves."""
        return self.heard if self.heard is not None else self.request
