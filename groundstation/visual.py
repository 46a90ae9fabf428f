"""The swarm as Foxglove's own schemas: frames, robots, links, targets, log, so that viewers need no plug-in. Pure.

``/tf`` foxglove.FrameTransforms, ``/robot/ID/pose`` foxglove.PoseInFrame, ``/scene`` foxglove.SceneUpdate with the
entities ``floor``, ``robot ID``, ``links``, ``targets``, ``/links`` and ``/targets`` foxglove.PointCloud for viewers
without scenes, and ``/log`` foxglove.Log. Lengths in metres in the frame
``arena``; each robot has a frame of its name. Stamps are site time.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from foxglove import messages as fx

from contract.arena import Arena
from contract.messages import LogEntry, Message, MocapFrame, RobotReport, RunStatus, TargetCloud
from groundstation.connectivity import mutual
from groundstation.dots import along, cloud
from groundstation.scenes import label

FRAME = "arena"
POSE_NS = 33_000_000
"""Poses are shown at 30 Hz at most."""
LINKS_NS = 100_000_000
HEIGHT_M = 0.06
LEVELS = {
    "debug": fx.LogLevel.Debug,
    "info": fx.LogLevel.Info,
    "warning": fx.LogLevel.Warning,
    "error": fx.LogLevel.Error,
}
BLUE_RGB, GREY_RGB, AMBER_RGB = (0.04, 0.36, 0.68), (0.48, 0.54, 0.58), (0.71, 0.33, 0.04)
BLUE, GREY, RED, AMBER, INK = (
    fx.Color(r=r, g=g, b=b, a=1.0)
    for r, g, b in (BLUE_RGB, GREY_RGB, (0.71, 0.09, 0.18), AMBER_RGB, (0.07, 0.13, 0.17))
)
RUN_COLORS = {"running": BLUE, "armed": BLUE, "holding": AMBER, "fault": RED, "stopped": RED}


class Shown(NamedTuple):
    """One message of a viewer's channel."""

    topic: str
    kind: type[Any]
    payload: bytes


SCHEMAS: tuple[type[Any], ...] = (fx.FrameTransforms, fx.PoseInFrame, fx.SceneUpdate, fx.PointCloud, fx.Log)


class Visual:
    """Everything heard so far, and what of it a viewer is to be told."""

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._names = list(arena.robots)
        self._index = {name: i for i, name in enumerate(self._names)}
        self._places: dict[str, tuple[float, float]] = {}
        self._reports: dict[str, RobotReport] = {}
        self._looks: dict[str, tuple[str, ...]] = {}
        self._cloud: TargetCloud | None = None
        self._done: frozenset[int] = frozenset()
        self._pose_due_ns = self._links_due_ns = 0
        self._begun = False

    def receive(self, message: Message, log_ns: int) -> Iterator[Shown]:
        """What to show on hearing a message at that time, site ns."""
        stamp = fx.Timestamp(log_ns // 10**9, log_ns % 10**9)
        if not self._begun:
            self._begun = True
            yield self._scene(self._floor(stamp))
        match message:
            case MocapFrame():
                yield from self._frame(message, stamp, log_ns)
            case RobotReport() if message.robot in self._index:
                self._reports[message.robot] = message
                look = (message.run, message.task, str(message.claim))
                if self._looks.get(message.robot) != look:
                    self._looks[message.robot] = look
                    yield self._scene(self._robot(message, stamp))
            case TargetCloud() if message != self._cloud:
                self._cloud = message
                yield from self._targets(stamp)
            case RunStatus() if frozenset(message.occupied) != self._done:
                self._done = frozenset(message.occupied)
                yield from self._targets(stamp)
            case LogEntry():
                entry = fx.Log(
                    timestamp=stamp,
                    level=LEVELS[message.level],
                    message=message.text or message.event,
                    name=message.source,
                )
                yield Shown("/log", fx.Log, entry.encode())
            case _:
                return

    def _frame(self, frame: MocapFrame, stamp: Any, log_ns: int) -> Iterator[Shown]:
        if log_ns < self._pose_due_ns:
            return
        self._pose_due_ns = log_ns + POSE_NS
        transforms = []
        for body in frame.bodies:
            if not body.valid or body.robot not in self._index:
                continue
            self._places[body.robot] = (body.x_m, body.y_m)
            half = body.heading_rad / 2
            turned = fx.Quaternion(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
            place = fx.Vector3(x=body.x_m, y=body.y_m, z=0.0)
            transforms.append(
                fx.FrameTransform(
                    timestamp=stamp,
                    parent_frame_id=FRAME,
                    child_frame_id=body.robot,
                    translation=place,
                    rotation=turned,
                )
            )
            pose = fx.Pose(position=place, orientation=turned)
            shown = fx.PoseInFrame(timestamp=stamp, frame_id=FRAME, pose=pose)
            yield Shown(f"/robot/{body.robot}/pose", fx.PoseInFrame, shown.encode())
        yield Shown("/tf", fx.FrameTransforms, fx.FrameTransforms(transforms=transforms).encode())
        if log_ns >= self._links_due_ns:
            self._links_due_ns = log_ns + LINKS_NS
            yield from self._links(stamp)

    def _scene(self, entity: Any) -> Shown:
        return Shown("/scene", fx.SceneUpdate, fx.SceneUpdate(entities=[entity]).encode())

    def _floor(self, stamp: Any) -> Any:
        (width, height), fence = self._arena.arena.size_m, self._arena.arena.fence_m
        edge = ((0.0, 0.0), (width, 0.0), (width, height), (0.0, height))
        inner = ((fence, fence), (width - fence, fence), (width - fence, height - fence), (fence, height - fence))
        lines = [_line(fx.LinePrimitiveLineType.LineLoop, points, 2.0, GREY) for points in (edge, inner)]
        return fx.SceneEntity(timestamp=stamp, frame_id=FRAME, id="floor", lines=lines)

    def _robot(self, report: RobotReport, stamp: Any) -> Any:
        size_m = self._arena.platform.diameter_m
        color = RUN_COLORS.get(report.run, GREY)
        disc = fx.CylinderPrimitive(
            pose=_at(0.0, 0.0, HEIGHT_M / 2),
            size=fx.Vector3(x=size_m, y=size_m, z=HEIGHT_M),
            bottom_scale=1.0,
            top_scale=1.0,
            color=color,
        )
        nose = fx.ArrowPrimitive(
            pose=_at(0.0, 0.0, HEIGHT_M),
            shaft_length=0.3 * size_m,
            shaft_diameter=0.1 * size_m,
            head_length=0.4 * size_m,
            head_diameter=0.3 * size_m,
            color=INK,
        )
        words = f"{label(report.robot)} {report.task if report.run == 'running' else report.run}"
        if report.run == "running" and report.claim >= 0 and report.task in ("tracking", "occupied"):
            words += f" T{report.claim + 1:02d}"
        text = fx.TextPrimitive(
            pose=_at(0.0, 0.0, 3 * HEIGHT_M),
            billboard=True,
            font_size=14.0,
            scale_invariant=True,
            color=INK,
            text=words,
        )
        return fx.SceneEntity(
            timestamp=stamp,
            frame_id=report.robot,
            id=f"robot {report.robot}",
            frame_locked=True,
            cylinders=[disc],
            arrows=[nose],
            texts=[text],
            metadata=[fx.KeyValuePair(key="run", value=report.run), fx.KeyValuePair(key="reason", value=report.reason)],
        )

    def _links(self, stamp: Any) -> Iterator[Shown]:
        kept: list[list[int]] = [[] for _ in self._names]
        for name, report in self._reports.items():
            kept[self._index[name]] = [self._index[o] for o in report.links_on + report.links_kept if o in self._index]
        plain: list[tuple[float, float]] = []
        critical: list[tuple[float, float]] = []
        for i, j in sorted(mutual(kept)):
            a, b = self._places.get(self._names[i]), self._places.get(self._names[j])
            if a is not None and b is not None:
                near = math.dist(a, b) <= self._arena.control.noncritical_radius_m
                (plain if near else critical).extend((a, b))
        kind = fx.LinePrimitiveLineType.LineList
        lines = [
            _line(kind, points, width, color)
            for points, width, color in ((plain, 2.0, BLUE), (critical, 4.0, AMBER))
            if points
        ]
        yield self._scene(fx.SceneEntity(timestamp=stamp, frame_id=FRAME, id="links", lines=lines))
        dots = [
            (dot, color)
            for points, color in ((plain, BLUE_RGB), (critical, AMBER_RGB))
            for a, b in zip(points[::2], points[1::2], strict=True)
            for dot in along(a, b)
        ]
        yield Shown("/links", fx.PointCloud, cloud(stamp, FRAME, dots).encode())

    def _targets(self, stamp: Any) -> Iterator[Shown]:
        targets = self._cloud.targets if self._cloud else ()
        spheres = [
            fx.SpherePrimitive(
                pose=_at(target.x_m, target.y_m, 0.0),
                size=fx.Vector3(x=0.06, y=0.06, z=0.01 if target.index in self._done else 0.06),
                color=GREY if target.index in self._done else AMBER,
            )
            for target in targets
        ]
        yield self._scene(fx.SceneEntity(timestamp=stamp, frame_id=FRAME, id="targets", spheres=spheres))
        dots = [((target.x_m, target.y_m), GREY_RGB if target.index in self._done else AMBER_RGB) for target in targets]
        yield Shown("/targets", fx.PointCloud, cloud(stamp, FRAME, dots).encode())


def _at(x_m: float, y_m: float, z_m: float) -> Any:
    upright = fx.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    return fx.Pose(position=fx.Vector3(x=x_m, y=y_m, z=z_m), orientation=upright)


def _line(kind: Any, points: Iterable[tuple[float, float]], width: float, color: Any) -> Any:
    return fx.LinePrimitive(
        type=kind,
        pose=_at(0.0, 0.0, 0.0),
        thickness=width,
        scale_invariant=True,
        points=[fx.Point3(x=x, y=y, z=0.005) for x, y in points],
        color=color,
    )
