"""Emulated wheels under a tracked body, by the arena file alone: ``emulate = ["wheels"]``."""

import msgspec
import pytest

from drivers.mock.body import Body
from groundstation.wire import Wire
from onboard.odometry import Pose
from tests.groundstation.test_repeat_and_home import arena_of, cloud_of
from tests.groundstation.virtual import Virtual

TRACKED = "r01"
WHEELS = {"kind": "roboclaw", "port": "/dev/null", "counts_per_revolution": 2048}


class Cameras(Wire):
    """What cameras see of ``TRACKED`` is a body of their own world: it rolls as the wheels turn, with 2 % of slip."""

    outside: Body

    def pose(self, name: str) -> Pose:
        if name != TRACKED:
            return super().pose(name)
        wheels = self.emulated.robots[name].wheels
        self.outside.roll(0.98 * wheels.left.angle_rad, 0.98 * wheels.right.angle_rad)
        return Pose(self.outside.x_m, self.outside.y_m, self.outside.heading_rad)


def test_a_mission_completes_with_emulated_wheels_under_a_body_tracked_from_outside() -> None:
    base = arena_of(2, gap_m=0.6)
    emulate = {TRACKED: ("wheels",), "r02": ("wheels", "body")}
    robots = {
        name: msgspec.structs.replace(robot, wheels=WHEELS, emulate=emulate[name])
        for name, robot in base.robots.items()
    }
    arena = msgspec.structs.replace(base, robots=robots)
    assert set(arena.virtual_beside_tracked()) == {"r02"}
    starts = [Pose(*robot.start, robot.heading_rad) for robot in arena.robots.values()]
    swarm = Virtual(arena, cloud_of((0.5, 1.1), (1.1, 1.1)), starts, wired=True)
    hops = Cameras(arena, swarm.plants, swarm.agents, seed=1)
    hops.outside = Body(arena.platform, starts[0][:2], starts[0].heading_rad)
    swarm.hops = hops
    swarm.phase("ready", 3.0)
    swarm.order("arm")
    swarm.phase("armed", 2.0)
    swarm.order("run")
    swarm.phase("completed", 40.0)
    inside, outside = hops.emulated.pose(TRACKED), swarm.pose(TRACKED)
    assert abs(inside[0] - outside.x_m) + abs(inside[1] - outside.y_m) > 0.01, "only the tracked body counts"
    assert abs(outside.x_m - starts[0].x_m) + abs(outside.y_m - starts[0].y_m) > 0.3
    assert sorted(swarm.session.occupied) == [0, 1]
    assert [
        name for name in arena.robots if hops.emulated.robots[name].wheels.left.angle_rad == pytest.approx(0.0)
    ] == []
