"""The veil: from the arena's global snapshot to what one robot may sense and hear.

Only this module sees all poses. A robot with its own sensors would replace it; the law would not notice.
Range is judged at the receiver on valid poses: robots within r_c are sighted, messages from robots
farther away than r_c are not heard (the virtual radio), targets within r_c are seen.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

from msgspec.structs import replace

from contract.messages import MocapFrame, NeighbourState, TargetCloud
from onboard.ahdc.view import Heard, Sighted
from onboard.odometry import Pose

VELOCITY_BASE_NS = 40_000_000
"""Velocities are differences over at least this long: shorter ones are mostly noise."""
FORGET_NS = 3_000_000_000
"""A robot not seen for this long is no longer where it was."""


class Track(NamedTuple):
    """Valid poses of one body."""

    stamp_ns: int
    pose: Pose
    base_ns: int
    base: Pose
    vx_mps: float
    vy_mps: float


class Sensing:
    """Tracks of all bodies, newest messages of all robots; hands out only what is within range."""

    def __init__(self, robot: str, sensing_radius_m: float, silence_s: float) -> None:
        self.robot = robot
        self._radius_m = sensing_radius_m
        self._silence_ns = int(silence_s * 1e9)
        self._tracks: dict[str, Track] = {}
        self._heard: dict[str, tuple[NeighbourState, int]] = {}
        self._cloud: dict[int, tuple[float, float]] = {}
        self.mission = ""
        """Of the cloud."""
        self._newest_ns = 0
        self.out_of_range = 0
        """State messages the virtual radio swallowed."""

    def frame(self, frame: MocapFrame) -> None:
        """Take the valid poses of one frame."""
        self._newest_ns = frame.exposure_ns
        for body in frame.bodies:
            if body.valid:
                pose = Pose(body.x_m, body.y_m, body.heading_rad)
                self._tracks[body.robot] = _extend(self._tracks.get(body.robot), pose, frame.exposure_ns)

    def own(self) -> tuple[Pose, int] | None:
        """Own last valid pose and its exposure time, site ns."""
        track = self._tracks.get(self.robot)
        return None if track is None else (track.pose, track.stamp_ns)

    def cloud(self, cloud: TargetCloud) -> bool:
        """Take the targets; True where they are another mission's, so that all that was known of targets is void."""
        self._cloud = {target.index: (target.x_m, target.y_m) for target in cloud.targets}
        new = cloud.mission != self.mission
        if new:
            self.mission = cloud.mission
            self._heard = {name: (without_targets(state), at_ns) for name, (state, at_ns) in self._heard.items()}
        return new

    def in_range(self, robot: str) -> bool:
        """Whether the virtual radio reaches that robot: both seen, at most r_c apart."""
        own, other = self._tracks.get(self.robot), self._tracks.get(robot)
        return own is not None and other is not None and math.dist(own.pose[:2], other.pose[:2]) <= self._radius_m

    def state(self, state: NeighbourState, now_ns: int) -> bool:
        """Take a neighbour's message; False where it is out of range, or not newer than the last."""
        if not self.in_range(state.robot):
            self.out_of_range += 1
            return False
        known = self._heard.get(state.robot)
        if known is not None and known[0].boot == state.boot and state.seq <= known[0].seq:
            return False
        self._heard[state.robot] = (state if state.mission == self.mission else without_targets(state), now_ns)
        return True

    def sighted(self, own: Pose, now_ns: int) -> dict[str, Sighted]:
        """Robots within r_c of ``own``, at their last valid pose; those unseen for 3 s are left out."""
        result = {}
        for name, track in self._tracks.items():
            if name == self.robot or now_ns - track.stamp_ns > FORGET_NS:
                continue
            if math.dist(own[:2], track.pose[:2]) <= self._radius_m:
                age_s = max(0.0, (now_ns - track.stamp_ns) * 1e-9)
                valid = track.stamp_ns >= self._newest_ns
                result[name] = Sighted(track.pose[0], track.pose[1], track.vx_mps, track.vy_mps, age_s, valid)
        return result

    def heard(self, sighted: Iterable[str], now_ns: int) -> dict[str, Heard]:
        """Newest message of every sighted robot that has spoken."""
        result = {}
        for name in sighted:
            entry = self._heard.get(name)
            if entry is not None:
                state, arrival_ns = entry
                age_s = max(0.0, (now_ns - state.stamp_ns) * 1e-9)
                result[name] = Heard(state, age_s, now_ns - arrival_ns > self._silence_ns)
        return result

    def targets(self, own: Pose) -> dict[int, tuple[float, float]]:
        """Targets within r_c of ``own``."""
        x, y = own[0], own[1]
        square = self._radius_m * self._radius_m
        return {k: p for k, p in self._cloud.items() if (p[0] - x) ** 2 + (p[1] - y) ** 2 <= square}


def without_targets(state: NeighbourState) -> NeighbourState:
    """A message without what it says of targets."""
    return replace(
        state, task="free", claim=-1, claim_at=None, indicator=False, hops=1000, cloud_seen=False, occupied="",
        sightings=(), help=None,
    )  # fmt: skip


def _extend(track: Track | None, pose: Pose, stamp_ns: int) -> Track:
    if track is None or stamp_ns - track.stamp_ns > 10 * VELOCITY_BASE_NS or stamp_ns < track.stamp_ns:
        return Track(stamp_ns, pose, stamp_ns, pose, 0.0, 0.0)
    span_ns = stamp_ns - track.base_ns
    if span_ns < VELOCITY_BASE_NS:
        return track._replace(stamp_ns=stamp_ns, pose=pose)
    vx = (pose[0] - track.base[0]) / (span_ns * 1e-9)
    vy = (pose[1] - track.base[1]) / (span_ns * 1e-9)
    return Track(stamp_ns, pose, stamp_ns, pose, vx, vy)
