"""One robot's row of the arena page. Pure."""

from typing import Any, NamedTuple

from contract.messages import BodyPose, RobotReport
from groundstation.page_reasons import Complaint


class Sight(NamedTuple):
    """What is known of one robot; None for what is not."""

    report: RobotReport | None
    told: dict[str, Any]
    """:func:`told` of the report."""
    report_age_s: float
    body: BodyPose | None
    pose: tuple[float, float, float, int] | None
    """Last valid: x, y (m), heading (rad), exposure (ns)."""
    exposure_ns: int | None
    """Of the newest frame."""
    speed_mps: float | None
    hold_share: float | None
    """Of the occupying time, of what it does now."""
    acknowledged_ns: int | None
    """From STOP to its answer."""
    away_m: float | None
    """From its start."""
    trouble: Complaint | None
    excluded: bool = False
    """Taken out of the network by the operator."""


def told(report: RobotReport) -> dict[str, Any]:
    """What a row shows of a report: worked out once a report, drawn many times."""
    timing = report.timing
    return {
        "run": report.run,
        "task": task_words(report),
        "claim": report.claim,
        "stopped": report.stopped,
        "pose_ms": round(report.pose_age_ms) if report.pose_age_ms < 1e6 else None,
        "hz": round(timing.rate_hz) if timing else None,
        "jitter_ms": round(timing.jitter_ms, 1) if timing else None,
        "battery_v": round(report.battery_v, 1) if report.battery_v is not None else None,
    }


def row(name: str, sight: Sight) -> dict[str, Any]:
    """What the page draws of one robot; what is not known is left out."""
    report, pose, body = sight.report, sight.pose, sight.body
    found: dict[str, Any] = {"id": name}
    if pose is not None and sight.exposure_ns is not None:
        valid = body is not None and body.valid
        found["x"], found["y"], found["h"] = round(pose[0], 4), round(pose[1], 4), round(pose[2], 3)
        found["valid"] = valid
        found["stale_s"] = 0.0 if valid or body is None else round((sight.exposure_ns - pose[3]) / 1e9, 2)
    if sight.speed_mps is not None:
        found["mps"] = round(sight.speed_mps, 3)
    if report is not None:
        found |= sight.told
        found["report_s"] = round(sight.report_age_s, 2)
        if sight.excluded:
            found["task"] = "Dropped"
        if sight.away_m is not None and (report.run == "disarmed" or report.task == "homing"):
            found["away_m"] = round(sight.away_m, 2)
    if sight.hold_share is not None:
        found["hold"] = sight.hold_share
    if sight.acknowledged_ns is not None:
        found["ack_ms"] = round(sight.acknowledged_ns / 1e6)
    if sight.excluded:
        found["out"] = True
    if sight.trouble is not None:
        found["trouble"] = sight.trouble._asdict()
    return found


def task_words(report: RobotReport) -> str:
    """What it does, for its row: Tracking T06."""
    if report.run != "running":
        idle = {"disarmed": "Ready", "armed": "Armed", "holding": "Holding", "stopped": "Stopped", "fault": "Fault"}
        return idle[report.run]
    target = f" T{report.claim + 1:02d}" if report.claim >= 0 else ""
    words = {
        "tracking": "Tracking",
        "occupied": "Occupying",
        "helping": "Helping",
        "free": "Searching",
        "home": "At home",
    }
    return words.get(report.task, report.task.capitalize()) + (
        target if report.task in ("tracking", "occupied") else ""
    )
