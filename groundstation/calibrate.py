"""``calibrate``: a robot's real dimensions and brakes from a recording, written as its overlay of the arena file.

Drive the robot with motion capture and the recorder running (a mission, or by hand): straight ahead, in
curves, spins both ways, and ten stops from full speed. Nothing is written before the difference was shown
and accepted.
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from contract import overlay
from contract.arena import Arena, load
from contract.messages import FeedbackBatch, Message, MocapFrame, StepBatch
from groundstation.brake_fit import Brakes, fit_brakes
from groundstation.calibration import (
    CalibrationError,
    Geometry,
    Pose,
    Turned,
    fit_geometry,
    fit_heading_offset,
    windows,
)

SURE_MPS = 0.02
"""A commanded rim speed above this is a drive, below it a stop."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = __doc__
    parser.add_argument("recording", type=Path, help="run.mcap of a run with this robot")
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file to calibrate")
    parser.add_argument("--robot", required=True, metavar="ID")
    parser.add_argument("--yes", action="store_true", help="write without asking")


def run(args: argparse.Namespace) -> int:
    from groundstation.recording import Recording, RecordingError

    arena = load(args.arena)
    if args.robot not in arena.robots:
        print(f"--robot {args.robot}: the arena file has {', '.join(arena.robots)}", file=sys.stderr)
        return 2
    streams = Streams(args.robot)
    try:
        for recorded in Recording(args.recording).messages():
            streams.take(recorded.message)
        found = estimate(arena, args.robot, streams)
    except (RecordingError, CalibrationError) as error:
        print(error, file=sys.stderr)
        return 1
    for line in found.notes:
        print(line)
    target = overlay.folder_of(args.arena) / f"{args.robot}.toml"
    before = target.read_text(encoding="utf-8") if target.exists() else ""
    print(f"\n{target}:")
    print("\n".join(difference(arena, args.robot, found.overlay)))
    if not args.yes and input("write it? [y/N] ").strip().lower() not in ("y", "yes"):
        print("nothing written")
        return 1
    overlay.save(target, found.overlay)
    try:
        load(args.arena)
    except ValueError as error:
        target.write_text(before, encoding="utf-8") if before else target.unlink()
        print(f"the arena file does not accept it, nothing changed: {error}", file=sys.stderr)
        return 1
    return 0


class Streams:
    """What the estimators need of a recording."""

    def __init__(self, robot: str) -> None:
        self.robot = robot
        self.poses: list[Pose] = []
        self.wheels: list[Turned] = []
        self.stops_s: list[float] = []
        self._driving = False

    def take(self, message: Message | None) -> None:
        if isinstance(message, MocapFrame):
            for body in message.bodies:
                if body.robot == self.robot and body.valid:
                    self.poses.append(Pose(message.exposure_ns * 1e-9, body.x_m, body.y_m, body.heading_rad))
        elif isinstance(message, FeedbackBatch) and message.robot == self.robot:
            self.wheels += [Turned(s.stamp_ns * 1e-9, s.left_rad, s.right_rad) for s in message.samples]
        elif isinstance(message, StepBatch) and message.robot == self.robot:
            for step in message.steps:
                self._command(step.write_ns * 1e-9, max(abs(step.left_radps), abs(step.right_radps)))

    def _command(self, time_s: float, radps: float) -> None:
        driving = radps * 0.03 > SURE_MPS
        if self._driving and not driving and radps == 0.0:
            self.stops_s.append(time_s)
        self._driving = driving


class Found:
    """An overlay and what led to it."""

    def __init__(self, table: dict[str, Any], notes: list[str]) -> None:
        self.overlay = table
        self.notes = notes


def estimate(arena: Arena, robot: str, streams: Streams) -> Found:
    """Everything the streams determine, as an overlay; what they do not is noted.

    :raises CalibrationError: not even the dimensions.
    """
    platform, entry = arena.platform, arena.robots[robot]
    seen = windows(sorted(set(streams.poses)), sorted(set(streams.wheels)))
    geometry = fit_geometry(seen, platform.wheel_radius_m, platform.wheel_separation_m)
    notes = [
        f"{geometry.windows} windows; fit off by {geometry.way_rms_m * 1e3:.1f} mm "
        f"and {geometry.turn_rms_rad * 1e3:.1f} mrad each"
    ]
    robot_table: dict[str, Any] = {"wheels": _multipliers(entry.wheels, geometry)}
    table: dict[str, Any] = {"robots": {robot: robot_table}}
    try:
        robot_table["heading_offset_rad"] = round(entry.heading_offset_rad + fit_heading_offset(seen), 5)
    except CalibrationError as error:
        notes.append(f"heading offset left alone: {error}")
    try:
        brakes = fit_brakes(sorted(set(streams.poses)), streams.stops_s)
        notes.append(
            f"{brakes.stops} stops; each fit knows the deceleration to {brakes.deceleration_share:.1%} or better, "
            f"the lag to {brakes.lag_share:.1%}"
        )
        table["control"] = {"field": _intervals(brakes)}
    except CalibrationError as error:
        notes.append(f"brakes left alone: {error}")
    return Found(table, notes)


def _multipliers(wheels: dict[str, Any], geometry: Geometry) -> dict[str, float]:
    """Feedback is already trimmed by the present multipliers, so the new ones multiply them."""
    fitted = {
        "left_wheel_radius_multiplier": geometry.left_multiplier,
        "right_wheel_radius_multiplier": geometry.right_multiplier,
        "wheel_separation_multiplier": geometry.separation_multiplier,
    }
    return {key: round(float(wheels.get(key, 1.0)) * value, 5) for key, value in fitted.items()}


def _intervals(brakes: Brakes) -> dict[str, list[float]]:
    return {
        "brake_deceleration_mps2": [round(value, 3) for value in brakes.deceleration_mps2],
        "motor_lag_s": [round(value, 4) for value in brakes.lag_s],
    }


def difference(arena: Arena, robot: str, table: dict[str, Any]) -> list[str]:
    """One line a value: where it stands, what it is, what it would be."""
    entry = arena.robots[robot]
    rows: list[tuple[str, object, object]] = []
    for key, value in table["robots"][robot]["wheels"].items():
        rows.append((f"robots.{robot}.wheels.{key}", entry.wheels.get(key, 1.0), value))
    if "heading_offset_rad" in table["robots"][robot]:
        new = table["robots"][robot]["heading_offset_rad"]
        rows.append((f"robots.{robot}.heading_offset_rad", entry.heading_offset_rad, new))
    for key, value in table.get("control", {}).get("field", {}).items():
        rows.append((f"control.field.{key}", list(getattr(arena.control.field, key)), value))
    return [f"  {path}: {old} -> {new}" for path, old, new in rows]


def gather(robot: str, messages: Iterable[Message]) -> Streams:
    """Streams of any source of messages."""
    streams = Streams(robot)
    for message in messages:
        streams.take(message)
    return streams
