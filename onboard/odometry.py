"""Dead reckoning: own pose from its mid-exposure time to now, by measured wheel speeds.

Wheels that have not been heard of for a while may do anything: what the body does counts as theirs then.
"""

import math
from collections import deque
from typing import Final, NamedTuple

from onboard.record import record

BASE_NS: Final = 100_000_000
"""Over this long, at least, a body's motion is counted; over less most of it is noise."""
NEVER_NS: Final = -(1 << 62)
STALE_NS: Final = 400_000_000
"""Over more it says nothing of now."""
STANDS_MPS: Final = 0.05
STANDS_RADPS: Final = 0.3
"""A body slower than both stands, as far as its poses tell."""
MOST_MPS: Final = 3.0
"""No body is faster: it has jumped."""


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

    def __init__(self, wheel_separation_m: float, horizon_s: float = 0.5, silence_s: float = 0.25) -> None:
        """:param silence_s: without feedback for longer, poses tell what the wheels do."""
        self._separation_m = wheel_separation_m
        self._silence_ns = int(silence_s * 1e9)
        self._heard_ns = NEVER_NS
        """The newest feedback."""
        self._base: tuple[Pose, int] | None = None
        self._horizon_ns = int(horizon_s * 1e9)
        self._history: deque[tuple[int, float, float]] = deque()
        self._carried: tuple[Pose, int, Pose, int] | None = None
        """A pose older than half the horizon and its time, what the wheels had made of it since, and by when."""
        self.rims = (0.0, 0.0)
        """Latest measured rim speeds, left and right, m/s."""

    def record(self, stamp_ns: int, left_mps: float, right_mps: float) -> None:
        """Add a measurement; one not newer than the last is ignored."""
        if stamp_ns > self._heard_ns:
            self._heard_ns = stamp_ns
            self._add(stamp_ns, left_mps, right_mps)

    def seen(self, pose: Pose, stamp_ns: int) -> None:
        """Own valid pose: of use while the wheels are silent."""
        if self._base is None:
            self._base = (pose, stamp_ns)
            return
        before, since_ns = self._base
        span_ns = stamp_ns - since_ns
        if 0 <= span_ns < BASE_NS:
            return
        self._base = (pose, stamp_ns)
        if stamp_ns - self._heard_ns <= self._silence_ns or not 0 < span_ns <= STALE_NS:
            return
        span_s = span_ns * 1e-9
        turn_rad = math.remainder(pose.heading_rad - before.heading_rad, math.tau)
        middle = before.heading_rad + turn_rad / 2
        way_m = (pose.x_m - before.x_m) * math.cos(middle) + (pose.y_m - before.y_m) * math.sin(middle)
        speed, turn = way_m / span_s, turn_rad / span_s
        if abs(speed) > MOST_MPS:
            return
        if abs(speed) < STANDS_MPS and abs(turn) < STANDS_RADPS:
            speed = turn = 0.0
        half = turn * self._separation_m / 2
        self._add(stamp_ns, speed - half, speed + half)

    def _add(self, stamp_ns: int, left_mps: float, right_mps: float) -> None:
        history = self._history
        if history and stamp_ns <= history[-1][0]:
            return
        history.append((stamp_ns, left_mps, right_mps))
        self.rims = (left_mps, right_mps)
        while len(history) > 2 and history[1][0] < stamp_ns - self._horizon_ns:
            history.popleft()

    def predict(self, pose: Pose, from_ns: int, to_ns: int) -> Pose:
        """``pose``, valid at ``from_ns``, carried on to ``to_ns``; without measurements it stays.

        One older than the horizon counts whole if it has been asked for since it was younger than half of that.
        """
        if to_ns - from_ns > self._horizon_ns // 2:
            pose, from_ns = self._carry(pose, from_ns, to_ns - self._horizon_ns // 2)
        return self._roll(pose, from_ns, to_ns)

    def _carry(self, pose: Pose, from_ns: int, to_ns: int) -> tuple[Pose, int]:
        """The pose at that time, and the time: by what is remembered, for the history forgets."""
        begin, begin_ns = pose, from_ns
        if self._carried is not None and self._carried[:2] == (pose, from_ns):
            _, _, begin, begin_ns = self._carried
        if to_ns > begin_ns:
            begin, begin_ns = self._roll(begin, begin_ns, to_ns), to_ns
            self._carried = (pose, from_ns, begin, begin_ns)
        return begin, begin_ns

    def _roll(self, pose: Pose, from_ns: int, to_ns: int) -> Pose:
        """Along the history, no farther back than it reaches."""
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
