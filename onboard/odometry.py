"""Dead reckoning: own pose from its mid-exposure time to now, by measured wheel speeds."""

import math
from collections import deque
from typing import NamedTuple


class Pose(NamedTuple):
    """Arena frame: m, m, rad."""

    x_m: float
    y_m: float
    heading_rad: float


def advance(pose: Pose, speed_mps: float, turn_rate_radps: float, duration_s: float) -> Pose:
    """The pose after constant speed and turn rate (exact arc)."""
    turn = turn_rate_radps * duration_s
    way = speed_mps * duration_s
    chord = way if abs(turn) < 1e-6 else way * math.sin(turn / 2) / (turn / 2)
    middle = pose.heading_rad + turn / 2
    return Pose(pose.x_m + chord * math.cos(middle), pose.y_m + chord * math.sin(middle), pose.heading_rad + turn)


class Odometry:
    """A short history of rim speeds: linear between measurements, the last one holds."""

    def __init__(self, wheel_separation_m: float, horizon_s: float = 0.5) -> None:
        self._separation_m = wheel_separation_m
        self._horizon_ns = int(horizon_s * 1e9)
        self._history: deque[tuple[int, float, float]] = deque()

    def record(self, stamp_ns: int, left_mps: float, right_mps: float) -> None:
        """Add a measurement; one not newer than the last is ignored."""
        history = self._history
        if history and stamp_ns <= history[-1][0]:
            return
        history.append((stamp_ns, left_mps, right_mps))
        while len(history) > 2 and history[1][0] < stamp_ns - self._horizon_ns:
            history.popleft()

    @property
    def rims(self) -> tuple[float, float]:
        """Latest measured rim speeds, m/s."""
        return (self._history[-1][1], self._history[-1][2]) if self._history else (0.0, 0.0)

    def predict(self, pose: Pose, from_ns: int, to_ns: int) -> Pose:
        """``pose``, valid at ``from_ns``, carried on to ``to_ns``; without measurements it stays."""
        history = self._history
        if not history or to_ns <= from_ns:
            return pose
        start = len(history) - 1
        while start > 0 and history[start][0] > from_ns:
            start -= 1
        for index in range(start, len(history)):
            stamp_ns, left, right = history[index]
            begin = max(from_ns, stamp_ns) if index > start else from_ns
            end = to_ns
            if index + 1 < len(history):
                next_ns, next_left, next_right = history[index + 1]
                end = min(to_ns, next_ns)
                share = min(1.0, max(0.0, ((begin + end) / 2 - stamp_ns) / (next_ns - stamp_ns)))
                left, right = left + share * (next_left - left), right + share * (next_right - right)
            if end > begin:
                pose = advance(pose, (left + right) / 2, (right - left) / self._separation_m, (end - begin) * 1e-9)
        return pose
