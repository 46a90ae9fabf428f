"""The failsafes: one row each, in order of gravity. docs/safety.md is generated from this table.

Actions. ``hold``: velocity zero while the cause lasts. ``stop``: STOP, latched. ``fault``: STOP,
latched, and arming is refused while the cause lasts. ``warn``: reported only.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

from contract.arena import Safety

LOST_FACTOR = 4
"""Silence of the station or the wheels for this many of its thresholds turns HOLD into STOP."""


class Conditions(NamedTuple):
    """Plain facts about this robot at one moment; a time of 0 ns means never."""

    pose_valid: bool
    pose_reason: str
    """Why the pose is not valid, as the bridge named it."""
    pose_stamp_ns: int
    """Mid-exposure of the newest own pose."""
    pose_arrival_ns: int
    """When the newest frame reached this robot."""
    frame_advancing: bool
    """The newest frame's number is above the one before, in the same session."""
    feedback_stamp_ns: int
    """Newest wheel feedback."""
    driver_active: bool
    """Motors are enabled, the device has said so."""
    driver_fault: str = ""
    driver_remedy: str = ""
    left_mps: float = 0.0
    """Rim speed of the newest feedback."""
    right_mps: float = 0.0
    loop_last_step_ns: int = 0
    """Last time the control loop ran before this (step or tick)."""
    inside_fence: bool = True
    duplicate_id: bool = False
    """Another process writes this robot's keys."""
    motion_fault: str = ""
    """What the wheels report does not fit what the poses show."""
    jump: str = ""
    """The own body came back elsewhere than its wheels can have taken it."""
    battery_v: float | None = None


class Sight(NamedTuple):
    """What a failsafe's trigger looks at. Ages in seconds; infinite where nothing ever came."""

    now_ns: int
    conditions: Conditions
    safety: Safety
    station_age_s: float
    station_mismatch: str
    """How the station's arena file or message schema differs from ours."""
    driver_quiet_s: float
    """Since the newest feedback, or since activation where that is later; 0 while inactive."""
    seconds_since_loop: float


Action = Literal["hold", "stop", "fault", "warn"]


class Failsafe(NamedTuple):
    name: str
    trigger: str
    threshold: str
    """Key of the arena file, or what fixes it."""
    action: Action
    deadline: str
    """From the trigger being true to zero commanded."""
    clears: str
    remedy: str
    tripped: Callable[[Sight], bool]
    detail: Callable[[Sight], str] = lambda sight: ""


def age_s(stamp_ns: int, now_ns: int) -> float:
    return (now_ns - stamp_ns) / 1e9 if stamp_ns else float("inf")


def _milliseconds(seconds: float) -> str:
    return f"{seconds * 1000:.0f} ms" if seconds != float("inf") else "none yet"


_NEXT = "next step or tick, 20 ms at most"
_RELEASE = "repair, then release (`disarm`) and arm again"

FAILSAFES: tuple[Failsafe, ...] = (
    Failsafe(
        "driver_fault",
        "the motor driver reports a fault or its port is lost",
        "any",
        "fault",
        _NEXT,
        _RELEASE,
        "",
        lambda s: bool(s.conditions.driver_fault),
        lambda s: s.conditions.driver_fault,
    ),
    Failsafe(
        "driver_lost",
        "no wheel feedback while the motors are enabled",
        f"{LOST_FACTOR} x safety.driver_silence_s",
        "fault",
        "already at zero by driver_silent",
        _RELEASE,
        "check the bus, its power and its termination",
        lambda s: s.driver_quiet_s > LOST_FACTOR * s.safety.driver_silence_s,
        lambda s: _milliseconds(s.driver_quiet_s),
    ),
    Failsafe(
        "duplicate_id",
        "another process writes this robot's keys",
        "any",
        "fault",
        _NEXT,
        _RELEASE,
        "give every robot its own id; look for a second agent",
        lambda s: s.conditions.duplicate_id,
    ),
    Failsafe(
        "station_mismatch",
        "the station's message schema or arena file differs from this robot's",
        "equality",
        "fault",
        _NEXT,
        _RELEASE,
        "deploy the same arena file and version everywhere",
        lambda s: bool(s.station_mismatch),
        lambda s: s.station_mismatch,
    ),
    Failsafe(
        "motion_mismatch",
        "wheel feedback does not fit the poses: stuck, lifted, wrong body, swapped wheels, inverted heading",
        "safety.motion_way_m or motion_turn_rad within motion_window_s, motion_share",
        "fault",
        "next step or tick after safety.motion_window_s",
        _RELEASE,
        "look at the robot, then at its body name, wheel order and heading offset",
        lambda s: bool(s.conditions.motion_fault),
        lambda s: s.conditions.motion_fault,
    ),
    Failsafe(
        "pose_jumped",
        "the robot's own body came back, or was put, where its wheels cannot have taken it",
        "safety.motion_way_m / 2 or motion_turn_rad / 2, beyond 1.25 x what the wheels rolled",
        "fault",
        _NEXT,
        "look at the robot, then release (`disarm`) and arm again",
        "look whether the robot was moved, and whether its markers are taken for another body's",
        lambda s: bool(s.conditions.jump),
        lambda s: s.conditions.jump,
    ),
    Failsafe(
        "battery_critical",
        "battery voltage below the critical value",
        "safety.battery_critical_v",
        "stop",
        _NEXT,
        "charge, then release (`disarm`) and arm again",
        "charge the battery",
        lambda s: s.conditions.battery_v is not None and s.conditions.battery_v < s.safety.battery_critical_v,
        lambda s: f"{s.conditions.battery_v} V",
    ),
    Failsafe(
        "station_lost",
        "no heartbeat of the station",
        f"{LOST_FACTOR} x safety.heartbeat_timeout_s",
        "stop",
        "already at zero by station_silent",
        "station back, then release (`disarm`) and arm again",
        "start the station again and look at the network",
        lambda s: s.station_age_s > LOST_FACTOR * s.safety.heartbeat_timeout_s,
        lambda s: _milliseconds(s.station_age_s),
    ),
    Failsafe(
        "outside_fence",
        "the robot's centre is outside the fence by more than the tolerance",
        "arena.fence_m",
        "stop",
        _NEXT,
        "carry it back, then release (`disarm`) and arm again",
        "carry the robot back inside the fence",
        lambda s: not s.conditions.inside_fence,
    ),
    Failsafe(
        "station_silent",
        "no heartbeat of the station",
        "safety.heartbeat_timeout_s",
        "hold",
        _NEXT,
        "by itself with the next heartbeat",
        "look at the station and the network",
        lambda s: s.station_age_s > s.safety.heartbeat_timeout_s,
        lambda s: _milliseconds(s.station_age_s),
    ),
    Failsafe(
        "pose_invalid",
        "the bridge marks the robot's own pose invalid (occluded, jumping, swapped, flipped)",
        "mocap checks",
        "hold",
        _NEXT,
        "by itself with a valid pose",
        "look at the markers and the cameras",
        lambda s: not s.conditions.pose_valid,
        lambda s: s.conditions.pose_reason,
    ),
    Failsafe(
        "pose_silent",
        "no pose frame arrives",
        "safety.pose_silence_s",
        "hold",
        _NEXT,
        "by itself with the next frame",
        "look at the mocap bridge and the network",
        lambda s: age_s(s.conditions.pose_arrival_ns, s.now_ns) > s.safety.pose_silence_s,
        lambda s: _milliseconds(age_s(s.conditions.pose_arrival_ns, s.now_ns)),
    ),
    Failsafe(
        "pose_stale",
        "the newest own pose is too old at mid-exposure",
        "safety.max_pose_age_s",
        "hold",
        _NEXT,
        "by itself with a fresh pose",
        "look at the motion-capture software's load and the network",
        lambda s: age_s(s.conditions.pose_stamp_ns, s.now_ns) > s.safety.max_pose_age_s,
        lambda s: _milliseconds(age_s(s.conditions.pose_stamp_ns, s.now_ns)),
    ),
    Failsafe(
        "pose_ahead",
        "the pose is stamped in the future, beyond the clock's uncertainty (negative age)",
        "safety.clock_tolerance_s",
        "hold",
        _NEXT,
        "by itself with a pose of the right time",
        "check the clock synchronisation of the bridge",
        lambda s: s.conditions.pose_stamp_ns > s.now_ns + round(s.safety.clock_tolerance_s * 1e9),
        lambda s: _milliseconds(-age_s(s.conditions.pose_stamp_ns, s.now_ns)),
    ),
    Failsafe(
        "pose_frozen",
        "frames arrive but their number does not advance",
        "50 ms without a new one",
        "hold",
        _NEXT,
        "by itself when frame numbers advance",
        "restart the motion-capture stream",
        lambda s: not s.conditions.frame_advancing,
    ),
    Failsafe(
        "driver_inactive",
        "the motors are not enabled",
        "the device's answer",
        "hold",
        _NEXT,
        "by itself when the driver is active",
        "",
        lambda s: not s.conditions.driver_active,
    ),
    Failsafe(
        "driver_silent",
        "no wheel feedback while the motors are enabled",
        "safety.driver_silence_s",
        "hold",
        _NEXT,
        "by itself with the next feedback",
        "check the bus, its power and its termination",
        lambda s: s.driver_quiet_s > s.safety.driver_silence_s,
        lambda s: _milliseconds(s.driver_quiet_s),
    ),
    Failsafe(
        "loop_overrun",
        "the control loop did not run for too long",
        "safety.loop_overrun_s",
        "hold",
        "the gate sends zeros after safety.command_age_s, the device cuts after safety.watchdog_s",
        "by itself with the next step on time",
        "find what loads this computer",
        lambda s: s.seconds_since_loop > s.safety.loop_overrun_s,
        lambda s: _milliseconds(s.seconds_since_loop),
    ),
    Failsafe(
        "battery_low",
        "battery voltage below the low value",
        "safety.battery_low_v",
        "warn",
        "-",
        "by itself with the voltage",
        "plan to charge the battery",
        lambda s: s.conditions.battery_v is not None and s.conditions.battery_v < s.safety.battery_low_v,
        lambda s: f"{s.conditions.battery_v} V",
    ),
)
"""In order of gravity: the first row that trips gives the reason."""


def text(row: Failsafe, sight: Sight) -> str:
    """The row's trigger with what was seen, for a person to read."""
    detail = row.detail(sight)
    return f"{row.trigger}: {detail}" if detail else row.trigger


def markdown() -> str:
    """The table of docs/safety.md."""
    lines = ["| failsafe | trigger | threshold | action | zero commanded | clears |", "|---|---|---|---|---|---|"]
    for row in FAILSAFES:
        cells = (f"`{row.name}`", row.trigger, row.threshold, row.action.upper(), row.deadline, row.clears)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
