"""What has to hold before a pose is believed; every refusal has a reason and is counted. Pure.

No filtering: a body's pose is published as it came, with a verdict. The order of the checks is
that of :data:`REASONS`; the first that fails names the reason.
"""

from math import floor, isfinite

from contract.arena import Arena
from contract.messages import BodyPose
from mocap_bridge.continuity import Continuity, Seen
from mocap_bridge.frames import ArenaFrame, Pose
from mocap_bridge.limits import (
    FAR_M,
    FREEZE_NS,
    MARKER_ERROR_M,
    MARKER_ERROR_WARN_M,
    QUATERNION_NORM_ERROR,
    TILT_COS,
    box_of,
)
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.steady import Steady
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

_NORM_LOW, _NORM_HIGH = (1.0 - QUATERNION_NORM_ERROR) ** 2, (1.0 + QUATERNION_NORM_ERROR) ** 2


class Checker:
    """The checks of one stream, with the memory they need; make a new one when the source restarts."""

    def __init__(self, arena: Arena, allow_edited: bool = False) -> None:
        self._pose_of = ArenaFrame(arena.mocap).pose_of
        self._box = box_of(arena)
        self._allow_edited = allow_edited
        self.tracks = [Track(name, robot.body, robot.heading_offset_rad) for name, robot in arena.robots.items()]
        self._continuity = Continuity(self.tracks, arena.mocap.max_body_speed_mps)
        self._steady = Steady(arena, self.tracks, self._continuity)

    def restart(self) -> None:
        """The source has started anew: forget poses, keep the counts."""
        self._steady.forget()
        for track in self.tracks:
            track.raw = None
        self._continuity.restart()

    def check(self, frame: SourceFrame) -> tuple[BodyPose, ...]:
        """A verdict on every robot's body, in the order of the arena file."""
        now_ns = frame.exposure_ns
        edited = frame.edited and not self._allow_edited
        verdicts, gone_on, others = self._steady.go_on({} if edited else frame.bodies, now_ns)
        if others:
            self._judge(frame, edited, gone_on, others)
            for place in others:
                verdicts[place] = _verdict(self.tracks[place])
        self._steady.keep(gone_on, others, now_ns)
        self._continuity.last_ns = now_ns
        return tuple(verdicts)

    def _judge(self, frame: SourceFrame, edited: bool, gone_on: list[Body | None], others: list[int]) -> None:
        """Believe the bodies at the places ``others``, or give their tracks the reason why not."""
        steady, now_ns = self._steady, frame.exposure_ns
        steady.settle(others)
        doubted: dict[int, Seen] = {}
        for place in others:
            track = self.tracks[place]
            body = frame.bodies.get(track.body)
            if body is None or edited:
                track.reason = "missing" if body is None else "edit_mode"
            elif (pose := self._look(track, body, now_ns)) is not None:
                doubted[place] = track, pose, body
        if not doubted:
            return
        sure: dict[int, Seen] = {}
        for place, (track, body) in enumerate(zip(self.tracks, gone_on, strict=True)):
            if body is not None:
                sure[place] = track, steady.pose(track, body), body
        steady.settle(sure)
        seen = [sure.get(place) or doubted.get(place) for place in range(len(gone_on))]
        self._continuity.judge(seen, list(sure.values()), list(doubted.values()), now_ns)

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
        elif square > FAR_M * FAR_M:
            track.reason = "units"
        if track.reason:
            return None
        pose = self._pose_of(x, y, z, qx, qy, qz, qw, track.offset_rad)
        if pose.up < TILT_COS:
            track.reason = "tilted"
            return None
        box = self._box
        if not (
            box.least <= pose.x_m <= box.width
            and box.least <= pose.y_m <= box.depth
            and -box.height <= pose.z_m <= box.height
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
