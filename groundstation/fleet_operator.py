"""An operator at a running fleet: mission after mission, released and started anew where something has stopped it."""

import time
from collections.abc import Callable

from groundstation.fleet_rig import FleetRig
from groundstation.processes import Child

PATIENCE_S = 60.0
ATTEMPTS = 8
OBEYED_S = 10.0
"""An order is obeyed within this, and the station has said so."""
HOME_S = 90.0
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

    def until(self, done: Callable[[str], bool], what: str, patience_s: float = PATIENCE_S) -> str:
        """Until the station says so; what it then says.

        :raises FleetError: it does not.
        :raises groundstation.processes.ChildError: a process has ended.
        """
        deadline = time.monotonic() + patience_s
        while not done(words := self.words):
            self.site.family.check()
            if time.monotonic() > deadline:
                raise FleetError(f"{what} not within {patience_s:g} s: {words}")
            time.sleep(0.02)
        return words

    def phase(self, *phases: str, patience_s: float = PATIENCE_S) -> str:
        """Until the mission is in one of these phases."""
        return self.until(lambda words: words.startswith(phases), " or ".join(phases), patience_s)

    def begin(self, before_start: Callable[[], None] = lambda: None) -> None:
        """Arm and start, as the operator does: released first where something has stopped the robots.

        :param before_start: called with the robots armed. A mission runs once the station has started it, whether or
            not every robot moves yet.
        """
        for _ in range(ATTEMPTS):
            if self._armed():
                before_start()
                self.site.order("start")
                if self._says("running", "completed"):
                    return
            self.site.order("release")
        raise FleetError(f"not running after {ATTEMPTS} attempts: {self.words}")

    def _armed(self) -> bool:
        if self.phase("ready", *ENDED).startswith(ENDED):
            return False
        self.site.order("arm")
        return self._says("armed")

    def _says(self, *phases: str) -> bool:
        """Whether the station comes to one of these phases, and to no end before: it may say so later than robots."""
        try:
            return self.phase(*phases, *ENDED, patience_s=OBEYED_S).startswith(phases)
        except FleetError:
            return False

    def again(self, before_start: Callable[[], None] = lambda: None) -> None:
        """The same targets as a new mission, from where the robots are; its recording gets a folder of its own."""
        self.phase("waiting", "ready", "completed")
        if self.site.order("repeat"):
            raise FleetError(f"no new mission: {self.words}")
        self.begin(before_start)

    def home(self) -> None:
        """Release what has stopped and drive every robot to its start."""
        for _ in range(ATTEMPTS):
            self.site.order("release")
            self.phase("waiting", "ready")
            if self.site.order("home", wait_s=HOME_S) == 0:
                return
        raise FleetError(f"not at home after {ATTEMPTS} attempts: {self.words}")

    def finish(self, patience_s: float = PATIENCE_S) -> int:
        """Until the mission is completed; an operator releases and starts anew what has stopped. How often.

        :raises FleetError: it is not, within ``patience_s`` in all.
        """
        deadline = time.monotonic() + patience_s
        for times in range(ATTEMPTS):
            left_s = max(0.0, deadline - time.monotonic())
            if self.phase("completed", *ENDED, patience_s=left_s).startswith("completed"):
                return times
            self.site.order("release")
            self.begin()
        raise FleetError(f"not completed after {ATTEMPTS} attempts: {self.words}")
