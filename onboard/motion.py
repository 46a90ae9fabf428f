"""Wheel feedback against poses: does this body do what these wheels do? Pure.

Over a window of ``safety.motion_window_s`` the wheels' way and turn (integrated feedback) are compared with the
tracked body's: its displacement along and across its heading, and its change of heading. They are judged only once
the wheels, the commands or the body have moved far enough (``safety.motion_way_m``, ``safety.motion_turn_rad``) for
noise, slip and a pose's age not to matter, and agree while the body does more than ``1 - safety.motion_share`` of
what the wheels say.

    wheels turn, body still                     lifted, slipping or held
    a wheel commanded, but still                stuck
    body moves, wheels still                    wrong body, or carried away
    body moves across its heading               heading offset wrong, or wrong body
    body moves backwards                        heading inverted; where it turns backwards as well, both wheels
    body turns the other way                    wheels swapped
    body and wheels part in between             one of these since a moment ago

A wheel told to go back and forth turns little, however much is asked of it. So what is asked is what every wheel no
slower than the slowest calibrated one would have rolled under these commands: see :mod:`onboard.expected`.
"""

import math
from collections import deque
from typing import Final, Literal, NamedTuple

from contract.arena import Safety
from contract.messages import BodyPose
from onboard.expected import Expected, Plant
from onboard.odometry import Pose
from onboard.record import record

SAMPLE_NS: Final = 40_000_000
"""Poses are compared at this distance: nearer ones differ mostly by noise."""
REACH_NS: Final = 60_000_000
"""The last feedback is carried on this far, not farther."""
STILL_SHARE: Final = 0.25
"""Of ``motion_way_m`` or ``motion_turn_rad``: below it wheels, or a body, stand."""
GAP_NS: Final = 150_000_000
"""What wheels did between two feedbacks farther apart than this, nobody knows: this process or the wire stood still."""
CARRIED_FACTOR: Final = 1.5
PIVOT_M: Final = 0.03
"""A body's origin may be this far from the middle of the axle: turning then moves it across."""

Kind = Literal[
    "", "lifted", "stuck", "wrong body", "sideways", "inverted heading", "inverted wheels", "swapped wheels", "parted"
]

TEXT: dict[Kind, str] = {
    "": "",
    "lifted": "wheels turn, body still: lifted, slipping or held",
    "stuck": "a wheel is commanded but does not turn: stuck",
    "wrong body": "body moves, wheels still: wrong body, or carried away",
    "sideways": "body moves across its heading: heading offset wrong, or wrong body",
    "inverted heading": "body moves backwards: heading inverted, or wrong body",
    "inverted wheels": "body moves and turns backwards: both wheels inverted, or wrong body",
    "swapped wheels": "body turns the other way: wheels swapped, or wrong body",
    "parted": "body and wheels have parted: an encoder or a wheel has failed on the way, or wrong body",
}


class Ways(NamedTuple):
    """Integrated since the start: of the wheels, and of what was to be expected of them."""

    stamp_ns: int
    way_m: float = 0.0
    turn_rad: float = 0.0
    left_m: float = 0.0
    """Of the left rim, without sign, as those below."""
    right_m: float = 0.0
    left_asked_m: float = 0.0
    right_asked_m: float = 0.0


class Sample(NamedTuple):
    """The wheels and the body at one pose's time."""

    wheels: Ways
    forward_m: float
    """Of the body along its heading, integrated."""
    left_m: float
    heading_rad: float
    """Unwrapped."""
    pose: Pose


class MotionCheck:
    """Feed it every feedback, command and own pose; ask :attr:`kind`."""

    def __init__(self, safety: Safety, wheel_separation_m: float, slow: Plant) -> None:
        self.kind: Kind = ""
        self._safety = safety
        self._separation_m = wheel_separation_m
        self._window_ns = int(safety.motion_window_s * 1e9)
        self._kept_ns = 2 * self._window_ns + 1_000_000_000
        self._rims = (0.0, 0.0)
        self._asked = (0.0, 0.0)
        self._slow = slow
        self._expected = (Expected(slow), Expected(slow))
        self._ways: deque[Ways] = deque()
        self._samples: deque[Sample] = deque()
        self._resets = 0
        self._seen: tuple[int, BodyPose] | None = None
        """Newest valid pose not yet compared with the wheels, and its time."""

    @property
    def text(self) -> str:
        """What is wrong, in words; empty where nothing is."""
        return TEXT[self.kind]

    def forget(self) -> None:
        """The pose is not valid, has jumped, or the motors are off: begin anew."""
        self.kind = ""
        self._samples.clear()

    def _begin_anew(self) -> None:
        """Nothing is known of the wheels before now; they may have stood."""
        self._ways.clear()
        self._samples.clear()
        self._expected = (Expected(self._slow), Expected(self._slow))

    def command(self, left_mps: float, right_mps: float) -> None:
        """Rim speeds asked of the wheels from now on."""
        self._asked = (left_mps, right_mps)

    def feedback(self, stamp_ns: int, left_mps: float, right_mps: float) -> None:
        """Measured rim speeds; a stamp that is not newer is ignored."""
        ways = self._ways
        last = ways[-1] if ways else Ways(stamp_ns)
        span_ns = stamp_ns - last[0]
        if span_ns <= 0 and ways:
            return
        if span_ns > GAP_NS:
            self._begin_anew()
            ways, last, span_ns = self._ways, Ways(stamp_ns), 0
        (left, right), (left_to, right_to), (left_rim, right_rim) = self._rims, self._asked, self._expected
        left_m, right_m = left_rim.roll(left_to, span_ns * 1e-9), right_rim.roll(right_to, span_ns * 1e-9)
        ways.append(self._carry(last, stamp_ns, (left + left_mps) / 2, (right + right_mps) / 2, left_m, right_m))
        self._rims = (left_mps, right_mps)
        while ways[0][0] < stamp_ns - self._kept_ns:
            ways.popleft()

    def see(self, body: BodyPose | None, stamp_ns: int) -> None:
        """The own body in the newest frame. Where its pose breaks off begins anew at once, a good one waits."""
        if body is None or not body.valid or body.resets != self._resets:
            self._resets = body.resets if body is not None else self._resets
            self._seen = None
            self.forget()
        else:
            self._seen = (stamp_ns, body)

    def compare(self, active: bool) -> None:
        """Judge the pose that waits, if any; without active motors it is dropped."""
        seen, self._seen = self._seen, None
        if seen is not None and active:
            stamp_ns, body = seen
            self.pose(stamp_ns, record(Pose, (body.x_m, body.y_m, body.heading_rad)))

    def pose(self, stamp_ns: int, pose: Pose) -> None:
        """An own, valid pose; judges."""
        if self._samples and stamp_ns - self._samples[-1].wheels.stamp_ns < SAMPLE_NS:
            return
        wheels = self._at(stamp_ns)
        if wheels is None:
            self.forget()
            return
        if not self._samples:
            self._samples.append(Sample(wheels, 0.0, 0.0, pose.heading_rad, pose))
            return
        last = self._samples[-1]
        turn = math.remainder(pose.heading_rad - last.pose.heading_rad, math.tau)
        middle = last.pose.heading_rad + turn / 2
        dx, dy = pose.x_m - last.pose.x_m, pose.y_m - last.pose.y_m
        forward = dx * math.cos(middle) + dy * math.sin(middle)
        left = dy * math.cos(middle) - dx * math.sin(middle)
        new = Sample(wheels, last.forward_m + forward, last.left_m + left, last.heading_rad + turn, pose)
        self._samples.append(new)
        while len(self._samples) > 2 and self._samples[1].wheels.stamp_ns <= stamp_ns - self._window_ns:
            self._samples.popleft()
        if stamp_ns - self._samples[0].wheels.stamp_ns >= self._window_ns:
            self.kind = judge(self._samples[0], new, self._safety, self._separation_m)

    def _at(self, stamp_ns: int) -> Ways | None:
        """The integrals at that time; None where no feedback tells."""
        if not self._ways or stamp_ns < self._ways[0].stamp_ns or stamp_ns > self._ways[-1].stamp_ns + REACH_NS:
            return None
        after = self._ways[-1]
        if stamp_ns >= after.stamp_ns:
            span_s = (stamp_ns - after.stamp_ns) * 1e-9
            return self._carry(after, stamp_ns, *self._rims, *(rim.speed_mps * span_s for rim in self._expected))
        for before in reversed(self._ways):
            if before.stamp_ns <= stamp_ns:
                share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
                return Ways(stamp_ns, *(a + share * (b - a) for a, b in zip(before[1:], after[1:], strict=True)))
            after = before
        return None

    def _carry(
        self, last: Ways, stamp_ns: int, left: float, right: float, left_asked: float, right_asked: float
    ) -> Ways:
        """The integrals after that, with these rim speeds in between and so many metres asked."""
        since_ns, way_m, turn_rad, left_m, right_m, left_asked_m, right_asked_m = last
        span_s = (stamp_ns - since_ns) * 1e-9
        ways = (
            stamp_ns,
            way_m + (left + right) / 2 * span_s,
            turn_rad + (right - left) / self._separation_m * span_s,
            left_m + abs(left) * span_s,
            right_m + abs(right) * span_s,
            left_asked_m + left_asked,
            right_asked_m + right_asked,
        )
        return record(Ways, ways)


def judge(first: Sample, last: Sample, safety: Safety, separation_m: float) -> Kind:
    """What the difference of two samples says."""
    pairs = zip(first.wheels[1:], last.wheels[1:], strict=True)
    wheels = Ways(last.wheels.stamp_ns - first.wheels.stamp_ns, *(b - a for a, b in pairs))
    way, turn = wheels.way_m, wheels.turn_rad
    forward, left = last.forward_m - first.forward_m, last.left_m - first.left_m
    turned = last.heading_rad - first.heading_rad
    still_m = STILL_SHARE * safety.motion_way_m
    still_rad = STILL_SHARE * safety.motion_turn_rad
    rims = ((wheels.left_m, wheels.left_asked_m), (wheels.right_m, wheels.right_asked_m))
    if any(rolled < still_m and asked >= safety.motion_way_m for rolled, asked in rims):
        return "stuck"
    if wheels.left_m + wheels.right_m < 2 * still_m:
        return "wrong body" if math.hypot(forward, left) >= CARRIED_FACTOR * safety.motion_way_m else ""
    stands = math.hypot(forward, left) < still_m and abs(turned) < still_rad
    sure_way, sure_turn = abs(way) >= safety.motion_way_m, abs(turn) >= safety.motion_turn_rad
    if stands and (sure_way or sure_turn):
        return "lifted"
    agree = 1.0 - safety.motion_share
    turns_back = sure_turn and turned * math.copysign(1.0, turn) < -agree * abs(turn)
    if sure_way:
        ahead = forward * math.copysign(1.0, way)
        if ahead < -agree * abs(way):
            return "inverted wheels" if turns_back else "inverted heading"
        if abs(left) > agree * abs(way) + PIVOT_M * abs(turn):
            return "sideways"
        if ahead < agree * abs(way):
            return "lifted"
    if turns_back:
        return "swapped wheels"
    rolled_m = (wheels.left_m + wheels.right_m) / 2
    rolled_rad = (wheels.left_m + wheels.right_m) / separation_m
    apart_m = safety.motion_share * rolled_m + PIVOT_M * abs(turn)
    parted = rolled_m >= safety.motion_way_m and abs(forward - way) > apart_m
    spun = rolled_rad >= safety.motion_turn_rad and abs(turned - turn) > safety.motion_share * rolled_rad
    return "parted" if parted or spun else ""
