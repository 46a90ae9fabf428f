"""What reaches a robot: which frames, states and target clouds are news, and why the others are refused. Pure."""

from typing import Final

from contract.arena import Arena
from contract.messages import MocapFrame, NeighbourState, TargetCloud

STALL_NS: Final = 50_000_000
"""Repeated or overtaken frames are no fault while new ones come in between."""
DUPLICATE_WINDOW_NS: Final = 2_000_000_000
STATE_AGE_NS: Final = 2_000_000_000
"""What a neighbour said longer ago is refused like a lost message, whoever held it back."""


class Reception:
    """Methods say what a message is refused for, empty where it is to be taken."""

    def __init__(self, arena: Arena, robot: str, boot: int) -> None:
        self.frame: MocapFrame | None = None
        """The newest, and when it arrived."""
        self.frame_ns = 0
        self.advancing = False
        """Frame numbers go up."""
        self._robot = robot
        self._boot = boot
        self._robots = arena.robots
        self._tolerance_ns = round(arena.safety.clock_tolerance_s * 1e9)
        self._past_sessions: set[int] = set()
        self._past_missions: set[str] = set()
        self._waiting: TargetCloud | None = None
        self._duplicate_ns = -DUPLICATE_WINDOW_NS

    def take_frame(self, frame: MocapFrame, now_ns: int) -> str:
        """Newer than every frame before, or of a newer session of the source."""
        last = self.frame
        if last is not None:
            if frame.session == last.session:
                if frame.frame <= last.frame:
                    self.advancing = now_ns - self.frame_ns <= STALL_NS
                    return "frame not newer"
            elif frame.session in self._past_sessions or frame.publish_ns < last.publish_ns:
                return "frame of an earlier session"
            else:
                self._past_sessions.add(last.session)
        self.frame, self.frame_ns, self.advancing = frame, now_ns, True
        return ""

    def take_state(self, state: NeighbourState, now_ns: int) -> str:
        """From another robot of the arena, and of about now."""
        if state.robot not in self._robots:
            return "state of a robot that is not in the arena file"
        if state.stamp_ns > now_ns + self._tolerance_ns:
            return "state ahead of its time"
        return "state too old" if now_ns - state.stamp_ns > STATE_AGE_NS else ""

    def hear_own(self, state: NeighbourState, now_ns: int) -> None:
        """A state under this robot's id: of another process, unless it is of this boot."""
        if state.boot != self._boot:
            self._duplicate_ns = now_ns

    def duplicate(self, now_ns: int) -> bool:
        """Whether another process uses this robot's id."""
        return now_ns - self._duplicate_ns < DUPLICATE_WINDOW_NS

    def take_targets(self, cloud: TargetCloud, named: str, known: str) -> str:
        """An earlier mission's targets are a replay; unknown ones wait until the station names their mission.

        :param named: the mission that the station names.
        :param known: the mission whose targets this robot knows.
        """
        if cloud.mission != named and cloud.mission in self._past_missions:
            return "targets of an earlier mission"
        if cloud.mission != named and named and known == named:
            self._waiting = cloud
            return "targets ahead of their mission"
        self._waiting = None
        return ""

    def waiting(self, named: str) -> TargetCloud | None:
        """Targets that came before the station named their mission, once it does."""
        cloud = self._waiting
        return cloud if cloud is not None and cloud.mission == named else None

    def retire(self, mission: str) -> None:
        """Another mission has taken the place of that one."""
        self._past_missions.add(mission)
