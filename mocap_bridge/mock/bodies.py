"""What the emulated system sees: bodies in the arena frame to bodies and markers on the wire. Pure."""

import math
import random
from collections.abc import Iterable
from typing import NamedTuple

from contract.arena import Arena, Mocap
from mocap_bridge.frames import ArenaFrame
from mocap_bridge.mock.script import NO_FAULTS, Script
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.natnet.frame_encode import Marker, Point3

NOISE_M = 2e-5
"""Standard deviation of every coordinate: a real system never repeats a pose bit for bit."""
MARKERS: tuple[Point3, ...] = ((0.04, 0.0, 0.0), (-0.03, 0.03, 0.0), (0.0, -0.035, 0.0))
"""In the body's frame, z up."""
BODY_HEIGHT_M = 0.05
MEAN_ERROR_M = 0.0003
SCRIPTED_ID_STEP = 100


class BodyState(NamedTuple):
    """Truth about one body in the arena frame."""

    name: str
    x_m: float
    y_m: float
    heading_rad: float
    tracked: bool = True
    """False: it is there, but the cameras have lost sight of it."""


class ServerSettings(NamedTuple):
    """What the emulated system is like; ``mocap`` has addresses, rate, version and axes."""

    mocap: Mocap = Mocap()
    name: str = "Emulated Motive"
    tick_hz: int = 10_000_000
    boot_ticks: int = 864_000_000_000
    """The server's clock reads this at local time 0: one day of ticks."""
    latency_ns: int = 0
    """From exposure to transmission."""
    with_markers: bool = True
    noise_m: float = NOISE_M
    seed: int = 1
    script: Script = NO_FAULTS
    offsets_rad: tuple[tuple[str, float], ...] = ()
    """Robot heading minus body heading, by body name, as in the arena file."""


def settings_of(arena: Arena, script: Script = NO_FAULTS, seed: int = 1) -> ServerSettings:
    """A server as the arena file describes it."""
    offsets = tuple((robot.body, robot.heading_offset_rad) for robot in arena.robots.values())
    return ServerSettings(mocap=arena.mocap, seed=seed, script=script, offsets_rad=offsets)


class Sight(NamedTuple):
    """What one frame shows."""

    bodies: list[Body]
    markers: list[Marker]
    marker_sets: list[tuple[str, list[Point3]]]


class Camera:
    """Turns truth into what is on the wire, with noise and the scripted faults of single bodies."""

    def __init__(self, settings: ServerSettings, names: Iterable[str]) -> None:
        self.ids = {name: number for number, name in enumerate(names, 1)}
        self._settings = settings
        self._frame = ArenaFrame(settings.mocap)
        self._offsets = dict(settings.offsets_rad)
        self._random = random.Random(settings.seed)
        self._last: dict[str, Body] = {}

    def follow(self, script: Script) -> None:
        """Another script from now on."""
        self._settings = self._settings._replace(script=script)

    def id(self, name: str, elapsed_s: float) -> int:
        """The id of a body, changed by every ``id_change`` so far."""
        changes = (f for f in self._settings.script.faults if f.kind == "id_change" and f.body == name)
        return self.ids[name] + SCRIPTED_ID_STEP * sum(f.start_s <= elapsed_s for f in changes)

    def see(self, poses: Iterable[BodyState], elapsed_s: float) -> Sight:
        """All bodies; one that is not in the model list is not seen."""
        script = self._settings.script
        truth = {pose.name: pose for pose in poses if pose.name in self.ids}
        for fault in script.faults:
            if fault.kind == "swap" and fault.active(elapsed_s) and {fault.body, fault.other} <= truth.keys():
                first, second = truth[fault.body], truth[fault.other]
                truth[fault.body] = second._replace(name=first.name)
                truth[fault.other] = first._replace(name=second.name)
        scale = 1000.0 if script.active("millimetres", elapsed_s) else 1.0
        sight = Sight([], [], [])
        for name, pose in truth.items():
            if script.active("absent", elapsed_s, name):
                continue
            body = self._body(name, pose, elapsed_s)
            if scale != 1.0:
                body = (body[0], body[1] * scale, body[2] * scale, body[3] * scale, *body[4:])
            sight.bodies.append(body)
            if self._settings.with_markers:
                self._add_markers(sight, name, body, pose.heading_rad, scale)
        return sight

    def _body(self, name: str, pose: BodyState, elapsed_s: float) -> Body:
        scripted = self._settings.script.faults
        faults = {f.kind: f for f in scripted if f.body == name and f.active(elapsed_s)} if scripted else {}
        identity = self.id(name, elapsed_s) if scripted else self.ids[name]
        if name in self._last and "frozen" in faults:
            return (identity, *self._last[name][1:])
        hidden = "occlusion" in faults or not pose.tracked
        if name in self._last and hidden:
            return (identity, *self._last[name][1:9], 0)
        jump = faults["jump"].number(0.0) if "jump" in faults else 0.0
        turn = faults["turn"].number(0.0) if "turn" in faults else 0.0
        noise = self._settings.noise_m
        gauss = self._random.gauss
        x, y, z = gauss(0.0, noise), gauss(0.0, noise), gauss(0.0, noise)
        position, (qx, qy, qz, qw) = self._frame.source(
            pose.x_m + jump + x,
            pose.y_m + y,
            pose.heading_rad + turn,
            BODY_HEIGHT_M + z,
            self._offsets.get(name, 0.0),
        )
        px = math.nan if "not_finite" in faults else position[0]
        if "tilt" in faults:
            half = 0.5 * faults["tilt"].number(0.0)
            sine, cosine = math.sin(half), math.cos(half)
            if self._frame.y_up:
                qx, qy, qz, qw = sine * qw, cosine * qy, -sine * qy, cosine * qw
            else:
                qx, qy, qz, qw = sine * qw, sine * qz, cosine * qz, cosine * qw
        norm = faults["denormal"].number(1.0) if "denormal" in faults else 1.0
        error_m = faults["marker_error"].number(0.0) if "marker_error" in faults else MEAN_ERROR_M
        params = 0 if hidden else TRACKING_VALID
        body = (identity, px, position[1], position[2], qx * norm, qy * norm, qz * norm, qw * norm, error_m, params)
        self._last[name] = body
        return body

    def _add_markers(self, sight: Sight, name: str, body: Body, heading_rad: float, scale: float) -> None:
        yaw = heading_rad - self._offsets.get(name, 0.0) + self._settings.mocap.rotation_rad
        cosine, sine = math.cos(yaw) * scale, math.sin(yaw) * scale
        points: list[Point3] = []
        for number, (mx, my, _) in enumerate(MARKERS, 1):
            dx, dy = cosine * mx - sine * my, sine * mx + cosine * my
            turned = (dx, 0.0, -dy) if self._frame.y_up else (dx, dy, 0.0)
            point = (body[1] + turned[0], body[2] + turned[1], body[3] + turned[2])
            points.append(point)
            sight.markers.append(Marker((body[0] << 16) + number, point, 0.014 * scale, 0x0A, MEAN_ERROR_M))
        sight.marker_sets.append((name, points))
