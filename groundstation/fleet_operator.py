"""An operator at a running fleet: mission after mission, released and started anew where something has stopped it."""

import time
from collections.abc import Callable

from groundstation.fleet_rig import FleetRig
from groundstation.processes import Child

PATIENCE_S = 60.0
ATTEMPTS = 8
ENDED = ("stopped", "failed")


class FleetError(RuntimeError):
    """What was waited for did not come."""


class Operator:
    """Starts the station of a running fleet, listens to what it says, and orders from its namespace."""

    def __init__(self, site: FleetRig) -> None:
        self.site = site
        self.session: Child = site.start_station()
        site.family.wait_ready(PATIENCE_S)

    @property
    def words(self) -> str:
        """What the station says now: phase and detail."""
        self.session.listen()
        return self.session._text.decode().rpartition("\n")[0].rpartition("\n")[2]

    def until(self, done: Callable[[str], bool], what: str) -> str:
        """Until the station says so; what it then says.

        :raises FleetError: it does not.
        :raises groundstation.processes.ChildError: a process has ended.
        """
        deadline = time.monotonic() + PATIENCE_S
        while not done(words := self.words):
            self.site.family.check()
            if time.monotonic() > deadline:
                raise FleetError(f"{what} not within {PATIENCE_S:g} s: {words}")
            time.sleep(0.02)
        return words

    def phase(self, *phases: str) -> str:
        """Until the mission is in one of these phases."""
        return self.until(lambda words: words.startswith(phases), " or ".join(phases))

    def begin(self) -> None:
        """Arm and start, as the operator does: released first where something has stopped the robots."""
        for _ in range(ATTEMPTS):
            if self.phase("ready", *ENDED).startswith(ENDED):
                self.site.order("release")
            elif self.site.order("arm") == 0 and self.site.order("start") == 0:
                return
        raise FleetError(f"not running after {ATTEMPTS} attempts: {self.words}")

    def again(self) -> None:
        """The same targets as a new mission, from where the robots are; its recording gets a folder of its own."""
        self.phase("waiting", "ready", "completed")
        if self.site.order("repeat"):
            raise FleetError(f"no new mission: {self.words}")
        self.begin()

    def finish(self) -> int:
        """Until the mission is completed; an operator releases and starts anew what has stopped. How often."""
        for times in range(ATTEMPTS):
            if self.phase("completed", "stopped", "failed").startswith("completed"):
                return times
            self.site.order("release")
            self.begin()
        raise FleetError(f"not completed after {ATTEMPTS} attempts: {self.words}")
