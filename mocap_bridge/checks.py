"""What has to hold before a pose is believed; every refusal has a reason and is counted. Pure.

No filtering: a body's pose is published as it came, with a verdict. The order of the checks is
that of :data:`REASONS`; the first that fails names the reason.
"""

import math
from math import floor, isfinite

from contract.arena import Arena
from contract.messages import BodyPose
from mocap_bridge.continuity import SURE_NORM2, Continuity, Seen
from mocap_bridge.frames import ArenaFrame, Pose
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.track import Track

REASONS = {
    "missing": "not in the frame",
    "edit_mode": "the source plays back or edits, it is not live",
    "occluded": "the source has lost sight of the body",
    "not_finite": "a coordinate is not a finite number",
    "quaternion_norm": "the rotation's norm is not 1",
    "units": "more than 50 m away: wrong unit or origin",
    "tilted": "the body leans by more than 45 degrees: fallen, lifted, or the wrong up_axis",
    "outside_arena": "not on the floor of the arena file",
    "marker_error": "the markers do not fit the body",
    "frozen": "bit for bit the same pose for too long",
    "jump": "farther from the last pose than a body can move",
    "rotation_jump": "turned farther than a body can turn",
    "swap_suspect": "seems to have changed places with another body",
    "reacquiring": "seen again, not yet steady",
}
"""Reasons that :attr:`contract.messages.BodyPose.reason` can have."""

QUATERNION_NORM_ERROR = 0.01
FREEZE_NS = 250_000_000
MARKER_ERROR_WARN_M = 0.002
MARKER_ERROR_M = 0.010
FAR_M = 50.0
TILT_COS = math.cos(math.radians(45.0))
BOX_MARGIN_M = 0.1
BOX_HEIGHT_M = 2.5

_NORM_LOW, _NORM_HIGH = (1.0 - QUATERNION_NORM_ERROR) ** 2, (1.0 + QUATERNION_NORM_ERROR) ** 2
_FAR_M2, _LEAST_M = FAR_M * FAR_M, -BOX_MARGIN_M
_SURE_M = 0.57 * FAR_M
"""With no coordinate beyond this a body is less than :data:`FAR_M` away."""


class Checker:
    """The checks of one stream, with the memory they need; make a new one when the source restarts."""

    def __init__(self, arena: Arena, allow_edited: bool = False) -> None:
        self._pose_of = ArenaFrame(arena.mocap).pose_of
        self._width_m, self._depth_m = (size + BOX_MARGIN_M for size in arena.arena.size_m)
        self._allow_edited = allow_edited
        self.tracks = [Track(name, robot.body, robot.heading_offset_rad) for name, robot in arena.robots.items()]
        self._continuity = Continuity(self.tracks, arena.mocap.max_body_speed_mps)

    def restart(self) -> None:
        """The source has started anew: forget poses, keep the counts."""
        for track in self.tracks:
            track.raw = None
        self._continuity.restart()

    def check(self, frame: SourceFrame) -> tuple[BodyPose, ...]:
        """A verdict on every robot's body, in the order of the arena file."""
        now_ns = frame.exposure_ns
        bodies, edited = frame.bodies, frame.edited and not self._allow_edited
        continuity, glance, look = self._continuity, self._glance, self._look
        last_ns, (near_m2, least) = continuity.last_ns, continuity.sure(now_ns)
        seen: list[Seen | None] = []
        steady: list[Seen] = []
        doubted: list[Seen] = []
        for track in self.tracks:
            body = bodies.get(track.body)
            if body is None or edited:
                track.reason = "missing" if body is None else "edit_mode"
                seen.append(None)
                continue
            if track.accepted_ns == last_ns >= 0 and track.candidate is None:
                pose = glance(track, body, near_m2, least)
                if pose is not None:
                    entry = track, pose, body
                    seen.append(entry)
                    steady.append(entry)
                    continue
            pose = look(track, body, now_ns)
            if pose is None:
                seen.append(None)
            else:
                entry = track, pose, body
                seen.append(entry)
                doubted.append(entry)
        continuity.check(seen, steady, doubted, now_ns)
        return tuple([_verdict(track) for track in self.tracks])

    def _glance(self, track: Track, body: Body, near_m2: float, least: float) -> Pose | None:
        """The pose of a body that goes on as in the last frame, if it would pass every check by a margin; else None."""
        _, x, y, z, qx, qy, qz, qw, error_m, params = body
        _, bx, by, bz, ax, ay, az, aw, _, _ = track.believed
        dx, dy, dz = x - bx, y - by, z - bz
        dot = ax * qx + ay * qy + az * qz + aw * qw
        if (
            0.0 < dx * dx + dy * dy + dz * dz < near_m2
            and dot * dot > least
            and params & TRACKING_VALID
            and error_m <= MARKER_ERROR_WARN_M
            and 0.999 < qx * qx + qy * qy + qz * qz + qw * qw < SURE_NORM2
            and -_SURE_M < x < _SURE_M
            and -_SURE_M < y < _SURE_M
            and -_SURE_M < z < _SURE_M
        ):
            pose = self._pose_of(x, y, z, qx, qy, qz, qw, track.offset_rad)
            if (
                pose.up >= TILT_COS
                and _LEAST_M <= pose.x_m <= self._width_m
                and _LEAST_M <= pose.y_m <= self._depth_m
                and -BOX_HEIGHT_M <= pose.z_m <= BOX_HEIGHT_M
            ):
                return pose
        return None

    def _look(self, track: Track, body: Body, now_ns: int) -> Pose | None:
        """The pose; None with a reason if that is in this frame alone (or in bits that never change)."""
        _, x, y, z, qx, qy, qz, qw, error_m, params = body
        track.reason = ""
        if not params & TRACKING_VALID:
            track.reason = "occluded"
            return None
        norm = qx * qx + qy * qy + qz * qz + qw * qw
        square = x * x + y * y + z * z
        if not isfinite(norm + square):
            track.reason = "not_finite"
        elif not _NORM_LOW < norm < _NORM_HIGH:
            track.reason = "quaternion_norm"
        elif square > _FAR_M2:
            track.reason = "units"
        if track.reason:
            return None
        pose = self._pose_of(x, y, z, qx, qy, qz, qw, track.offset_rad)
        if pose.up < TILT_COS:
            track.reason = "tilted"
            return None
        if not (
            _LEAST_M <= pose.x_m <= self._width_m
            and _LEAST_M <= pose.y_m <= self._depth_m
            and -BOX_HEIGHT_M <= pose.z_m <= BOX_HEIGHT_M
        ):
            track.reason = "outside_arena"
            return None
        if not error_m <= MARKER_ERROR_WARN_M:
            if not error_m <= MARKER_ERROR_M:
                track.reason = "marker_error"
                return None
            track.faults["marker_error_high"] += 1
        raw = track.raw
        if raw is not None and x == raw[1] and z == raw[3] and y == raw[2] and body[4:8] == raw[4:8]:
            if now_ns - track.changed_ns > FREEZE_NS:
                track.reason = "frozen"
                return None
        else:
            track.raw = body
            track.changed_ns = now_ns
        return pose


def _verdict(track: Track) -> BodyPose:
    # floor and a division round to the wire's 0.01 mm and 0.01 mrad three times faster than round() does
    pose, reason = track.pose, track.reason
    if reason:
        track.faults[reason] += 1
    return BodyPose(
        robot=track.robot,
        x_m=floor(pose.x_m * 1e5 + 0.5) / 1e5,
        y_m=floor(pose.y_m * 1e5 + 0.5) / 1e5,
        heading_rad=floor(pose.heading_rad * 1e5 + 0.5) / 1e5,
        valid=not reason,
        reason=reason,
        resets=track.resets,
    )
