"""The operator of a fleet listens to a station that says what it has done later than the robots do."""

from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.fleet_operator import ATTEMPTS, FleetError, Operator


class Scripted(Operator):
    """A station that needs ``lag`` looks until its words follow an order, and how each order ends."""

    def __init__(self, lag: int, outcomes: dict[str, str]) -> None:
        self.orders: list[str] = []
        self._lag, self._outcomes = lag, outcomes
        self._said, self._next, self._looks = "ready: arm to go on", "", 0
        family = SimpleNamespace(check=lambda: None)
        self.site: Any = SimpleNamespace(order=self._order, family=family)

    def _order(self, verb: str) -> int:
        self.orders.append(verb)
        self._next, self._looks = self._outcomes[verb], 0
        return 0

    @property
    def words(self) -> str:
        self._looks += 1
        if self._looks > self._lag and self._next:
            self._said, self._next = self._next, ""
        return self._said


GOOD = {"arm": "armed: run to start", "start": "running: ", "release": "ready: arm to go on"}


@pytest.mark.parametrize("lag", [0, 1, 5])
def test_a_station_whose_words_come_late_has_started_all_the_same(lag: int) -> None:
    operator = Scripted(lag, GOOD)
    operator.begin()
    assert operator.orders == ["arm", "start"]


@pytest.mark.parametrize("end", ["stopped: r08 stopped: silence", "failed: r08: bus off"])
def test_a_mission_that_ends_at_its_start_is_released_and_started_anew_so_often(end: str) -> None:
    operator = Scripted(0, {**GOOD, "start": end})
    with pytest.raises(FleetError, match="not running after"):
        operator.begin()
    assert operator.orders == ["arm", "start", "release"] * ATTEMPTS
