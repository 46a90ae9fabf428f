"""What the station does not let in: reports, states, poses and orders that are replayed, overtaken or held back. Pure.

A message names its sender's life (boot, session) and a number or a time within it. STOP is let in whatever its age.
"""

from collections import Counter

from contract.messages import (
    Message,
    MocapFrame,
    MocapHealth,
    NeighbourState,
    OrderRequest,
    RobotReport,
    TargetCloud,
)


class Succession:
    """One sender's messages: later numbers of the same life, or another life that is younger and not over."""

    def __init__(self) -> None:
        self._last: tuple[int, int, int] | None = None
        self._over: set[int] = set()

    def next(self, life: int, number: int, stamp_ns: int) -> bool:
        """Whether this one comes after all before it; it is then the last."""
        if self._last is not None:
            last_life, last_number, last_ns = self._last
            if life == last_life:
                if number <= last_number:
                    return False
            elif life in self._over or stamp_ns < last_ns:
                return False
            else:
                self._over.add(last_life)
        self._last = life, number, stamp_ns
        return True


class Doorkeeper:
    """Judges everything the station hears."""

    def __init__(self, boot: int | None = None) -> None:
        self.refused: Counter[str] = Counter()
        """By what it was and why."""
        self._successions: dict[str, Succession] = {}
        self.boot = boot
        """Of this station; orders for another are refused."""
        self._seeds: list[str] = []

    def lets(self, message: Message) -> bool:
        """Whether the station may hear a message that has arrived."""
        words = self._fault(message)
        if words:
            self.refused[words] += 1
        return not words

    def _fault(self, message: Message) -> str:
        match message:
            case RobotReport():
                stamp_ns = message.stamp_ns
                return self._replayed(f"report of {message.robot}", message.boot, stamp_ns, stamp_ns, "report")
            case NeighbourState():
                who = f"state of {message.robot}"
                return self._replayed(who, message.boot, message.seq, message.stamp_ns, "state")
            case MocapFrame():
                return self._replayed("frame", message.session, message.frame, message.publish_ns, "frame")
            case MocapHealth():
                return self._replayed("mocap health", 0, message.stamp_ns, message.stamp_ns, "mocap health")
            case OrderRequest():
                return "" if message.station == self.boot else "order for another session"
            case TargetCloud():
                return self._old_seed(message)
        return ""

    def _replayed(self, sender: str, life: int, number: int, stamp_ns: int, what: str) -> str:
        known = self._successions.setdefault(sender, Succession())
        return "" if known.next(life, number, stamp_ns) else f"{what} replayed"

    def _old_seed(self, cloud: TargetCloud) -> str:
        """Wishes follow each other; one that another has followed does not come back."""
        if cloud.mission in self._seeds[:-1]:
            return "targets of an earlier wish"
        if cloud.mission not in self._seeds:
            self._seeds.append(cloud.mission)
        return ""
