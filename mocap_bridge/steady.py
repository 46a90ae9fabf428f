"""Bodies that plainly go on as in the frame before: nearly all of nearly all frames. Pure.

Such a body would pass every check of :mod:`mocap_bridge.checks` by a margin, so none is made. All that is kept of it is
what the source said last, as it said it; its track is written up (:meth:`Steady.settle`) when the checks need it again.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import atan2, floor, hypot, pi, remainder, tau
from typing import NamedTuple

from contract.arena import Arena
from contract.messages import BodyPose
from mocap_bridge.continuity import SURE_NORM2, Continuity
from mocap_bridge.frames import ArenaFrame, Pose
from mocap_bridge.limits import FAR_M, FREEZE_NS, MARKER_ERROR_WARN_M, TILT_COS, box_of
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.natnet.listed import Listed, Placed, Sighted
from mocap_bridge.track import Track

_NONE = BodyPose(robot="none", x_m=0.0, y_m=0.0, heading_rad=0.0, valid=False, reason="unjudged")
_NOBODY: Body = (0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
_LEAN = 0.4999999 * (1.0 - TILT_COS)
"""A body whose x and y of the quaternion have less of its squared norm is not tilted, with room for rounding."""

_Known = tuple[str, float, int]
"""Robot, heading offset and resets of a track."""
_Row = tuple[_Known | None, Sighted, Placed]
"""A body that may go on, now and before; None if it may not."""


def _known(track: Track) -> _Known:
    return track.robot, track.offset_rad, track.resets


class _Order(NamedTuple):
    """Where the tracks' bodies are in the source's list."""

    places: list[int]
    """Of every body of the list the place of its track, -1 if it is no robot's."""
    strangers: list[int]
    """Rows of those that are no robot's."""
    rows: list[int]
    """Of every track the row of its body; empty if one is not in the list."""
    straight: bool
    """Whether the list has the tracks' bodies, in their order, and no others."""


def _order(listed: Sequence[str], bodies: Sequence[str]) -> _Order:
    place_of = {name: place for place, name in enumerate(bodies)}
    places = [place_of.get(name, -1) for name in listed]
    row_of = {place: row for row, place in enumerate(places)}
    rows = [row_of[place] for place in range(len(bodies))] if row_of.keys() >= set(range(len(bodies))) else []
    return _Order(places, [row for row, place in enumerate(places) if place < 0], rows, tuple(bodies) == tuple(listed))


class Steady:
    """The bodies believed in the last frame, by the order of the tracks."""

    def __init__(self, arena: Arena, tracks: list[Track], continuity: Continuity) -> None:
        self._tracks = tracks
        self._continuity = continuity
        self._axes = ArenaFrame(arena.mocap)
        self._box = box = box_of(arena)
        self._bounded = hypot(box.width, box.depth, box.height) + hypot(*self._axes.origin_m) < FAR_M
        """Whether no body in the box is too far away for the source's unit to be right."""
        self._bodies = [track.body for track in tracks]
        self._known = [_known(track) for track in tracks]
        self._last: list[Body | None] = [None] * len(tracks)
        """None where the body was not believed; an older frame's if :attr:`_all`."""
        self._standing: dict[int, int] = {}
        """When the numbers last changed, ns, of bodies whose numbers do not."""
        self._now_standing = self._standing
        self._before: Listed | None = None
        """The last frame if the source listed its bodies: by :attr:`_order` and :attr:`_entries`."""
        self._now: Listed | None = None
        self._order = _order((), self._bodies)
        self._entries: list[_Known | None] = []
        self._all = False
        """Whether every track's body went on in the last frame, and is as listed there."""

    def go_on(self, bodies: Mapping[str, Body], now_ns: int) -> tuple[list[BodyPose], list[Body | None], list[int]]:
        """Of every track the verdict and the body, and the places of those left to the checks.

        There the body is None, and the verdict stands for another. The bodies are not given if nothing is left to the
        checks and the source lists them; :meth:`keep` ends the frame.
        """
        now = self._now = bodies if isinstance(bodies, Listed) and self._bounded else None
        before, order = self._before, self._order
        if now is not None and before is not None and now.names is before.names:
            rows: Iterable[_Row] = zip(self._entries, now.sighted(), before.placed(), strict=True)
            found, failed = self._pass(rows, order.places, now_ns)
            if failed == order.strangers and order.rows:
                self._all = True
                return (found if order.straight else [found[row] for row in order.rows]), [], []
            self._recall()
            places = order.places
        else:
            self._recall()
            seen = map((bodies if self._bounded else {}).get, self._bodies)
            rows = [
                (known, body[1:], last[1:8]) if body and last else (None, _NOBODY[1:], _NOBODY[1:8])
                for known, body, last in zip(self._known, seen, self._last, strict=True)
            ]
            places = list(range(len(rows)))
            found, failed = self._pass(rows, places, now_ns)
        return self._spread(bodies, places, found, failed)

    def _spread(
        self, bodies: Mapping[str, Body], places: list[int], found: list[BodyPose], failed: list[int]
    ) -> tuple[list[BodyPose], list[Body | None], list[int]]:
        """The rows found, but for those that failed, as :meth:`go_on` gives them."""
        verdicts = [_NONE] * len(self._bodies)
        gone_on: list[Body | None] = [None] * len(self._bodies)
        left = set(failed)
        for row, (place, verdict) in enumerate(zip(places, found, strict=True)):
            if row not in left:
                verdicts[place], gone_on[place] = verdict, bodies[self._bodies[place]]
        return verdicts, gone_on, [place for place, body in enumerate(gone_on) if body is None]

    def _pass(self, rows: Iterable[_Row], places: Sequence[int], now_ns: int) -> tuple[list[BodyPose], list[int]]:
        """Of every row a verdict, which stands for another in those rows that failed."""
        axes, self._now_standing = self._axes, {}
        y_up, (origin_x, origin_y), turned_rad = axes.y_up, axes.origin_m, axes.rotation_rad
        cosine, sine = axes.cosine, axes.sine
        least_m, width_m, depth_m, height_m = self._box
        near_m2, least = self._continuity.sure(now_ns)
        found: list[BodyPose] = []
        failed: list[int] = []
        for known, (x, y, z, qx, qy, qz, qw, error_m, params), (bx, by, bz, ax, ay, az, aw) in rows:
            if known is not None:
                dx, dy, dz = x - bx, y - by, z - bz
                moved_m2 = dx * dx + dy * dy + dz * dz
                dot = ax * qx + ay * qy + az * qz + aw * qw
                if (
                    moved_m2 < near_m2
                    and dot * dot > least
                    and params & TRACKING_VALID
                    and error_m <= MARKER_ERROR_WARN_M
                    and (
                        moved_m2 > 0.0
                        or (ax, ay, az, aw) != (qx, qy, qz, qw)
                        or self._may_stand(places[len(found)], now_ns)
                    )
                ):
                    # ArenaFrame.pose_of, number by number
                    if y_up:
                        y, z = -z, y
                        qy, qz = -qz, qy
                    x -= origin_x
                    y -= origin_y
                    xx, yy, zz = qx * qx, qy * qy, qz * qz
                    lean = xx + yy
                    norm = lean + zz + qw * qw
                    x_m, y_m = cosine * x + sine * y, cosine * y - sine * x
                    if (
                        0.999 < norm < SURE_NORM2
                        and lean <= _LEAN * norm
                        and least_m <= x_m <= width_m
                        and least_m <= y_m <= depth_m
                        and -height_m <= z <= height_m
                    ):
                        robot, offset_rad, resets = known
                        heading_rad = atan2(2.0 * (qx * qy + qz * qw), norm - 2.0 * (yy + zz)) - turned_rad + offset_rad
                        if not -pi <= heading_rad <= pi:
                            heading_rad = remainder(heading_rad, tau)
                        found.append(
                            BodyPose(
                                robot=robot,
                                x_m=floor(x_m * 1e5 + 0.5) / 1e5,
                                y_m=floor(y_m * 1e5 + 0.5) / 1e5,
                                heading_rad=floor(heading_rad * 1e5 + 0.5) / 1e5,
                                resets=resets,
                            )
                        )
                        continue
            failed.append(len(found))
            found.append(_NONE)
        return found, failed

    def _may_stand(self, place: int, now_ns: int) -> bool:
        """Whether a body that has neither moved nor turned has not been frozen for too long."""
        since_ns = self._standing.get(place, self._continuity.last_ns)
        self._now_standing[place] = since_ns
        return now_ns - since_ns <= FREEZE_NS

    def _recall(self) -> None:
        """Let :attr:`_last` be the last frame's again."""
        if self._all and self._before is not None:
            self._last = [self._before[name] for name in self._bodies]
        self._all = False

    def settle(self, places: Iterable[int]) -> None:
        """Write up the tracks of these as of the last frame; the others' are as they should be."""
        self._recall()
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
                self._known[place] = _known(track)
                if track.changed_ns != now_ns:
                    self._now_standing[place] = track.changed_ns
        self._standing = self._now_standing
        if not self._all:
            self._last = gone_on
            if self._now is not None:
                self._begin(self._now)
        self._before = self._now

    def _begin(self, now: Listed) -> None:
        """The next frame's bodies may be listed as this one's."""
        if self._before is None or now.names is not self._before.names:
            self._order = _order(now.names, self._bodies)
        believed = [known if body else None for known, body in zip(self._known, self._last, strict=True)]
        self._entries = [believed[place] if place >= 0 else None for place in self._order.places]

    def forget(self) -> None:
        """Every track is written up, and none goes on."""
        self.settle(range(len(self._last)))
        self._last, self._standing, self._before = [None] * len(self._last), {}, None
