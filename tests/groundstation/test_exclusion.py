"""Robots taken out of the network by the operator, and taken in again: session and agents in virtual time."""

import pytest

from contract.arena import parse
from contract.messages import Target, TargetCloud
from groundstation.exclusion import trouble
from groundstation.targets import pointing
from onboard.agent import Drive
from onboard.ahdc.links import Link
from onboard.odometry import Pose
from tests.groundstation.virtual import Virtual

PLACES = ((0.4, 0.5), (1.0, 0.5), (1.6, 0.5), (2.2, 0.5))
"""A row: r02 and r03 are each the only way between the others, but for r_c = 1 m."""


CLOUD = ((0.5, 1.6), (1.1, 1.6), (1.7, 1.6))


def swarm_of(*places: tuple[float, float], cloud: tuple[tuple[float, float], ...] = CLOUD) -> Virtual:
    robots = {
        f"r{i + 1:02d}": {"body": f"b{i}", "start": place, "wheels": {"kind": "odrive"}}
        for i, place in enumerate(places)
    }
    arena = parse({"arena": {"name": "out", "size_m": [4.0, 3.0]}, "robots": robots}, "test")
    targets = tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(cloud))
    told = TargetCloud(mission="lab", start_direction_rad=pointing(places, cloud), targets=targets)
    swarm = Virtual(arena, told, [Pose(*place, 1.57) for place in places])
    swarm.phase("ready", 2.0)
    return swarm


def started(swarm: Virtual) -> Virtual:
    swarm.order("arm")
    swarm.phase("armed", 2.0)
    swarm.order("run")
    swarm.until(lambda: all(agent.run_state == "running" for agent in swarm.agents.values()), 1.0)
    return swarm


def link(swarm: Virtual, one: str, other: str) -> Link:
    field = swarm.agents[one].controller.field
    assert field is not None
    return field.links.state(other)


def test_an_excluded_robot_stands_still_and_the_others_complete_the_mission() -> None:
    swarm = started(swarm_of(*PLACES))
    swarm.order("exclude", ("r04",))
    assert swarm.session.status(swarm.now_ns).detail == "without r04; the others are one piece"
    swarm.until(lambda: swarm.agents["r04"].supervisor.excluded == {"r04"}, 0.2)
    swarm.until(lambda: swarm.agents["r04"].tick(swarm.now_ns)[1:] == (0.0, 0.0), 0.2)
    rest = swarm.pose("r04")
    swarm.phase("completed", 40.0)
    assert swarm.pose("r04")[:2] == pytest.approx(rest[:2], abs=0.05)
    assert link(swarm, "r03", "r04") is Link.OFF
    assert swarm.session.status(swarm.now_ns).excluded == ("r04",)


@pytest.mark.parametrize("mute", [False, True], ids=["tells", "hangs"])
@pytest.mark.parametrize(
    "cloud",
    [
        ((2.7, 0.5), (3.1, 0.5), (3.5, 0.5)),
        ((2.0, 0.5), (1.9, 0.9), (2.6, 0.9)),
        ((2.2, 0.72), (2.42, 0.5), (2.2, 0.28)),
    ],
    ids=["beyond it", "before it", "beside it"],
)
def test_targets_near_an_excluded_robot_are_not_left_to_it(
    cloud: tuple[tuple[float, float], ...], mute: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """r04 stands in the way, and tracked one of them as it was taken out."""
    swarm = started(swarm_of(*PLACES, cloud=cloud))
    swarm.until(lambda: any(getattr(m, "robot", "") == "r04" and getattr(m, "claim", -1) >= 0 for m in swarm.said), 0.5)
    if mute:
        monkeypatch.setattr(swarm.agents["r04"], "outbox", lambda _: [])
        monkeypatch.setattr(swarm.agents["r04"], "step", lambda _: Drive(True, 0.0, 0.0))
        monkeypatch.setattr(swarm.agents["r04"], "tick", lambda _: Drive(True, 0.0, 0.0))
    swarm.order("exclude", ("r04",))
    swarm.phase("completed", 15.0)
    assert swarm.least_m > swarm.arena.platform.diameter_m


def test_the_pieces_left_behind_are_named() -> None:
    swarm = swarm_of((0.4, 0.5), (1.3, 0.5), (2.2, 0.5))
    swarm.order("exclude", ("r02",))
    assert swarm.session.detail == "without r02; they part into r01 and r03"


def test_a_robot_readmitted_while_the_others_run_is_linked_again() -> None:
    swarm = started(swarm_of(*PLACES))
    swarm.order("exclude", ("r04",))
    swarm.until(lambda: link(swarm, "r03", "r04") is Link.OFF, 0.3)
    assert "r04" in swarm.session.missing
    swarm.order("readmit", ("r04",))
    assert swarm.session.missing == ()
    swarm.until(lambda: link(swarm, "r03", "r04") is Link.ON, 3.0)
    assert swarm.session.heartbeat(swarm.now_ns).excluded == ()


def test_a_robot_excluded_before_the_start_may_be_silent_or_at_fault() -> None:
    swarm = swarm_of(*PLACES)
    swarm.order("exclude", ("r04",))
    swarm.agents["r04"].driver_fault("port gone", "plug it in", swarm.now_ns)
    swarm.order("arm")
    swarm.phase("armed", 2.0)
    assert swarm.session.detail == "armed without r04; run to start"
    swarm.order("run")
    swarm.phase("completed", 40.0)


@pytest.mark.parametrize("robots", [(), ("r09",), ("r01", "r02", "r03", "r04")])
def test_nobody_and_everybody_is_refused(robots: tuple[str, ...]) -> None:
    swarm = swarm_of(*PLACES)
    swarm.order("exclude", robots)
    assert swarm.session.detail == "exclude refused: name robots of the arena, not all of them"
    assert swarm.session.excluded == frozenset()


def test_strangers_are_named_before_anybody_is_asked() -> None:
    arena = swarm_of(*PLACES).arena
    assert trouble(arena, ["r01", "r9"]) == "r9: not in the arena file, which has r01, r02, r03, r04"
    assert trouble(arena, ["r04"]) == ""
