"""Why a robot is not well, and what to do about it, in words for the arena page. Pure."""

from typing import Literal, NamedTuple

from contract.arena import Arena, digest
from contract.messages import SCHEMA_VERSION, TOOK_OVER, BodyPose, RobotReport

SILENT_S = 1.0
SLOW_LOOP = 0.8
"""Of the nominal rate."""
JITTER = 1.0
"""Of the nominal period."""
CLOCK_S = 0.05
"""A report stamped this far ahead of its arrival comes from another clock."""
LATE_S = 0.5
POWERED = ("armed", "running", "holding")

Level = Literal["fault", "caution"]

WHY_POSE = {
    "occluded": ("Mocap has lost sight of its markers", "Clear the view or refit a marker"),
    "jumped": ("Its pose jumped farther than a robot can drive", "Look for a mirror image or a swapped marker"),
    "swapped": ("Its body was taken for another one", "Make the marker patterns differ, then define the bodies again"),
    "flipped": ("Its heading flipped", "Make the marker pattern asymmetric"),
}


class Complaint(NamedTuple):
    """One thing wrong with one robot."""

    level: Level
    title: str
    value: str
    limit: str
    why: str
    now: str
    do: str


class Heard(NamedTuple):
    """What the station knows of a robot; ages in seconds, negative for never."""

    report: RobotReport | None
    report_age_s: float
    body: BodyPose | None
    frame_age_s: float
    ahead_s: float = 0.0
    """Stamp of the newest report minus its arrival, site time."""


def seconds(value: float) -> str:
    """Short: 0.31 s, 1.8 s, 62 ms."""
    return f"{value * 1e3:.0f} ms" if value < 0.1 else f"{value:.2f} s" if value < 1.0 else f"{value:.1f} s"


def complaint(arena: Arena, robot: str, heard: Heard) -> Complaint | None:
    """The gravest trouble of one robot, None when it is well."""
    report = heard.report
    if report is None or heard.report_age_s < 0:
        do = f"Start its agent: ahdc-onboard run --robot {robot}. Check its power and its network"
        return Complaint("caution", "Not heard", "", "", "Its agent has not reported yet", "It is not armed", do)
    safety = arena.safety
    if heard.report_age_s > SILENT_S:
        why = "Its agent ended, or the network to it is down"
        now = f"It stops by itself after {safety.heartbeat_timeout_s:g} s without the station"
        do = "Keep clear, look at it and its network. Its agent starts again by itself where systemd runs it"
        return Complaint("fault", "Silent", seconds(heard.report_age_s), f"limit {SILENT_S:g} s", why, now, do)
    return (
        _mismatch(arena, report)
        or _pose(arena, heard, report)
        or _driver(report)
        or _stated(report)
        or _timing(report)
        or _battery(arena, report)
        or _clock(heard)
        or _alone(arena, report)
    )


def _mismatch(arena: Arena, report: RobotReport) -> Complaint | None:
    now = "It refuses to arm"
    if report.schema_version != SCHEMA_VERSION:
        why = f"It speaks message schema {report.schema_version}, the station {SCHEMA_VERSION}"
        return Complaint("fault", "Other software", "", "", why, now, "Install the same version on robot and station")
    if report.arena_hash != digest_of(arena):
        why = f"It has arena file {report.arena_hash or '(none)'}, the station {digest_of(arena)}"
        return Complaint("fault", "Other arena file", "", "", why, now, "Deploy this arena file, restart its agent")
    return None


_DIGESTS: dict[int, tuple[Arena, str]] = {}
"""By identity; the arena is kept, so that no other takes its identity."""


def digest_of(arena: Arena) -> str:
    """:func:`contract.arena.digest`, worked out once an arena."""
    if id(arena) not in _DIGESTS:
        _DIGESTS[id(arena)] = (arena, digest(arena))
    return _DIGESTS[id(arena)][1]


def _wheels(report: RobotReport) -> str:
    return "Its wheels are at rest" if report.stopped else "It slows down to zero"


def _pose(arena: Arena, heard: Heard, report: RobotReport) -> Complaint | None:
    limit_s = arena.safety.max_pose_age_s
    age_s = report.pose_age_ms / 1e3
    body = heard.body
    if report.pose_valid and age_s <= limit_s:
        return None
    level: Level = "fault" if report.run in POWERED else "caution"
    limit = f"limit {limit_s:.2f} s"
    value = seconds(age_s) if age_s < 1e5 else "never"
    tail = "; it goes on by itself with a good pose" if report.run in POWERED else ", then arm"
    if heard.frame_age_s < 0 or heard.frame_age_s > SILENT_S:
        why, do = "No pose frames reach the station either", "Look at the mocap bridge and the camera software"
    elif body is None:
        why, do = "Its body is not in the frames", "Check robots.ID.body in the arena file against the camera software"
    elif not body.valid:
        why, do = WHY_POSE.get(body.reason, (f"Mocap: {body.reason or 'not valid'}", "Look at markers and cameras"))
    else:
        why, do = "The station has its pose, the robot does not", "Look at the robot's network"
    title = "No pose" if value == "never" else "Pose stale" if age_s > limit_s else "Pose invalid"
    return Complaint(level, title, value, limit, why, _wheels(report), do + tail)


def _driver(report: RobotReport) -> Complaint | None:
    if not report.motor_faults:
        return None
    why = f"Motor controller: {', '.join(report.motor_faults)}"
    do = report.remedy or "Remove the cause, then release and arm"
    return Complaint("fault", "Motor fault", "", "", why, _wheels(report), do)


def _stated(report: RobotReport) -> Complaint | None:
    """What the robot itself says, in its words."""
    if not report.reason:
        return None
    if report.run == "disarmed" and report.reason == TOOK_OVER:
        return None
    level: Level = "fault" if report.run in ("fault", "stopped", "holding") else "caution"
    title = {"fault": "Fault", "stopped": "Stopped", "holding": "Waits"}.get(report.run, "Not ready")
    why = report.reason[:1].upper() + report.reason[1:]
    do = report.remedy[:1].upper() + report.remedy[1:]
    return Complaint(level, title, "", "", why, _wheels(report), do or "Release, arm, and look again")


def _timing(report: RobotReport) -> Complaint | None:
    timing = report.timing
    if timing is None or timing.nominal_hz <= 0:
        return None
    do = "Find what loads its computer (top); check its CPU governor"
    if timing.rate_hz < SLOW_LOOP * timing.nominal_hz:
        limit = f"nominal {timing.nominal_hz:.0f} Hz"
        why = f"{timing.misses} steps missed so far"
        return Complaint("caution", "Loop slow", f"{timing.rate_hz:.0f} Hz", limit, why, "It drives on", do)
    limit_ms = JITTER * 1e3 / timing.nominal_hz
    if timing.jitter_ms > limit_ms:
        value, limit = f"{timing.jitter_ms:.1f} ms", f"limit {limit_ms:.1f} ms"
        why = f"Steps are late, {timing.misses} missed so far"
        return Complaint("caution", "Loop jitter", value, limit, why, "It drives on", do)
    return None


def _battery(arena: Arena, report: RobotReport) -> Complaint | None:
    volts, safety = report.battery_v, arena.safety
    if volts is None or volts >= safety.battery_low_v:
        return None
    now = f"It stops below {safety.battery_critical_v:g} V"
    limit = f"limit {safety.battery_low_v:g} V"
    return Complaint(
        "caution", "Battery low", f"{volts:.1f} V", limit, "The battery runs out", now, "Plan to charge it"
    )


def _clock(heard: Heard) -> Complaint | None:
    do = "Look at its network: what comes late makes the site's time uncertain"
    if heard.ahead_s > CLOCK_S:
        why = "Its reports are stamped in the future"
        return Complaint("caution", "Clock ahead", seconds(heard.ahead_s), f"limit {CLOCK_S:g} s", why, "", do)
    if heard.ahead_s < -LATE_S:
        why = "Its reports arrive late: its clock is behind, or its network is slow"
        return Complaint("caution", "Clock behind", seconds(-heard.ahead_s), f"limit {LATE_S:g} s", why, "", do)
    return None


def _alone(arena: Arena, report: RobotReport) -> Complaint | None:
    if len(arena.robots) < 2 or report.neighbours:
        return None
    reach = arena.control.sensing_radius_m
    why = f"No other robot within {reach:g} m"
    return Complaint("caution", "Alone", "", "", why, "It has no link", f"Place it within {reach:g} m of another robot")
