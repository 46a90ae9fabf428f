"""Bodies that plainly go on as in the frame before: nearly all of nearly all frames. Pure.

Such a body would pass every check of :mod:`mocap_bridge.checks` by a margin, so none is made. All that is kept of it is
what the source said last; its track is written up (:meth:`Steady.settle`) when the checks need it again.
"""

from collections.abc import Iterable, Mapping
from math import atan2, floor, hypot, pi, remainder, tau

from contract.arena import Arena
from contract.messages import BodyPose
from mocap_bridge.continuity import SURE_NORM2, Continuity
from mocap_bridge.frames import ArenaFrame, Pose
from mocap_bridge.limits import FAR_M, FREEZE_NS, MARKER_ERROR_WARN_M, TILT_COS, box_of
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.track import Track

_NONE = BodyPose(robot="none", x_m=0.0, y_m=0.0, heading_rad=0.0, valid=False, reason="unjudged")


class Steady:
    """The bodies believed in the last frame, by the order of the tracks."""

    def __init__(self, arena: Arena, tracks: list[Track], continuity: Continuity) -> None:
        self._tracks = tracks
        self._continuity = continuity
        self._axes = ArenaFrame(arena.mocap)
        self._box = box = box_of(arena)
        self._bounded = hypot(box.width, box.depth, box.height) + hypot(*self._axes.origin_m) < FAR_M
        """Whether no body in the box is too far away for the source's unit to be right."""
        self._known = [(track.robot, track.body, track.offset_rad, track.resets) for track in tracks]
        self._last: list[Body | None] = [None] * len(tracks)
        """None where the body was not believed."""
        self._standing: dict[int, int] = {}
        """When the numbers last changed, ns, of bodies whose numbers do not."""
        self._now_standing = self._standing

    def go_on(self, bodies: Mapping[str, Body], now_ns: int) -> tuple[list[BodyPose], list[Body | None], list[int]]:
        """Of every track the verdict and the body, and the places of those left to the checks.

        There the body is None, and the verdict stands for another; :meth:`keep` ends the frame.
        """
        get, axes, self._now_standing = (bodies if self._bounded else {}).get, self._axes, {}
        y_up, (origin_x, origin_y), turned_rad = axes.y_up, axes.origin_m, axes.rotation_rad
        cosine, sine = axes.cosine, axes.sine
        least_m, width_m, depth_m, height_m = self._box
        near_m2, least = self._continuity.sure(now_ns)
        verdicts: list[BodyPose] = []
        gone_on: list[Body | None] = []
        others: list[int] = []
        for (robot, name, offset_rad, resets), before in zip(self._known, self._last, strict=True):
            body = get(name)
            if body is not None and before is not None:
                _, x, y, z, qx, qy, qz, qw, error_m, params = body
                _, bx, by, bz, ax, ay, az, aw, _, _ = before
                dx, dy, dz = x - bx, y - by, z - bz
                moved_m2 = dx * dx + dy * dy + dz * dz
                dot = ax * qx + ay * qy + az * qz + aw * qw
                if (
                    moved_m2 < near_m2
                    and dot * dot > least
                    and params & TRACKING_VALID
                    and error_m <= MARKER_ERROR_WARN_M
                    and (moved_m2 > 0.0 or self._may_stand(len(gone_on), body, before, now_ns))
                ):
                    # ArenaFrame.pose_of, number by number
                    if y_up:
                        y, z = -z, y
                        qy, qz = -qz, qy
                    x -= origin_x
                    y -= origin_y
                    xx, yy, zz = qx * qx, qy * qy, qz * qz
                    norm = xx + yy + zz + qw * qw
                    x_m, y_m = cosine * x + sine * y, cosine * y - sine * x
                    if (
                        0.999 < norm < SURE_NORM2
                        and 1.0 - 2.0 * (xx + yy) / norm >= TILT_COS
                        and least_m <= x_m <= width_m
                        and least_m <= y_m <= depth_m
                        and -height_m <= z <= height_m
                    ):
                        heading_rad = atan2(2.0 * (qx * qy + qz * qw), norm - 2.0 * (yy + zz)) - turned_rad + offset_rad
                        if not -pi <= heading_rad <= pi:
                            heading_rad = remainder(heading_rad, tau)
                        gone_on.append(body)
                        verdicts.append(
                            BodyPose(
                                robot=robot,
                                x_m=floor(x_m * 1e5 + 0.5) / 1e5,
                                y_m=floor(y_m * 1e5 + 0.5) / 1e5,
                                heading_rad=floor(heading_rad * 1e5 + 0.5) / 1e5,
                                resets=resets,
                            )
                        )
                        continue
            others.append(len(gone_on))
            gone_on.append(None)
            verdicts.append(_NONE)
        return verdicts, gone_on, others

    def _may_stand(self, place: int, body: Body, before: Body, now_ns: int) -> bool:
        """Whether a body that has not moved has turned, or not been frozen for too long."""
        if body[4:8] != before[4:8]:
            return True
        since_ns = self._standing.get(place, self._continuity.last_ns)
        self._now_standing[place] = since_ns
        return now_ns - since_ns <= FREEZE_NS

    def settle(self, places: Iterable[int]) -> None:
        """Write up the tracks of these as of the last frame; the others' are as they should be."""
        last_ns = self._continuity.last_ns
        for place in places:
            body = self._last[place]
            if body is not None:
                track = self._tracks[place]
                track.pose = track.place = self.pose(track, body)
                track.raw = track.believed = body
                track.reason = ""
                track.accepted_ns = last_ns
                track.changed_ns = self._standing.get(place, last_ns)

    def pose(self, track: Track, body: Body) -> Pose:
        """Where a track's body is."""
        return self._axes.pose_of(*body[1:8], track.offset_rad)

    def keep(self, gone_on: list[Body | None], judged: list[int], now_ns: int) -> None:
        """End of a frame: those that went on, and those of the judged that are believed, may go on in the next."""
        for place in judged:
            track = self._tracks[place]
            self._now_standing.pop(place, None)
            if not track.reason:
                gone_on[place] = track.believed
                self._known[place] = track.robot, track.body, track.offset_rad, track.resets
                if track.changed_ns != now_ns:
                    self._now_standing[place] = track.changed_ns
        self._last, self._standing = gone_on, self._now_standing

    def forget(self) -> None:
        """Every track is written up, and none goes on."""
        self.settle(range(len(self._last)))
        self._last, self._standing = [None] * len(self._last), {}
