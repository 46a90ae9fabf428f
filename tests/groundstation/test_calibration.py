"""Calibration against emulated wheels and bodies whose true dimensions differ from the arena file's."""

import math
import random
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from benches import ROBOT, Bench
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import ArenaError, load
from contract.messages import BodyPose, FeedbackBatch, Message, MocapFrame, RobotStep, StepBatch
from contract.overlay import folder_of, overlaid, save
from drivers.base import WheelSpeeds
from drivers.trim import Trim
from groundstation import calibrate
from groundstation.calibration import CalibrationError, Pose, fit_stop, way_of_stop

TRUE = SimpleNamespace(left=1.03, right=0.98, separation=1.05, offset=0.12)
ROUTE = [(16, 16), (0, 0), (-16, -16), (0, 0), (8, -8), (-8, 8), (12, 6), (6, 12), (24, 24), (0, 0), (20, 20), (0, 0)]


def drive(bench: Bench, noise: random.Random | None = None) -> list[Message]:
    """What a recorder would hear: poses with a crooked rigid body, feedback, steps."""
    body = bench.host.robots[ROBOT].body
    body.left_radius_m *= TRUE.left
    body.right_radius_m *= TRUE.right
    body.separation_m *= TRUE.separation
    bench.start()
    heard: list[Message] = []
    frame = 0
    for left, right in ROUTE:
        for _ in range(150):
            frame += 1
            bench.drive.write(WheelSpeeds(left, right), bench.now_ns)
            bench.drive.poll(bench.now_ns)
            step = RobotStep(
                robot=ROBOT,
                frame=frame,
                exposure_ns=bench.now_ns,
                step_ns=bench.now_ns,
                write_ns=bench.now_ns,
                left_radps=left,
                right_radps=right,
            )
            bench._pass(0.01)
            sample = bench.drive.read(bench.now_ns)
            x, y, heading = bench.host.pose(ROBOT)
            shake = (lambda s: noise.gauss(0, s)) if noise else (lambda s: 0.0)
            pose = BodyPose(
                robot=ROBOT,
                x_m=x + shake(2e-4),
                y_m=y + shake(2e-4),
                heading_rad=math.remainder(heading - TRUE.offset + shake(1e-3), math.tau),
            )
            heard.append(StepBatch(robot=ROBOT, steps=(step,)))
            if sample is not None:
                heard.append(FeedbackBatch(robot=ROBOT, samples=(sample,)))
            heard.append(
                MocapFrame(
                    session=1,
                    frame=frame,
                    exposure_ns=bench.now_ns,
                    transmit_ns=bench.now_ns,
                    publish_ns=bench.now_ns,
                    rate_hz=100.0,
                    bodies=(pose,),
                )
            )
    return heard


@pytest.mark.parametrize("kind", ["odrive", "roboclaw"])
@pytest.mark.parametrize("noisy", [False, True])
def test_the_true_dimensions_are_found(kind: str, noisy: bool) -> None:
    bench = Bench(kind)
    streams = calibrate.gather(ROBOT, drive(bench, random.Random(3) if noisy else None))
    found = calibrate.estimate(bench.arena, ROBOT, streams)
    robot = found.overlay["robots"][ROBOT]
    wheels = robot["wheels"]
    assert wheels["left_wheel_radius_multiplier"] == pytest.approx(TRUE.left, abs=0.004)
    assert wheels["right_wheel_radius_multiplier"] == pytest.approx(TRUE.right, abs=0.004)
    assert wheels["wheel_separation_multiplier"] == pytest.approx(TRUE.separation, abs=0.006)
    assert robot["heading_offset_rad"] == pytest.approx(TRUE.offset, abs=0.01)
    low, high = found.overlay["control"]["field"]["brake_deceleration_mps2"]
    assert low < 2.0 < high * 1.02
    assert high / low < 1.4
    short, long = found.overlay["control"]["field"]["motor_lag_s"]
    assert 0.06 < short < long < 0.16


def test_a_calibrated_robot_drives_as_the_nominal_one() -> None:
    trimmed = Bench(
        "odrive",
        left_wheel_radius_multiplier=TRUE.left,
        right_wheel_radius_multiplier=TRUE.right,
        wheel_separation_multiplier=TRUE.separation,
    )
    body = trimmed.host.robots[ROBOT].body
    body.left_radius_m *= TRUE.left
    body.right_radius_m *= TRUE.right
    body.separation_m *= TRUE.separation
    ways = []
    for bench in (trimmed, Bench("odrive")):
        bench.start()
        bench.run(1.0, (10.0, 6.0))
        x, y, heading = bench.host.pose(ROBOT)
        feedback = bench.run(0.4, (10.0, 6.0))
        assert feedback is not None
        assert (feedback.left_radps, feedback.right_radps) == pytest.approx((10.0, 6.0), abs=0.05)
        after = bench.host.pose(ROBOT)
        ways.append((math.dist(after[:2], (x, y)), math.remainder(after[2] - heading, math.tau)))
    assert ways[0] == pytest.approx(ways[1], rel=0.01)


def test_calibrating_twice_changes_nothing() -> None:
    bench = Bench("odrive", left_wheel_radius_multiplier=TRUE.left, right_wheel_radius_multiplier=TRUE.right)
    wheels = calibrate.estimate(bench.arena, ROBOT, calibrate.gather(ROBOT, drive(bench))).overlay["robots"][ROBOT]
    assert wheels["wheels"]["left_wheel_radius_multiplier"] == pytest.approx(TRUE.left, abs=0.005)
    assert wheels["wheels"]["wheel_separation_multiplier"] == pytest.approx(TRUE.separation, abs=0.008)


@given(st.floats(0.9, 1.1), st.floats(0.9, 1.1), st.floats(0.9, 1.1), st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_trim_inward_undoes_outward(left: float, right: float, base: float, first: float, second: float) -> None:
    trim = Trim(left, right, base)
    assert trim.inward(*trim.outward(first, second)) == pytest.approx((first, second), abs=1e-9)


@given(st.floats(1.0, 4.0), st.floats(0.04, 0.2), st.floats(0.3, 0.8))
def test_one_stop_is_fitted(deceleration: float, lag: float, speed: float) -> None:
    times = np.arange(0.0, 0.6, 0.01)
    way = way_of_stop(times, speed, lag, deceleration)
    assert way_of_stop(times, speed, *reversed(fit_stop(times, way, speed))) == pytest.approx(way, abs=2e-3)


def test_too_little_motion_says_what_to_drive() -> None:
    bench = Bench("odrive")
    heard = drive(bench)
    streams = calibrate.gather(ROBOT, heard[:400])
    with pytest.raises(CalibrationError, match=r"spin 3 rad each way"):
        calibrate.estimate(bench.arena, ROBOT, streams)
    with pytest.raises(CalibrationError, match="0 poses"):
        calibrate.estimate(bench.arena, ROBOT, calibrate.Streams(ROBOT))
    backwards = calibrate.gather(ROBOT, heard)
    backwards.poses = [Pose(p.time_s, p.x_m, p.y_m, -p.heading_rad) for p in backwards.poses]
    with pytest.raises(CalibrationError, match="turns against its wheels"):
        calibrate.estimate(bench.arena, ROBOT, backwards)


ARENA = """
[arena]
name = "lab"
size_m = [4.0, 4.0]
[robots.r06]
body = "a"
start = [1.0, 1.0]
wheels = { kind = "roboclaw", port = "/dev/ttyACM0", counts_per_revolution = 2048 }
"""


def test_the_overlay_is_laid_over_the_arena_file(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(ARENA)
    table = {"robots": {"r06": {"heading_offset_rad": 0.1, "wheels": {"wheel_separation_multiplier": 1.05}}}}
    target = folder_of(path) / "r06.toml"
    save(target, table)
    arena = load(path)
    assert arena.robots["r06"].heading_offset_rad == 0.1
    assert arena.robots["r06"].wheels["wheel_separation_multiplier"] == 1.05
    assert arena.robots["r06"].wheels["counts_per_revolution"] == 2048
    assert calibrate.difference(arena, "r06", table) == [
        "  robots.r06.wheels.wheel_separation_multiplier: 1.05 -> 1.05",
        "  robots.r06.heading_offset_rad: 0.1 -> 0.1",
    ]
    assert [entry.name for entry in target.parent.iterdir()] == ["r06.toml"]
    target.write_text("= nonsense")
    with pytest.raises(ArenaError, match="not TOML"):
        load(path)


def test_brake_intervals_become_the_widest_of_all_robots() -> None:
    one, other = ({"control": {"field": {"motor_lag_s": span}}} for span in ([0.05, 0.1], [0.08, 0.2]))
    assert overlaid({"robots": {}}, [one, other])["control"]["field"]["motor_lag_s"] == [0.05, 0.2]
    assert overlaid({"control": {"profile": "paper"}}, [one]) == {"control": {"profile": "paper"}}
