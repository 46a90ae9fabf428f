"""Who takes part in a mission: the arena's robots, a quorum of them, those taken out, those that come late. Pure."""

from collections.abc import Callable, Mapping

from contract.arena import Arena
from contract.messages import RobotReport

POWERED = ("armed", "running", "holding")
"""Run states with power on the wheels."""


class Crew:
    """The robots of one session."""

    def __init__(self, arena: Arena) -> None:
        self._all = tuple(arena.robots)
        self.names = self._all
        """Who takes part now, in the arena file's order at first."""
        self.excluded: frozenset[str] = frozenset()
        """Taken out of the network by the operator: they stand still, and nobody waits for them."""
        self.joining = ""
        """A late robot that is being armed while the others run."""
        self.addressees: tuple[str, ...] = ()
        """Whom the operator's order is for alone; empty: all."""

    @property
    def missing(self) -> tuple[str, ...]:
        """Robots of the arena that this mission does without."""
        return tuple(name for name in self._all if name not in self.names)

    def exclude(self, robots: tuple[str, ...]) -> bool:
        """Take robots out; False where none is named, or none would be left."""
        named = frozenset(robots) & frozenset(self._all)
        if not named or named | self.excluded >= frozenset(self._all):
            return False
        self.excluded |= named
        self.names = tuple(name for name in self.names if name not in named)
        self.joining = "" if self.joining in named else self.joining
        return True

    def readmit(self, robots: tuple[str, ...], reports: Mapping[str, RobotReport], running: bool) -> frozenset[str]:
        """Take robots back, and say whom; while a mission runs only those with power are of the crew at once."""
        named = frozenset(robots) & frozenset(self._all)
        self.excluded -= named
        back = {name for name in named if name in reports and reports[name].run in POWERED}
        crew = set(self.names) | (back if running else named)
        self.names = tuple(name for name in self._all if name in crew)
        return named

    def muster(self, quorum: int, fit: Callable[[str], bool]) -> None:
        """All but the excluded; where a quorum suffices, those that are fit, if they are enough. 0: all are needed."""
        self.names = tuple(name for name in self._all if name not in self.excluded)
        if 0 < quorum < len(self.names):
            able = tuple(name for name in self.names if fit(name))
            if len(able) >= quorum:
                self.names = able

    def late(self, reports: Mapping[str, RobotReport], fit: Callable[[str], bool]) -> str:
        """The first robot that has come late and is fit to join, or ''."""
        missing = (name for name in self.missing if name in reports and name not in self.excluded)
        return next((name for name in missing if fit(name)), "")

    def join(self) -> None:
        """The late robot is one of the crew."""
        self.names = (*self.names, self.joining)

    def powered_outsiders(self, reports: Mapping[str, RobotReport]) -> list[str]:
        """Robots that the order is not for, with power on their wheels."""
        if not self.addressees:
            return []
        return [r.robot for r in reports.values() if r.robot not in self.addressees and r.run in POWERED]
