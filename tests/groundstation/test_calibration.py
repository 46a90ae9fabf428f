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
from groundstation.brake_fit import LEAST_STOPS, Brakes, fit_brakes, fit_stop, sureness, way_of_stop
from groundstation.calibration import CalibrationError, Pose

TRUE = SimpleNamespace(left=1.03, right=0.98, separation=1.05, offset=0.12)
ROUTE = [(16, 16), (0, 0), (-16, -16), (0, 0), (8, -8), (-8, 8), (12, 6), (6, 12), (24, 24), (0, 0), (20, 20), (0, 0)]
STOPS = [(speed, speed) for top in (18, -18, 22, -22, 24, -24) for speed in (top, 0)]
LEGS = [(150, *speeds) for speeds in ROUTE] + [(75, *speeds) for speeds in STOPS]
"""Steps of 10 ms at wheel speeds in rad/s."""


def drive(bench: Bench, noise: random.Random | None = None) -> list[Message]:
    """What a recorder would hear: poses with a crooked rigid body, feedback, steps."""
    body = bench.host.robots[ROBOT].body
    body.left_radius_m *= TRUE.left
    body.right_radius_m *= TRUE.right
    body.separation_m *= TRUE.separation
    bench.start()
    heard: list[Message] = []
    frame = 0
    for steps, left, right in LEGS:
        for _ in range(steps):
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


def rolled(speed_mps: float, deceleration_mps2: float, lag_s: float, begin_s: float, error_m: float) -> list[Pose]:
    """A straight run and a stop ``0.2 s`` after its beginning, seen at 100 Hz with an error that alternates."""
    poses = []
    for step in range(100):
        time_s = 0.01 * step - 0.2
        way = way_of_stop(np.array([max(0.0, time_s)]), speed_mps, lag_s, deceleration_mps2)[0] + speed_mps * min(
            0.0, time_s
        )
        poses.append(Pose(begin_s + 0.2 + time_s, float(way) + error_m * (-1) ** step, 0.0, 0.0))
    return poses


def brakes_of(stops: list[tuple[float, float, float]], error_m: float = 0.0) -> Brakes:
    """Of stops given by speed, deceleration and lag."""
    poses = [pose for n, stop in enumerate(stops) for pose in rolled(*stop, 10.0 * n, error_m)]
    return fit_brakes(poses, [10.0 * n + 0.2 for n in range(len(stops))])


def test_nine_stops_make_an_interval_and_five_are_refused_with_the_likelihood() -> None:
    stops = [(0.6, 1.8 + 0.05 * n, 0.08 + 0.005 * n) for n in range(LEAST_STOPS)]
    brakes = brakes_of(stops, 2e-4)
    assert brakes.stops == LEAST_STOPS
    assert brakes.deceleration_mps2 == pytest.approx((0.95 * 1.8, 1.05 * 2.2), rel=0.03)
    assert brakes.lag_s == pytest.approx((0.95 * 0.08, 1.05 * 0.12), rel=0.06)
    assert 0.0 < brakes.deceleration_share < 0.03
    with pytest.raises(CalibrationError, match=r"5 stops from 0\.25 m/s .*; 9 are needed.*four times in five"):
        brakes_of(stops[:5], 2e-4)


def test_stops_that_do_not_tell_deceleration_from_lag_do_not_count() -> None:
    """From 0.3 m/s with a lag of 0.2 s the deceleration of 2 m/s2 is never reached."""
    with pytest.raises(CalibrationError, match=r"0 stops .* and 12 more whose deceleration or lag .* to 10%"):
        brakes_of([(0.3, 2.0, 0.2)] * 12, 2e-4)
    times = np.arange(0.0, 0.6, 0.01)
    slow = way_of_stop(times, 0.3, 0.2, 2.0)
    assert sureness(times, slow, 0.3, (2.0, 0.2))[0] == math.inf
    quick = way_of_stop(times, 0.8, 0.1, 2.0)
    assert max(sureness(times, quick, 0.8, (2.0, 0.1))) < 0.01
    with pytest.raises(CalibrationError, match="more whose deceleration or lag"):
        brakes_of([(0.6, 2.0, 0.1)] * 12, 8e-3)


def test_stops_on_different_floors_are_refused() -> None:
    with pytest.raises(CalibrationError, match=r"10 stops know the middle deceleration to 1\d%"):
        brakes_of([(0.7, 1.2 if n % 2 else 3.4, 0.08) for n in range(10)])


def test_the_fits_own_uncertainty_is_that_of_many_noisy_stops() -> None:
    rng = np.random.default_rng(1)
    times = np.arange(0.0, 0.6, 0.01)
    way = way_of_stop(times, 0.7, 0.1, 2.0)
    noisy = [way + rng.normal(0.0, 1e-3, len(times)) for _ in range(30)]
    fits = [fit_stop(times, seen, 0.7) for seen in noisy]
    told = np.mean([sureness(times, seen, 0.7, fit) for seen, fit in zip(noisy, fits, strict=True)], axis=0)
    assert np.std(np.log(fits), axis=0) == pytest.approx(told, rel=0.5)


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
