"""What became of one lockstep mission, and where the time of its robots went. Pure."""

from typing import Literal

import msgspec

from contract.messages import RobotStep
from groundstation.activity import activity

Ending = Literal["completed", "time up", "no scenario", "error"]


class Result(msgspec.Struct, kw_only=True):
    """What became of one run."""

    seed: int
    robots: int
    targets: int
    completed: bool
    occupied: int
    mission_s: float
    disconnected_steps: int
    collisions: int
    min_distance_m: float
    lower_bound_s: float
    ratio_to_lower_bound: float | None
    run_steps: int
    ending: Ending
    why: str = ""
    """What every robot was about when the mission failed."""
    time_s: dict[str, float] = {}
    """Robot-seconds by activity (:data:`groundstation.activity.ACTIVITIES`)."""


class TimeBook:
    """Robot time by activity, booked step by step."""

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._time_ns: dict[str, int] = {}
        self._doing: dict[str, tuple[str, int]] = {}
        """What each robot has been about, and since when."""

    def note(self, step: RobotStep) -> None:
        """A step that a robot tells of."""
        self._spend(step.robot, step.step_ns)
        self._doing[step.robot] = (activity(step), max(step.step_ns, self._start_ns))

    def _spend(self, robot: str, until_ns: int) -> None:
        word, since_ns = self._doing.get(robot, ("hold", self._start_ns))
        self._time_ns[word] = self._time_ns.get(word, 0) + max(0, until_ns - since_ns)

    def close(self, now_ns: int) -> dict[str, float]:
        """Robot-seconds by activity; what the robots are about now counts until now."""
        for robot in self._doing:
            self._spend(robot, now_ns)
        return {word: round(spent_ns * 1e-9, 3) for word, spent_ns in sorted(self._time_ns.items()) if spent_ns}
