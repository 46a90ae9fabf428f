"""The arena file: one TOML table to a frozen :class:`Arena`, every fault reported at once.

Sections: ``arena`` (the floor), ``link`` (the network), ``mocap`` (poses in), ``control`` (the
law), ``platform`` (the body), ``safety`` (failsafe thresholds), ``targets``, ``robots``, ``deploy``.
Lengths in metres, angles in radians, frame as in :mod:`contract.units`.
"""

import hashlib
import itertools
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from contract import overlay, profiles
from contract.exposure import RESERVED, link_faults
from contract.margins import margin_faults
from contract.tables import Fault, join, nearest, read_table, show
from contract.units import Point, Radians, RobotId

Positive = Annotated[float, Meta(gt=0.0, le=1000.0)]
Port = Annotated[int, Meta(ge=1, le=65535)]
Endpoint = Annotated[str, Meta(pattern="^(tcp|tls|quic)/.+:[0-9]+$")]
SiteName = Annotated[str, Meta(pattern="^[a-z0-9_-]{1,32}$")]
Interval = tuple[Positive, Positive]

FILE_VERSION = 1


class Floor(Struct, frozen=True, forbid_unknown_fields=True):
    """``[arena]``: the floor and the site's name."""

    name: SiteName
    """Site name: first chunk of every key on the network."""
    size_m: tuple[Annotated[float, Meta(ge=0.5, le=500.0)], Annotated[float, Meta(ge=0.5, le=500.0)]]
    fence_m: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.15
    """Robot centres are kept this far inside the edge."""


class Link(Struct, frozen=True, forbid_unknown_fields=True):
    """``[link]``: how the processes find each other."""

    router: Endpoint = "tcp/127.0.0.1:7447"
    """Where every process finds the router. Beyond loopback: quic/ or tls/, and ``keys``."""
    listen: tuple[Endpoint, ...] = ()
    """Where the router listens, if not at ``router``: such as ["quic/0.0.0.0:7447", "tls/0.0.0.0:7447"]."""
    keys: str = ""
    """Folder of certificates, beside the arena file (docs/network.md); with it you start the router yourself."""
    insecure: bool = False
    """Allow a non-loopback router without certificates; every screen then says so."""


class Mocap(Struct, frozen=True, forbid_unknown_fields=True):
    """``[mocap]``: where poses come from."""

    source: Literal["natnet", "replay", "qualisys", "external"] = "natnet"
    recording: str = ""
    """File to play back where ``source`` is "replay"."""
    server: str = "127.0.0.1"
    local_address: str = "127.0.0.1"
    """Address of this machine's interface towards the motion-capture network."""
    multicast_group: str = ""
    """Empty: unicast."""
    command_port: Port = 1510
    data_port: Port = 1511
    version: Annotated[str, Meta(pattern="^[0-9]+\\.[0-9]+$")] = "4.1"
    """NatNet version to ask for; the server's own version wins where it is older."""
    up_axis: Literal["y", "z"] = "y"
    frame_rate_hz: Annotated[float, Meta(ge=10.0, le=1000.0)] = 120.0
    """Nominal rate: the emulated server streams at it, the bridge warns when 10 % off."""
    origin_m: Point = (0.0, 0.0)
    """Motion-capture coordinates of the arena frame's origin, after the change to z up."""
    rotation_rad: Radians = 0.0
    """Heading of the arena's x axis in motion-capture coordinates, after the change to z up."""
    max_body_speed_mps: Positive = 2.0


class FieldControl(Struct, frozen=True, forbid_unknown_fields=True):
    """``[control.field]``: what the ``field`` profile needs beside the paper's parameters."""

    brake_deceleration_mps2: Interval = (1.6, 2.4)
    """Calibrated interval of the wheel deceleration."""
    motor_lag_s: Interval = (0.06, 0.15)
    """Calibrated interval of the first-order lag from command to wheel speed."""
    max_pose_age_s: Annotated[float, Meta(ge=0.01, le=1.0)] = 0.15
    link_margin_m: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.02
    target_knowledge: Literal["own", "shared"] = "shared"
    """Whether robots tell their neighbours which open targets they have seen."""


class PaperControl(Struct, frozen=True, forbid_unknown_fields=True):
    """``[control.paper]``: what only the letter of the paper needs."""

    cohesion_weight: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.75
    """alpha of eq. 12."""
    run_step_s: Annotated[float, Meta(ge=0.001, le=1.0)] = 0.01
    """delta t of eq. 13."""


class Control(Struct, frozen=True, forbid_unknown_fields=True):
    """``[control]``: parameters of section IV-A and the profile that uses them."""

    profile: Annotated[str, Meta(min_length=1, max_length=40)] = "field"
    """"field", "paper", or a law of your own (docs/testing-your-own.md)."""
    sensing_radius_m: Positive = 1.0
    """r_c"""
    critical_margin_m: Positive = 0.2
    """epsilon = r_c - r_n"""
    avoidance_radius_m: Positive = 0.20
    """r_a"""
    separation_weight: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    """beta of eq. 12"""
    alignment_weight: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    """gamma of eq. 12"""
    max_speed_mps: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.8
    control_period_s: Annotated[float, Meta(ge=0.002, le=0.2)] = 0.01
    state_period_s: Annotated[float, Meta(ge=0.005, le=0.5)] = 0.03
    """A robot tells its neighbours how it is this often."""
    occupying_time_s: Annotated[float, Meta(ge=0.0, le=3600.0)] = 1.0
    reach_m: Annotated[float, Meta(ge=0.005, le=0.5)] = 0.05
    field: FieldControl = FieldControl()
    paper: PaperControl = PaperControl()
    law: dict[str, Any] = {}
    """Handed to a law of your own as it stands."""

    @property
    def noncritical_radius_m(self) -> float:
        """r_n"""
        return self.sensing_radius_m - self.critical_margin_m


class Platform(Struct, frozen=True, forbid_unknown_fields=True):
    """``[platform]``: the robot body, common to all unless a robot's calibration says otherwise."""

    diameter_m: Annotated[float, Meta(ge=0.01, le=2.0)] = 0.14
    wheel_radius_m: Annotated[float, Meta(ge=0.005, le=0.5)] = 0.03
    wheel_separation_m: Annotated[float, Meta(ge=0.01, le=2.0)] = 0.11
    max_acceleration_mps2: Annotated[float, Meta(ge=0.05, le=50.0)] = 2.0
    """Of the wheel rim. Emulated motors and the gate's slew limit use it."""
    motor_lag_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.1
    """Emulated motors only."""
    coast_deceleration_mps2: Annotated[float, Meta(ge=0.01, le=50.0)] = 0.6
    """Of a released (coasting) motor: safety arithmetic and emulated motors."""


class Safety(Struct, frozen=True, forbid_unknown_fields=True):
    """``[safety]``: thresholds of the failsafes (docs/safety.md)."""

    max_pose_age_s: Annotated[float, Meta(ge=0.02, le=1.0)] = 0.15
    pose_silence_s: Annotated[float, Meta(ge=0.02, le=1.0)] = 0.15
    heartbeat_timeout_s: Annotated[float, Meta(ge=0.1, le=2.0)] = 0.5
    neighbour_silence_s: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.5
    driver_silence_s: Annotated[float, Meta(ge=0.02, le=1.0)] = 0.25
    command_age_s: Annotated[float, Meta(ge=0.02, le=1.0)] = 0.1
    """The gate sends zeros once its last command is older."""
    max_slew_mps2: Annotated[float, Meta(ge=0.1, le=1000.0)] = 50.0
    """Growth of a rim speed the last gate lets through; slowing down is never limited."""
    watchdog_s: Annotated[float, Meta(ge=0.02, le=2.0)] = 0.2
    """The motor controller's own: it lets go of the motors after this silence."""
    loop_overrun_s: Annotated[float, Meta(ge=0.01, le=1.0)] = 0.1
    stop_settle_s: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.5
    """STOP disables the motors after this, or as soon as the wheels rest."""
    min_distance_m: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.15
    """Centre distance below which the supervisor stops motion towards another robot."""
    motion_window_s: Annotated[float, Meta(ge=0.2, le=5.0)] = 0.8
    """Wheel feedback and poses are compared over this time."""
    motion_way_m: Annotated[float, Meta(ge=0.02, le=2.0)] = 0.12
    """Wheels, or a body, that went at least this far in it are judged."""
    motion_turn_rad: Annotated[float, Meta(ge=0.1, le=10.0)] = 1.0
    """The same of a turn."""
    motion_share: Annotated[float, Meta(ge=0.1, le=0.9)] = 0.6
    """The body may lack this share of the wheels' way, or turn the other way by what is left of it."""
    clock_tolerance_s: Annotated[float, Meta(ge=0.001, le=0.2)] = 0.02
    """A stamp may lie this far in the future: uncertainty of the site clock."""
    report_age_s: Annotated[float, Meta(ge=0.05, le=2.0)] = 0.3
    """The station refuses to start with robots whose reports are older when they arrive."""
    report_silence_s: Annotated[float, Meta(ge=0.2, le=10.0)] = 1.0
    """The station calls a robot silent after this."""
    min_disk_mb: Annotated[float, Meta(ge=0.0, le=1e6)] = 200.0
    """The station refuses to start with less room for the recording."""
    battery_low_v: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    battery_critical_v: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0


class Targets(Struct, frozen=True, forbid_unknown_fields=True):
    """``[targets]``: a seeded cloud, or points given one by one."""

    count: Annotated[int, Meta(ge=1, le=1000)] = 19
    seed: Annotated[int, Meta(ge=0, le=(1 << 32) - 1)] = 1
    points: tuple[Point, ...] = ()
    """Where given, ``count`` and ``seed`` are not used."""
    start_direction_rad: Radians | None = None
    """Where the swarm is pointed at the start; unset: towards the middle of the cloud."""


class Deploy(Struct, frozen=True, forbid_unknown_fields=True):
    """``[deploy]``: how the robots' computers get their software (docs/deploy.md)."""

    user: Annotated[str, Meta(pattern="^[a-z_][a-z0-9_-]{0,31}$")] = "root"
    """Who logs in by ssh: root, or one who may use sudo without a password."""
    port: Port = 22
    folder: Annotated[str, Meta(pattern="^/[A-Za-z0-9._-]+(/[A-Za-z0-9._-]+)*$")] = "/opt/ahdc"
    """On the robot; each robot has a folder of its own in it."""
    cpus: tuple[Annotated[int, Meta(ge=0, le=1023)], ...] = ()
    """Cores a robot's process is kept on; empty: any."""
    realtime_priority: Annotated[int, Meta(ge=0, le=99)] = 0
    """Above 0: SCHED_FIFO with this priority. Not with emulated wheels: pseudo-terminals are served by ordinary
    kernel threads."""


class Robot(Struct, frozen=True, forbid_unknown_fields=True):
    """``[robots.ID]``: one robot."""

    body: Annotated[str, Meta(min_length=1, max_length=64)]
    """Name of its rigid body in the motion-capture system."""
    start: Point
    wheels: dict[str, Any]
    """``kind`` names the controller family; the other keys belong to it (see drivers/)."""
    heading_rad: Radians = 0.0
    heading_offset_rad: Radians = 0.0
    """Heading of the robot minus heading of its rigid body, from calibration."""
    emulate: tuple[Literal["wheels", "body"], ...] = ()
    """Parts that are emulated rather than real. Default: all real."""
    host: Annotated[str, Meta(pattern="^[A-Za-z0-9.:_-]{0,253}$")] = ""
    """Name or address of its computer, for `deploy`; empty: nothing is deployed to it."""


class Arena(Struct, frozen=True, forbid_unknown_fields=True):
    """A whole arena file, checked."""

    arena: Floor
    robots: dict[RobotId, Robot]
    link: Link = Link()
    mocap: Mocap = Mocap()
    control: Control = Control()
    platform: Platform = Platform()
    safety: Safety = Safety()
    targets: Targets = Targets()
    deploy: Deploy = Deploy()
    version: Literal[1] = 1
    """Version of the file format."""

    def virtual_beside_tracked(self) -> dict[str, Robot]:
        """Robots with a virtual body in a file whose other bodies are tracked; none where all are alike."""
        virtual = {name: robot for name, robot in self.robots.items() if "body" in robot.emulate}
        return {} if len(virtual) == len(self.robots) else virtual


class ArenaError(ValueError):
    """The arena file is not usable; ``faults`` lists everything wrong with it."""

    def __init__(self, source: str, faults: list[Fault]) -> None:
        self.source = source
        self.faults = tuple(faults)
        lines = "\n".join(f"  {fault}" for fault in faults)
        plural = "" if len(faults) == 1 else "s"
        super().__init__(f"{source}: {len(faults)} fault{plural}\n{lines}")


WheelCheck = Callable[[Mapping[str, Any], str], list[Fault]]
"""Checks one ``wheels`` table given its path; the drivers room provides it."""


def load(path: Path, wheel_check: WheelCheck | None = None) -> Arena:
    """Read and check an arena file, its calibration (:mod:`contract.overlay`) laid over it, ``link.keys`` absolute.

    :raises ArenaError: unreadable, not TOML, or any fault in it; all faults are listed.
    """
    try:
        table = overlay.overlaid(tomllib.loads(path.read_text(encoding="utf-8")), overlay.read(path))
    except OSError as error:
        raise ArenaError(str(path), [Fault("file", str(path), error.strerror or str(error))]) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ArenaError(str(path), [Fault("file", str(path), f"not TOML: {error}")]) from None
    arena = parse(table, str(path), wheel_check)
    if not arena.link.keys:
        return arena
    keys = str(path.absolute().parent / arena.link.keys)
    return msgspec.structs.replace(arena, link=msgspec.structs.replace(arena.link, keys=keys))


def parse(table: dict[str, Any], source: str, wheel_check: WheelCheck | None = None) -> Arena:
    """A checked Arena from a TOML table.

    :raises ArenaError: listing every fault found.
    """
    faults: list[Fault] = []
    arena: Arena | None = read_table(Arena, table, "", faults)
    faults += _unused_profile(table)
    robots = table.get("robots")
    if wheel_check is not None and isinstance(robots, dict):
        for name, robot in robots.items():
            if isinstance(robot, dict) and isinstance(robot.get("wheels"), dict):
                faults += wheel_check(robot["wheels"], f"robots.{name}.wheels")
    if arena is not None:
        faults += _cross_checks(arena, {fault.path.partition(".")[0] for fault in faults})
    if faults or arena is None:
        raise ArenaError(source, faults)
    return arena


def table_of(arena: Arena) -> dict[str, Any]:
    """The arena as plain TOML-able tables, defaults written out, the unused profile left off."""
    table = _without_none(msgspec.to_builtins(arena))
    for section in unused_sections(arena.control.profile):
        del table["control"][section]
    return table


def digest(arena: Arena) -> str:
    """Twelve hexadecimal digits that differ whenever two resolved arena files differ in what robots must agree on.

    Left out: how software gets to a robot, where each computer keeps its certificates, where the router listens.
    An arena is never changed in place; the digits of the one asked about last are kept.
    """
    known = _digested[0]
    if known is None or known[0] is not arena:
        known = _digested[0] = (arena, _digest(arena))
    return known[1]


_digested: list[tuple[Arena, str] | None] = [None]


def _digest(arena: Arena) -> str:
    table = table_of(arena)
    del table["deploy"]
    for name in ("keys", "listen"):
        table["link"].pop(name, None)
    for robot in table["robots"].values():
        del robot["host"]
    return hashlib.sha256(msgspec.json.encode(table, order="sorted")).hexdigest()[:12]


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _without_none(entry) if isinstance(entry, dict) else entry
        for key, entry in table.items()
        if entry is not None
    }


def _unused_profile(table: dict[str, Any]) -> list[Fault]:
    control = table.get("control")
    if not isinstance(control, dict):
        return []
    profile = control.get("profile", "field")
    if not isinstance(profile, str):
        return []
    if profile not in profiles.OURS and profile not in (known := profiles.known()):
        text = f"needs one of {', '.join(known)}; a law of your own must be installed on this computer"
        return [Fault("control.profile", show(profile), text, nearest(profile, known))]
    return [
        Fault(f"control.{section}", "", f'not used by profile "{profile}"; remove the section')
        for section in unused_sections(profile)
        if section in control
    ]


def unused_sections(profile: str) -> tuple[str, ...]:
    """Of ``[control]``, by profile. The brakes of ``[control.field]`` bound any law of your own."""
    return {"field": ("paper", "law"), "paper": ("field", "law")}.get(profile, ("paper",))


def _cross_checks(arena: Arena, faulty: set[str]) -> list[Fault]:
    """What no single key shows: relations between keys, each named by the key to change.

    A relation is left out while one of its sections is ``faulty`` in itself: it would be judged on defaults.
    """
    checks: list[tuple[set[str], Callable[[Arena], Iterator[Fault]]]] = [
        ({"link", "robots"}, _link_checks),
        ({"control", "platform"}, _control_checks),
        ({"arena", "platform"}, _floor_checks),
        ({"arena", "control"}, _robot_checks),
        ({"arena", "targets"}, _target_checks),
        ({"safety"}, _safety_checks),
        ({"control", "platform", "safety"}, margin_faults),
    ]
    return [fault for sections, check in checks if not sections & faulty for fault in check(arena)]


def _control_checks(arena: Arena) -> Iterator[Fault]:
    control, diameter_m = arena.control, arena.platform.diameter_m
    r_n = control.noncritical_radius_m
    if not control.critical_margin_m < control.sensing_radius_m:
        text = "must be below sensing_radius_m (r_n = r_c - epsilon > 0)"
        yield Fault("control.critical_margin_m", show(control.critical_margin_m), text)
    elif not control.avoidance_radius_m < r_n:
        text = f"must be below r_n = r_c - epsilon = {r_n:g}"
        yield Fault("control.avoidance_radius_m", show(control.avoidance_radius_m), text)
    if control.avoidance_radius_m < diameter_m:
        text = f"must be at least platform.diameter_m = {diameter_m:g}"
        yield Fault("control.avoidance_radius_m", show(control.avoidance_radius_m), text)
    for name in ("brake_deceleration_mps2", "motor_lag_s"):
        low, high = getattr(control.field, name)
        if low > high:
            yield Fault(f"control.field.{name}", show([low, high]), "must be [low, high] with low <= high")


def _link_checks(arena: Arena) -> Iterator[Fault]:
    yield from link_faults(arena.link.router, arena.link.listen, arena.link.keys, arena.link.insecure)
    if arena.link.keys:
        for name in RESERVED & arena.robots.keys():
            yield Fault(f"robots.{name}", "", "the name of another role's certificate; name the robot otherwise")


def _floor_checks(arena: Arena) -> Iterator[Fault]:
    floor = arena.arena
    if 2 * floor.fence_m + arena.platform.diameter_m >= min(floor.size_m):
        text = f"leaves no floor of {floor.size_m[0]:g} x {floor.size_m[1]:g} m"
        yield Fault("arena.fence_m", show(floor.fence_m), text)


def _target_checks(arena: Arena) -> Iterator[Fault]:
    for index, point in enumerate(arena.targets.points):
        if not _inside(point, arena.arena):
            yield Fault(f"targets.points[{index}]", show(list(point)), _floor_text(arena.arena))


def _safety_checks(arena: Arena) -> Iterator[Fault]:
    safety = arena.safety
    if safety.battery_critical_v > safety.battery_low_v:
        text = "must not exceed safety.battery_low_v"
        yield Fault("safety.battery_critical_v", show(safety.battery_critical_v), text)


def _robot_checks(arena: Arena) -> Iterator[Fault]:
    bodies: dict[str, str] = {}
    floor, least_m = arena.arena, arena.control.avoidance_radius_m
    if not arena.robots:
        yield Fault("robots", "", "at least one robot is needed: [robots.r01]")
    for name, robot in arena.robots.items():
        path = join("robots", name)
        if robot.body in bodies:
            yield Fault(f"{path}.body", show(robot.body), f"already the body of {bodies[robot.body]}")
        bodies.setdefault(robot.body, name)
        if not _inside(robot.start, floor):
            yield Fault(f"{path}.start", show(list(robot.start)), _floor_text(floor))
        if not isinstance(robot.wheels.get("kind"), str):
            text = 'needs the controller family, such as "odrive"'
            yield Fault(f"{path}.wheels.kind", show(robot.wheels.get("kind", "")), text)
    for first, second in itertools.combinations(arena.robots, 2):
        start = arena.robots[second].start
        gap_m = math.dist(arena.robots[first].start, start)
        if gap_m < least_m:
            text = f"is {gap_m:.2f} m from {first}; at least {least_m:g} m (control.avoidance_radius_m) needed"
            yield Fault(f"robots.{second}.start", show(list(start)), text)


def _inside(point: Point, floor: Floor) -> bool:
    return all(floor.fence_m <= c <= size - floor.fence_m for c, size in zip(point, floor.size_m, strict=True))


def _floor_text(floor: Floor) -> str:
    low, (width, height) = floor.fence_m, floor.size_m
    return f"must lie inside the fence: x from {low:g} to {width - low:g}, y from {low:g} to {height - low:g}"


def robot_or_fault(arena: Arena, name: str) -> Robot:
    """The named robot.

    :raises ArenaError: no such robot, naming those there are.
    """
    if name in arena.robots:
        return arena.robots[name]
    known = sorted(arena.robots)
    hint = nearest(name, known) or f"robots: {', '.join(known)}"
    raise ArenaError(arena.arena.name, [Fault(f"robots.{name}", "", "not in the arena file", hint)])
