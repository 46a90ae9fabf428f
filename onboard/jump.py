"""A body that comes back elsewhere: did its wheels take it there? Pure.

The motion-capture bridge believes a body again, wherever it is, once it has been steady for a while
(``BodyPose.resets``), or back in reach. Carried by hand, or another body under this name: nobody on the floor can tell,
and a pose that is wrong by that much is one that must not be driven on. So from the last pose before to the first after

    |step| <= 1.25 x way of the faster wheel + safety.motion_way_m / 2
    |turn| <= 1.25 x turn of the wheels + safety.motion_turn_rad / 2

must hold; wheels slip, but no body goes farther than its wheels roll. Feedback that is missing counts as the last one
before it or the first after, whichever is faster.
"""

import math
from collections import deque
from typing import Final, NamedTuple

from contract.arena import Safety
from contract.messages import BodyPose
from onboard.record import record

ROLL_FACTOR: Final = 1.25
MARGIN_SHARE: Final = 0.5
GAP_NS: Final = 100_000_000
"""Poses farther apart are compared although the bridge has nothing against either."""
MOST_ENTRIES: Final = 64


class Rolled(NamedTuple):
    """Of the wheels since the start, without sign."""

    stamp_ns: int
    way_m: float
    turn_rad: float


class JumpCheck:
    """Feed it every feedback and every own pose; :attr:`text` says what is wrong until :meth:`forget`."""

    def __init__(self, safety: Safety, wheel_separation_m: float) -> None:
        self.text = ""
        self._margin_m = MARGIN_SHARE * safety.motion_way_m
        self._margin_rad = MARGIN_SHARE * safety.motion_turn_rad
        self._separation_m = wheel_separation_m
        self._rolled: deque[Rolled] = deque()
        """From the newest entry no later than the last pose on."""
        self._rates = (0.0, 0.0)
        """Speed m/s and turn rate rad/s of the newest feedback, without sign."""
        self._last: BodyPose | None = None
        self._last_ns = 0
        self._doubted = False

    def feedback(self, stamp_ns: int, left_mps: float, right_mps: float) -> None:
        """Rim speeds; one not newer than the last is ignored."""
        rolled, (last_mps, last_radps) = self._rolled, self._rates
        speed_mps, turn_radps = max(abs(left_mps), abs(right_mps)), abs(right_mps - left_mps) / self._separation_m
        if rolled:
            since_ns, way_m, turn_rad = rolled[-1]
            if stamp_ns <= since_ns:
                return
            span_s = (stamp_ns - since_ns) * 1e-9
            way_m += (speed_mps if speed_mps > last_mps else last_mps) * span_s
            turn_rad += (turn_radps if turn_radps > last_radps else last_radps) * span_s
            rolled.append(record(Rolled, (stamp_ns, way_m, turn_rad)))
        else:
            rolled.append(Rolled(stamp_ns, 0.0, 0.0))
        self._rates = (speed_mps, turn_radps)
        if len(rolled) > MOST_ENTRIES:
            del rolled[1]

    def see(self, body: BodyPose | None, stamp_ns: int, active: bool) -> None:
        """Own body of a frame.

        :param active: the motors are enabled; a robot without power may be put anywhere.
        """
        if body is None or not body.valid:
            self._doubted = True
            return
        last = self._last
        if (
            active
            and last is not None
            and not self.text
            and (self._doubted or body.resets != last.resets or stamp_ns - self._last_ns > GAP_NS)
        ):
            self.text = self._judge(last, body, stamp_ns)
        self._last, self._last_ns, self._doubted = body, stamp_ns, False
        rolled = self._rolled
        while len(rolled) > 1 and rolled[1][0] <= stamp_ns:
            rolled.popleft()

    def forget(self) -> None:
        """The motors have been disabled: what was wrong is for a person to look at, what comes is not compared."""
        self.text = ""
        self._last = None

    def _judge(self, before: BodyPose, after: BodyPose, stamp_ns: int) -> str:
        way_m, turn_rad = self._rolled_since(stamp_ns)
        step_m = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
        if step_m > ROLL_FACTOR * way_m + self._margin_m:
            return f"it came back {step_m:.2f} m away, its wheels rolled {way_m:.2f} m"
        turned_rad = abs(math.remainder(after.heading_rad - before.heading_rad, math.tau))
        if turned_rad > ROLL_FACTOR * turn_rad + self._margin_rad:
            return f"it came back turned by {turned_rad:.2f} rad, its wheels turned it by {turn_rad:.2f} rad"
        return ""

    def _rolled_since(self, until_ns: int) -> tuple[float, float]:
        """Way m and turn rad from the last pose until then, at most."""
        speed_mps, turn_radps = self._rates
        if not self._rolled:
            return 0.0, 0.0
        first, newest = self._rolled[0], self._rolled[-1]
        span_s = max(0, until_ns - newest.stamp_ns) * 1e-9
        return (
            newest.way_m - first.way_m + speed_mps * span_s,
            newest.turn_rad - first.turn_rad + turn_radps * span_s,
        )
