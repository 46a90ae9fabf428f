"""The veil: from the arena's global snapshot to what one robot may sense and hear.

Only this module sees all poses. A robot with its own sensors would replace it; the law would not notice.
Range is judged at the receiver on valid poses: robots within r_c are sighted, messages from robots
farther away than r_c are not heard (the virtual radio), targets within r_c are seen.
"""

import math
from collections.abc import Collection, Container, Iterable
from dataclasses import dataclass
from typing import Final

from msgspec.structs import replace

from contract.messages import BodyPose, MocapFrame, NeighbourState, TargetCloud
from onboard.ahdc.view import Heard, Left, Sighted
from onboard.cloud import Cloud, cells_of
from onboard.jump import GAP_NS, ROLL_FACTOR
from onboard.odometry import Pose
from onboard.record import record

VELOCITY_BASE_NS: Final = 40_000_000
"""Velocities are differences over at least this long: shorter ones are mostly noise."""
FORGET_NS: Final = 3_000_000_000
"""A robot not seen for this long is no longer where it was."""
STUCK_NS: Final = 300_000_000
"""The bridge finds tracking out that is stuck within this."""
NEAR_M: Final = 0.2
"""A robot that has moved farther than this in x or y looks through the whole cloud for targets again."""
NOWHERE = (math.inf, math.inf)
MOST_LEFT: Final = 4
"""Places of one robot that has jumped."""


@dataclass(slots=True)
class Track:
    """Valid poses of one body: the newest, and the two its velocity is counted from."""

    body: BodyPose
    stamp_ns: int
    base: BodyPose
    base_ns: int
    before: BodyPose | None = None
    """The base before; None: it is not known yet how fast it moves."""
    before_ns: int = 0

    def extend(self, body: BodyPose, stamp_ns: int) -> None:
        """Take a newer valid pose."""
        if stamp_ns < self.stamp_ns or stamp_ns - self.stamp_ns > 10 * VELOCITY_BASE_NS:
            self.before = None
            self.base, self.base_ns = body, stamp_ns
        elif stamp_ns - self.base_ns >= VELOCITY_BASE_NS:
            self.before, self.before_ns = self.base, self.base_ns
            self.base, self.base_ns = body, stamp_ns
        self.body, self.stamp_ns = body, stamp_ns

    def velocity(self) -> tuple[float, float]:
        """vx and vy, m/s."""
        base, before = self.base, self.before
        if before is None:
            return (0.0, 0.0)
        span_s = (self.base_ns - self.before_ns) * 1e-9
        return ((base.x_m - before.x_m) / span_s, (base.y_m - before.y_m) / span_s)


class Sensing:
    """Tracks of all bodies, newest messages of all robots; hands out only what is within range."""

    def __init__(
        self, robot: str, sensing_radius_m: float, silence_s: float, speed_mps: float = 0.8, margin_m: float = 0.06
    ) -> None:
        """:param speed_mps: of the fastest robot; one that comes back farther away, and by that margin, has jumped."""
        self.robot = robot
        self._speed_mps, self._margin_m = speed_mps, margin_m
        self._radius_m = sensing_radius_m
        self._silence_ns = int(silence_s * 1e9)
        self._own: tuple[Pose, int] | None = None
        self.own_since_ns = 0
        """When the own pose was first what it is, site ns, as far as that matters: tracking that is stuck repeats it
        until the bridge finds that out, while the wheels roll on."""
        self._others: dict[str, Track] = {}
        self._left: dict[str, list[tuple[Track, bool]]] = {}
        """Where robots were before they jumped, and whether a link was kept with them then."""
        self._within: dict[str, tuple[tuple[float, float, float, float, float, bool], int]] = {}
        """Linked robots as they were last sighted within reach, and when."""
        self._heard: dict[str, tuple[NeighbourState, int]] = {}
        self._cloud = Cloud(())
        self._near: list[tuple[int, tuple[float, float]]] = []
        """Targets that can be within r_c while the robot is within ``NEAR_M`` of ``_near_of``, in either axis."""
        self._near_of = NOWHERE
        self.mission = ""
        """Of the cloud."""
        self._newest_ns = 0
        self._retired: set[tuple[str, int]] = set()
        """Boots of robots that have spoken in a later one since."""
        self.replayed = 0
        """State messages repeated, overtaken, or of an earlier boot."""
        self.out_of_range = 0
        """State messages the virtual radio swallowed."""

    def frame(self, frame: MocapFrame, linked: Container[str] = ()) -> BodyPose | None:
        """Take the valid poses of one frame; the own body in it, valid or not.

        :param linked: robots that a link is kept with now.
        """
        me, mine = self.robot, None
        self._newest_ns = stamp_ns = frame.exposure_ns
        others = self._others
        for body in frame.bodies:
            name = body.robot
            if name == me:
                if mine is None:
                    mine = body
                if body.valid:
                    self._see_own(record(Pose, (body.x_m, body.y_m, body.heading_rad)), stamp_ns)
            elif not body.valid:
                continue
            elif (track := others.get(name)) is not None:
                if body.resets != track.body.resets or stamp_ns - track.stamp_ns > GAP_NS:
                    track = self._come_back(track, body, stamp_ns, name in linked)
                if stamp_ns < track.stamp_ns or stamp_ns - track.base_ns >= VELOCITY_BASE_NS:
                    track.extend(body, stamp_ns)
                else:  # most frames: the base stays
                    track.body, track.stamp_ns = body, stamp_ns
            else:
                others[name] = Track(body, stamp_ns, body, stamp_ns)
        return mine

    def _see_own(self, pose: Pose, stamp_ns: int) -> None:
        if self._own is None or pose != self._own[0]:
            self.own_since_ns = stamp_ns
        elif stamp_ns - self.own_since_ns > STUCK_NS:
            self.own_since_ns = stamp_ns - STUCK_NS
        self._own = (pose, stamp_ns)

    def _come_back(self, track: Track, body: BodyPose, stamp_ns: int, linked: bool) -> Track:
        """The track to go on with; after a jump the old place is kept."""
        gap_ns, was = stamp_ns - track.stamp_ns, track.body
        step_m = math.hypot(body.x_m - was.x_m, body.y_m - was.y_m)
        if step_m <= ROLL_FACTOR * self._speed_mps * gap_ns * 1e-9 + self._margin_m:
            return track
        if linked or gap_ns <= FORGET_NS:
            self._left[body.robot] = [*self._left.get(body.robot, ()), (track, linked)][-MOST_LEFT:]
        fresh = self._others[body.robot] = Track(body, stamp_ns, body, stamp_ns)
        return fresh

    def left(self, now_ns: int, excluded: Collection[str]) -> list[Left]:
        """Where robots were before they jumped: each may be there still, or be where it is seen.

        Nothing on the floor can tell, so it ends with the robot's exclusion or with :meth:`settle`.
        """
        if not self._left:
            return []
        for name in excluded:
            self._left.pop(name, None)
        return [
            Left(name, _sighted(at, now_ns), linked) for name, places in self._left.items() for at, linked in places
        ]

    def settle(self) -> None:
        """This robot was released: somebody has looked at the floor."""
        self._left.clear()
        self._within.clear()

    def beyond(self, robots: Iterable[str]) -> list[str]:
        """Which of these are farther away than r_c, by where they and this robot were last seen."""
        if self._own is None:
            return []
        (x, y, _), _ = self._own
        seen = ((name, self._others[name].body) for name in robots if name in self._others)
        return [name for name, at in seen if math.hypot(at.x_m - x, at.y_m - y) > self._radius_m]

    def own(self) -> tuple[Pose, int] | None:
        """Own last valid pose and the exposure time of the last frame with it, site ns."""
        return self._own

    def cloud(self, cloud: TargetCloud) -> bool:
        """Take the targets; True where they are another mission's, so that all that was known of targets is void."""
        self._cloud = cells_of(cloud.targets)
        self._near_of = NOWHERE
        new = cloud.mission != self.mission
        if new:
            self.mission = cloud.mission
            self._heard = {name: (without_targets(state), at_ns) for name, (state, at_ns) in self._heard.items()}
        return new

    def in_range(self, robot: str, told: tuple[float, float] | None = None) -> bool:
        """Whether the virtual radio reaches that robot: both have been seen, and are at most r_c apart.

        One that is not seen just now is where it says it is, for it may have left where it was seen last.

        :param told: x and y by its own account, m; None: not known yet, so that one that is not seen may be in reach.
        """
        own, other = self._own, self._others.get(robot)
        if own is None or other is None:
            return False
        there = (other.body.x_m, other.body.y_m)
        if other.stamp_ns < self._newest_ns:
            if told is None:
                return True
            there = told
        x, y, _ = own[0]
        return math.hypot(x - there[0], y - there[1]) <= self._radius_m

    def state(self, state: NeighbourState, now_ns: int) -> bool:
        """Take a neighbour's message; False where it is out of range, not newer than the last, or of a past boot."""
        if not self.in_range(state.robot, (state.x_m, state.y_m)):
            self.out_of_range += 1
            return False
        known = self._heard.get(state.robot)
        if known is not None:
            last = known[0]
            if state.boot == last.boot:
                replayed = state.seq <= last.seq
            else:
                replayed = (state.robot, state.boot) in self._retired or state.stamp_ns < last.stamp_ns
                if not replayed:
                    self._retired.add((state.robot, last.boot))
            if replayed:
                self.replayed += 1
                return False
        self._heard[state.robot] = (state if state.mission == self.mission else without_targets(state), now_ns)
        return True

    def sighted(self, own: Pose, now_ns: int, linked: Container[str] = ()) -> dict[str, Sighted]:
        """Robots within r_c of ``own``, at their last valid pose.

        Those unseen for 3 s are left out. One that is linked stays, however long it is unseen and however far away it
        was last: the link binds wherever it has gone since. Seen to be out of reach, it stays where it was within.
        """
        own_x, own_y, _ = own
        radius_m, newest_ns, within = self._radius_m, self._newest_ns, self._within
        result = {}
        for name, track in self._others.items():
            body, stamp_ns = track.body, track.stamp_ns
            x, y = body.x_m, body.y_m
            if math.hypot(own_x - x, own_y - y) <= radius_m or (stamp_ns < newest_ns and name in linked):
                age_ns = now_ns - stamp_ns
                if age_ns <= FORGET_NS or name in linked:
                    age_s = age_ns * 1e-9 if age_ns > 0 else 0.0
                    seen = (x, y, *track.velocity(), age_s, stamp_ns >= newest_ns)
                    result[name] = record(Sighted, seen)
                    if name in linked:
                        within[name] = (seen, now_ns)
            elif name in within and name in linked:
                (x, y, vx, vy, age_s, _), then_ns = within[name]
                result[name] = Sighted(x, y, vx, vy, age_s + (now_ns - then_ns) * 1e-9, False)
        return result

    def heard(self, sighted: Iterable[str], now_ns: int) -> dict[str, Heard]:
        """Newest message of every sighted robot that has spoken."""
        silence_ns, known = self._silence_ns, self._heard
        result = {}
        for name in sighted:
            if name in known:
                state, arrival_ns = known[name]
                age_ns = now_ns - state.stamp_ns
                age_s = age_ns * 1e-9 if age_ns > 0 else 0.0
                result[name] = record(Heard, (state, age_s, now_ns - arrival_ns > silence_ns))
        return result

    def targets(self, own: Pose) -> dict[int, tuple[float, float]]:
        """Targets within r_c of ``own``."""
        x, y, _ = own
        near_x, near_y = self._near_of
        if not (abs(x - near_x) <= NEAR_M and abs(y - near_y) <= NEAR_M):
            self._near_of = (x, y)
            reach_m = self._radius_m + 2 * NEAR_M
            self._near = self._cloud.about(x, y, reach_m)
        square = self._radius_m * self._radius_m
        result = {}
        for index, place in self._near:
            dx, dy = place[0] - x, place[1] - y
            if dx * dx + dy * dy <= square:
                result[index] = place
        return result


def _sighted(track: Track, now_ns: int) -> Sighted:
    age_s = max(0.0, (now_ns - track.stamp_ns) * 1e-9)
    return Sighted(track.body.x_m, track.body.y_m, *track.velocity(), age_s, False)


def without_targets(state: NeighbourState) -> NeighbourState:
    """A message without what it says of targets."""
    return replace(
        state, task="free", claim=-1, claim_at=None, indicator=False, hops=1000, cloud_seen=False, occupied="",
        sightings=(), claims=(), help=None,
    )  # fmt: skip
