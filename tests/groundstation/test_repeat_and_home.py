"""Repeat and home, by the station's session and the robots' agents in virtual time."""

import math
import random

import msgspec
import pytest

from contract.arena import Arena, parse
from contract.messages import RobotReport, Target, TargetCloud
from groundstation.tally import next_mission
from onboard.odometry import Pose
from tests.groundstation.virtual import Virtual


def arena_of(robots: int, profile: str = "field", gap_m: float = 0.4, columns: int = 3) -> Arena:
    table = {
        f"r{i + 1:02d}": {
            "body": f"b{i}",
            "start": [0.35 + gap_m * (i % columns), 0.35 + gap_m * (i // columns)],
            "heading_rad": round(math.remainder(0.7 * i, math.tau), 3),
            "wheels": {"kind": "odrive"},
        }
        for i in range(robots)
    }
    floor = {"name": "home", "size_m": [4.0, 5.0]}
    return parse(
        {"arena": floor, "mocap": {"frame_rate_hz": 100.0}, "control": {"profile": profile}, "robots": table}, "test"
    )


def cloud_of(*points: tuple[float, float]) -> TargetCloud:
    return TargetCloud(mission="lab", targets=tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(points)))


def scattered(arena: Arena, seed: int) -> list[Pose]:
    """Anywhere inside the fence, 0.25 m apart at least."""
    rng = random.Random(seed)
    poses: list[Pose] = []
    while len(poses) < len(arena.robots):
        x, y = rng.uniform(0.25, 3.75), rng.uniform(0.25, 4.75)
        if all(math.hypot(x - p.x_m, y - p.y_m) > 0.25 for p in poses):
            poses.append(Pose(x, y, rng.uniform(-math.pi, math.pi)))
    return poses


def at_start(arena: Arena) -> list[Pose]:
    return [Pose(*robot.start, 0.3) for robot in arena.robots.values()]


def test_a_mission_is_repeated_with_every_target_open_again() -> None:
    arena = arena_of(2)
    swarm = Virtual(arena, cloud_of((0.5, 1.2), (0.9, 1.3)), at_start(arena))
    swarm.phase("ready", 2.0)
    for run in (1, 2, 3):
        swarm.order("arm")
        swarm.phase("armed", 2.0)
        swarm.order("repeat")
        assert swarm.session.phase == "armed", "not while armed"
        swarm.order("run")
        swarm.phase("completed", 40.0)
        assert sorted(swarm.session.occupied) == [0, 1]
        status = swarm.session.status(swarm.now_ns)
        assert status.mission == ("lab" if run == 1 else f"lab.{run}")
        assert status.elapsed_s > (0.5 if run == 1 else 0.0)
        swarm.order("repeat")
        assert swarm.session.occupied == ()
        assert swarm.session.status(swarm.now_ns).elapsed_s == 0.0
        swarm.phase("ready", 2.0)
    assert {agent.controller.tasking.memory.occupied for agent in swarm.agents.values()} == {0}


@pytest.mark.parametrize(
    ("before", "after"), [("lab", "lab.2"), ("lab.2", "lab.3"), ("lab.99", "lab.100"), ("a.b", "a.b.2"), ("", ".2")]
)
def test_a_missions_next_name(before: str, after: str) -> None:
    assert next_mission(before) == after
    assert len(next_mission("x" * 64)) <= 64


@pytest.mark.parametrize(("robots", "seed", "profile"), [(6, 1, "field"), (4, 2, "paper"), (9, 3, "field")])
def test_robots_strewn_anywhere_drive_home_without_touching(robots: int, seed: int, profile: str) -> None:
    arena = arena_of(robots, profile)
    swarm = Virtual(arena, cloud_of((2.0, 3.0)), scattered(arena, seed))
    swarm.until(lambda: "pieces" in swarm.session.detail, 2.0)
    assert "r02 belongs at x 0.75, y 0.35" in swarm.session.detail
    swarm.order("home")
    swarm.phase("homing", 0.1)
    swarm.until(lambda: swarm.session.phase != "homing", 120.0)
    assert swarm.session.detail == "all robots at home"
    swarm.phase("ready", 3.0)
    for name, robot in arena.robots.items():
        pose = swarm.pose(name)
        assert math.dist(pose[:2], robot.start) < 0.03, name
        assert abs(math.remainder(pose.heading_rad - robot.heading_rad, math.tau)) < 0.25, name
        assert swarm.agents[name].run_state == "disarmed"
    assert swarm.least_m > arena.platform.diameter_m


def test_home_releases_links_and_the_next_mission_starts_with_them() -> None:
    arena = arena_of(3)
    swarm = Virtual(arena, cloud_of((2.0, 0.5)), at_start(arena))
    swarm.phase("ready", 2.0)

    def links() -> set[str]:
        return {name for agent in swarm.agents.values() for name in agent.controller.link_states()}

    swarm.until(lambda: links() == set(arena.robots), 2.0)
    for name, agent in swarm.agents.items():
        agent.homing.home = agent.homing.home._replace(x_m=arena.robots[name].start[0] + 0.3)
    swarm.order("home")
    swarm.until(lambda: swarm.session.heartbeat(swarm.now_ns).home, 2.0)
    swarm.until(lambda: not links(), 0.2)
    reports = [m for m in swarm.said if isinstance(m, RobotReport)]
    assert all(report.task in ("homing", "home") and not report.links_on for report in reports)
    swarm.phase("ready", 60.0)
    assert links() == set(arena.robots)
    swarm.order("arm")
    swarm.phase("armed", 2.0)
    swarm.order("run")
    swarm.phase("completed", 40.0)


def test_a_stop_on_the_way_home_stops_and_release_does_not_resume() -> None:
    arena = arena_of(3)
    swarm = Virtual(arena, cloud_of((2.0, 3.0)), scattered(arena, 4))
    swarm.until(lambda: bool(swarm.session.misplaced()) and "pieces" in swarm.session.detail, 2.0)
    swarm.order("home")
    swarm.until(lambda: all(agent.run_state == "running" for agent in swarm.agents.values()), 2.0)
    for _ in range(50):
        swarm.turn()
    swarm.session.order("stop", swarm.now_ns)
    for _ in range(100):
        swarm.turn()
    assert swarm.session.phase == "stopped"
    swarm.order("home")
    assert "refused" in swarm.session.detail
    swarm.order("disarm")
    places = [swarm.pose(name) for name in swarm.agents]
    for _ in range(200):
        swarm.turn()
    assert all(
        math.dist(swarm.pose(name)[:2], place[:2]) < 1e-3 for name, place in zip(swarm.agents, places, strict=True)
    )
    assert swarm.session.phase == "waiting"
    swarm.order("home")
    swarm.phase("ready", 60.0)


def test_home_is_refused_with_the_reason_while_a_robot_has_no_pose_or_wheels_are_armed() -> None:
    arena = arena_of(2)
    swarm = Virtual(arena, cloud_of((2.0, 3.0)), at_start(arena))
    swarm.order("home")
    assert "home refused: r01 does not report" in swarm.session.detail
    swarm.phase("ready", 2.0)
    swarm.order("arm")
    swarm.phase("armed", 2.0)
    swarm.order("home")
    assert swarm.session.detail == "home refused while armed"


VESC = {
    "kind": "vesc",
    "channel": "can0",
    "interface": "slcan",
    "left": 1,
    "right": 2,
    "pole_pairs": 7,
    "min_erpm": 100.0,
    "watchdog_s": 0.2,
}


def test_robots_whose_wheels_cannot_creep_come_home_by_very_bytes() -> None:
    """VESCs without a gearbox: below 45 mm/s their wheels stand."""
    base = arena_of(2, gap_m=1.0)
    robots = {
        name: msgspec.structs.replace(robot, wheels=VESC, emulate=("wheels", "body"))
        for name, robot in base.robots.items()
    }
    arena = msgspec.structs.replace(base, robots=robots)
    swarm = Virtual(arena, cloud_of((2.0, 3.0)), [Pose(0.9, 1.6, 2.0), Pose(2.0, 1.2, -2.5)], wired=True)
    swarm.until(lambda: "belongs" in swarm.session.detail or swarm.session.phase == "ready", 5.0)
    swarm.order("home")
    swarm.phase("homing", 0.1)
    swarm.until(lambda: swarm.session.phase != "homing", 60.0)
    assert swarm.session.detail == "all robots at home"
    for name, robot in arena.robots.items():
        pose = swarm.pose(name)
        assert math.dist(pose[:2], robot.start) < 0.05, name
        assert abs(math.remainder(pose.heading_rad - robot.heading_rad, math.tau)) < 0.35, name
