"""Dead reckoning: own pose from its mid-exposure time to now, by measured wheel speeds."""

import math
from collections import deque
from typing import NamedTuple

from onboard.ahdc.parameters import record


class Pose(NamedTuple):
    """Arena frame: m, m, rad."""

    x_m: float
    y_m: float
    heading_rad: float


def advance(pose: Pose, speed_mps: float, turn_rate_radps: float, duration_s: float) -> Pose:
    """The pose after constant speed and turn rate (exact arc)."""
    return Pose(*_arc(*pose, speed_mps, turn_rate_radps, duration_s))


def _arc(
    x_m: float, y_m: float, heading_rad: float, speed_mps: float, turn_rate_radps: float, duration_s: float
) -> tuple[float, float, float]:
    turn = turn_rate_radps * duration_s
    way = speed_mps * duration_s
    half = turn / 2
    chord = way if -1e-6 < turn < 1e-6 else way * math.sin(half) / half
    middle = heading_rad + half
    return (x_m + chord * math.cos(middle), y_m + chord * math.sin(middle), heading_rad + turn)


class Odometry:
    """A short history of rim speeds: linear between measurements, the last one holds."""

    def __init__(self, wheel_separation_m: float, horizon_s: float = 0.5) -> None:
        self._separation_m = wheel_separation_m
        self._horizon_ns = int(horizon_s * 1e9)
        self._history: deque[tuple[int, float, float]] = deque()
        self.rims = (0.0, 0.0)
        """Latest measured rim speeds, left and right, m/s."""

    def record(self, stamp_ns: int, left_mps: float, right_mps: float) -> None:
        """Add a measurement; one not newer than the last is ignored."""
        history = self._history
        if history and stamp_ns <= history[-1][0]:
            return
        history.append((stamp_ns, left_mps, right_mps))
        self.rims = (left_mps, right_mps)
        while len(history) > 2 and history[1][0] < stamp_ns - self._horizon_ns:
            history.popleft()

    def predict(self, pose: Pose, from_ns: int, to_ns: int) -> Pose:
        """``pose``, valid at ``from_ns``, carried on to ``to_ns``; without measurements it stays."""
        history = self._history
        if not history or to_ns <= from_ns:
            return pose
        later: list[tuple[int, float, float]] = []
        for sample in reversed(history):
            if sample[0] <= from_ns:
                break
            later.append(sample)
        else:
            later.pop()
        stamp_ns, left, right = sample
        separation_m = self._separation_m
        x, y, heading = pose
        begin = from_ns
        while later and begin < to_ns:
            next_ns, next_left, next_right = sample = later.pop()
            end = next_ns if next_ns < to_ns else to_ns
            share = ((begin + end) / 2 - stamp_ns) / (next_ns - stamp_ns)
            if share < 0.0:
                share = 0.0
            elif share > 1.0:
                share = 1.0
            left, right = left + share * (next_left - left), right + share * (next_right - right)
            if end > begin:
                speed, turn_rate = (left + right) / 2, (right - left) / separation_m
                x, y, heading = _arc(x, y, heading, speed, turn_rate, (end - begin) * 1e-9)
            stamp_ns, left, right = sample
            begin = next_ns
        if begin < to_ns:
            speed, turn_rate = (left + right) / 2, (right - left) / separation_m
            x, y, heading = _arc(x, y, heading, speed, turn_rate, (to_ns - begin) * 1e-9)
        return record(Pose, (x, y, heading))
