"""A body against its own earlier frames and the other bodies: jumps, changed places, return after a rejection. Pure."""

import math

from mocap_bridge.frames import Pose
from mocap_bridge.natnet.frame import Body
from mocap_bridge.track import Track

JUMP_MARGIN_M = 0.03
JUMP_CAP_S = 0.5
TURN_RADPS = 20.0
TURN_MARGIN_RAD = 0.35
REACQUIRE_FRAMES = 5
SWAP_RADIUS_M = 0.25
SWAP_STEP_M = 0.08
"""Shorter steps are never a change of places: bodies do not come so close."""
FORGET_NS = 30_000_000_000
"""A body unseen for longer has left its place."""

_SURE_STEP_M2 = 0.99 * SWAP_STEP_M**2
SURE_NORM2 = 1.001
_SURE_NORMS = 1.03 * SURE_NORM2
"""No less than the product of two squared norms that pass the checks, one of them below :data:`SURE_NORM2`."""

Seen = tuple[Track, Pose, Body]
"""A body of this frame that stands the checks of one frame."""


class Continuity:
    """Judges what stands the checks of one frame against the frames before, with all bodies in sight."""

    def __init__(self, tracks: list[Track], speed_mps: float) -> None:
        self._tracks = tracks
        self._speed_mps = speed_mps
        self.last_ns = -1
        """Exposure of the last frame; the caller's to keep."""

    def restart(self) -> None:
        """The source has started anew: nothing is believed yet."""
        for track in self._tracks:
            track.accepted_ns = -1
            track.candidate = None
            track.resets += 1
        self.last_ns = -1

    def sure(self, now_ns: int) -> tuple[float, float]:
        """What a body that was believed in the last frame needs no judge for, with room for rounding.

        The square of a step that is neither a jump nor a change of places, and the square of the product of its
        quaternion, of norm near 1, with the last above which it has not turned too far.
        """
        farthest, smallest = self._limits(now_ns - self.last_ns)
        return min(0.99 * farthest, _SURE_STEP_M2), _SURE_NORMS * smallest

    def judge(self, seen: list[Seen | None], steady: list[Seen], doubted: list[Seen], now_ns: int) -> None:
        """Believe the bodies ``steady``; believe those ``doubted``, or give the track the reason why not.

        Both go by the order of the tracks; ``seen`` has an entry for every track.
        """
        self._judge(seen, doubted, now_ns)
        for track, pose, body in steady:
            track.pose = track.place = pose
            track.believed = body
            track.accepted_ns = now_ns
        self._follow_places(seen, now_ns)

    def _judge(self, seen: list[Seen | None], doubted: list[Seen], now_ns: int) -> None:
        usual_ns, usual = self.last_ns, self._limits(now_ns - self.last_ns)
        accepted: list[Seen] = []
        for track, pose, body in doubted:
            if track.accepted_ns < 0:
                accepted.append((track, pose, body))
                continue
            limits = usual if track.accepted_ns == usual_ns else self._limits(now_ns - track.accepted_ns)
            fault = _step_fault(track.pose, track.believed, pose, body, limits)
            if track.candidate is not None:
                fault = self._reacquire(track, pose, body, fault, seen, now_ns)
            elif not fault and _apart(track.pose, pose) > SWAP_STEP_M and self._took_place(track, pose, seen, now_ns):
                fault = "swap_suspect"
            if not fault:
                accepted.append((track, pose, body))
                continue
            track.reason = fault
            if track.candidate is None:
                track.consistent = 0
            track.candidate, track.candidate_ns = (pose, body), now_ns
        for track, pose, body in accepted:
            if track.accepted_ns != usual_ns or track.accepted_ns < 0:
                track.since_ns = now_ns
            track.pose = track.place = pose
            track.believed = body
            track.accepted_ns, track.candidate = now_ns, None

    def _limits(self, elapsed_ns: int) -> tuple[float, float]:
        """Squares of the farthest step, and of the smallest quaternion product, in so much time."""
        elapsed_s = min(max(elapsed_ns, 0) * 1e-9, JUMP_CAP_S)
        turn = min(TURN_RADPS * elapsed_s + TURN_MARGIN_RAD, math.pi)
        return (self._speed_mps * elapsed_s + JUMP_MARGIN_M) ** 2, math.cos(0.5 * turn) ** 2

    def _follow_places(self, seen: list[Seen | None], now_ns: int) -> None:
        """Robots under a wrong name move on: their places move with them."""
        doubted = [
            (track, entry[1])
            for track, entry in zip(self._tracks, seen, strict=True)
            if entry is not None and track.accepted_ns != now_ns
        ]
        if not doubted:
            return
        for track in self._tracks:
            if track.accepted_ns == now_ns or track.accepted_ns < 0:
                continue
            near = [pose for other, pose in doubted if other is not track and _apart(pose, track.place) < SWAP_RADIUS_M]
            if near:
                track.place = min(near, key=lambda pose: _apart(pose, track.place))

    def _reacquire(self, track: Track, pose: Pose, body: Body, fault: str, seen: list[Seen | None], now_ns: int) -> str:
        """Back where it belongs: believed at once. Elsewhere: after steady frames, unless places were changed."""
        assert track.candidate is not None
        limits = self._limits(now_ns - track.candidate_ns)
        if _step_fault(*track.candidate, pose, body, limits):
            track.consistent = 0
            return fault
        track.consistent += 1
        if track.consistent < REACQUIRE_FRAMES:
            return "reacquiring"
        if self._near_lost_place(track, seen) or self._took_place(track, pose, seen, now_ns):
            return "swap_suspect"
        track.resets += 1
        return ""

    def _near_lost_place(self, track: Track, seen: list[Seen | None]) -> bool:
        """Whether a body that has not been followed all the while stands where this one must be."""
        for other, entry in zip(self._tracks, seen, strict=True):
            if other is track or entry is None:
                continue
            followed = other.candidate is None and other.accepted_ns >= 0 and other.since_ns <= track.accepted_ns
            if not followed and _apart(entry[1], track.place) < SWAP_RADIUS_M:
                return True
        return False

    def _took_place(self, track: Track, pose: Pose, seen: list[Seen | None], now_ns: int) -> bool:
        """Whether the body stands where another one must be that is not there itself."""
        limit = min(SWAP_RADIUS_M, _apart(track.place, pose))
        for other, entry in zip(self._tracks, seen, strict=True):
            if other is track or other.accepted_ns < 0 or now_ns - other.accepted_ns > FORGET_NS:
                continue
            away = _apart(pose, other.place)
            if away < limit and (entry is None or _apart(entry[1], other.place) > away):
                return True
        return False


def _apart(first: Pose, second: Pose) -> float:
    return math.hypot(first.x_m - second.x_m, first.y_m - second.y_m, first.z_m - second.z_m)


def _turned(before: Body, after: Body, smallest: float) -> bool:
    """Whether the square of the quaternions' product, of unit quaternions, is below ``smallest``."""
    _, _, _, _, ax, ay, az, aw, _, _ = before
    _, _, _, _, bx, by, bz, bw, _, _ = after
    dot = ax * bx + ay * by + az * bz + aw * bw
    norms = (ax * ax + ay * ay + az * az + aw * aw) * (bx * bx + by * by + bz * bz + bw * bw)
    return dot * dot < smallest * norms


def _step_fault(before: Pose, before_body: Body, after: Pose, after_body: Body, limits: tuple[float, float]) -> str:
    """``jump``, ``rotation_jump`` or nothing for a step between two poses."""
    dx, dy, dz = after.x_m - before.x_m, after.y_m - before.y_m, after.z_m - before.z_m
    if dx * dx + dy * dy + dz * dz > limits[0]:
        return "jump"
    return "rotation_jump" if _turned(before_body, after_body, limits[1]) else ""
