"""The mission's targets and what is done of them, as the robots tell it. Pure."""

from msgspec.structs import replace

from contract.messages import NeighbourState, TargetCloud


def next_mission(name: str) -> str:
    """A mission's name for its next run: lab, lab.2, lab.3."""
    stem, dot, number = name.rpartition(".")
    again = bool(dot) and number.isdecimal() and number.isascii()
    return f"{(stem if again else name)[:56]}.{int(number) + 1 if again else 2}"


class Tally:
    """One mission's cloud, what is occupied, and when it began and ended, site ns."""

    def __init__(self, cloud: TargetCloud) -> None:
        self.cloud = cloud
        self.started_ns = 0
        """0 before the start."""
        self.ended_ns = 0
        self._occupied: list[int] = []
        self._told: dict[str, int] = {}
        """Robot -> what it last told of this mission's targets, bit k for target k."""
        self._missions: dict[str, str] = {}
        """Robot -> the mission whose targets it knows."""

    def hear(self, state: NeighbourState) -> None:
        """What a robot says of the mission; of another mission it says nothing of this one."""
        self._missions[state.robot] = state.mission
        before = self._told.pop(state.robot, None)
        if state.mission != self.cloud.mission:
            return
        try:
            bits = self._told[state.robot] = int(state.occupied or "0", 16)
        except ValueError:
            return
        if bits != before:
            self._count()

    def _count(self) -> None:
        """Before the start, what the robots say now; after it, also what they have said."""
        bits = 0
        for told in self._told.values():
            bits |= told
        if not self.started_ns:
            self._occupied = [k for k in self._occupied if bits >> k & 1]
        for target in self.cloud.targets:
            if bits >> target.index & 1 and target.index not in self._occupied:
                self._occupied.append(target.index)

    def begin_anew(self) -> None:
        """Nobody has started; occupied is what the robots say."""
        self.started_ns = self.ended_ns = 0
        self._count()

    def repeat(self) -> None:
        """The same targets as a mission of the next name, none of them occupied."""
        self.replace(replace(self.cloud, mission=next_mission(self.cloud.mission)))

    def replace(self, cloud: TargetCloud) -> None:
        """Other targets; the end of the mission before stays told."""
        self.cloud = cloud
        self._occupied.clear()
        self._told.clear()
        self.started_ns = 0

    def late(self, crew: tuple[str, ...]) -> list[str]:
        """Robots that know the targets of another mission."""
        mission = self.cloud.mission
        return [name for name in crew if self._missions.get(name, mission) != mission]

    @property
    def occupied(self) -> tuple[int, ...]:
        """Targets in the order in which the station heard of them."""
        return tuple(self._occupied)

    @property
    def left(self) -> int:
        """Targets still open."""
        return len(self.cloud.targets) - len(self._occupied)

    def elapsed_s(self, now_ns: int) -> float:
        """Of the mission so far, or until it ended."""
        return ((self.ended_ns or now_ns) - self.started_ns) / 1e9 if self.started_ns else 0.0
