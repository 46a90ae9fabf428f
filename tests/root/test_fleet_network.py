"""A fleet in network namespaces: router, station, bridge and every robot on its own, QUIC with mutual TLS between them.

A mission after the other on one fleet, since its start takes longest: cut links, a router that restarts, a bad radio.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from contract.messages import MotorBatch, MotorSample
from groundstation import rig, runfolder
from groundstation.fleet_operator import PATIENCE_S, Operator
from groundstation.fleet_rig import FleetRig, fleet_arena
from groundstation.metrics import Metrics
from groundstation.recording import Recording
from groundstation.weather import Weather

ROBOTS, TARGETS = 6, 8
LONG_CUT_S = 5.0
HOLD_NS = 450_000_000
"""From the cut until a robot holds: poses silent for 0.15 s, a step, the motor's bus, the relay's 50 ms; and room."""


class Fleet(Operator):
    """A running fleet with its station."""

    def cut(self, robot: str, seconds: float) -> tuple[int, int]:
        """Let nothing of the robot through the radio for so long; from and until when, site time ns."""
        self.site.weather(Weather(cut=(robot,)))
        began_ns = time.monotonic_ns()
        time.sleep(seconds)
        ended_ns = time.monotonic_ns()
        self.site.weather(Weather())
        return began_ns, ended_ns


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    out = tmp_path_factory.mktemp("fleet")
    changes = rig.Changes(robots=ROBOTS, targets=TARGETS, seed=3)
    arena = fleet_arena(rig.find_arena("experiment2"), out, "quic", changes)
    with FleetRig(arena, out) as site:
        site.start_network()
        site.start()
        yield Fleet(site)


def commands(folder: Path, robot: str, began_ns: int, ended_ns: int) -> list[MotorSample]:
    """What the emulated motors decoded in that time; they are recorded over the wire."""
    batches = (entry.message for entry in Recording(folder / "run.mcap").messages())
    mine = (batch for batch in batches if isinstance(batch, MotorBatch) and batch.robot == robot)
    return [sample for batch in mine for sample in batch.samples if began_ns <= sample.stamp_ns <= ended_ns]


def assert_at_zero(samples: list[MotorSample]) -> None:
    assert samples, "the motors heard of it"
    moving = [sample for sample in samples if (sample.left_radps or sample.right_radps) and not sample.released]
    assert not moving


def judged(folder: Path) -> Metrics:
    """What the mission came to; its network never split and nobody touched another."""
    metrics = runfolder.read(folder).metrics
    assert metrics is not None
    assert (metrics.disconnected_frames, metrics.collisions) == (0, 0)
    return metrics


def settled(folder: Path) -> None:
    """Until the recorder has written what was to be judged."""
    size, deadline = -1, time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline and (now := (folder / "run.mcap").stat().st_size) != size:
        size = now
        time.sleep(2.0)


@pytest.mark.timeout(400)
def test_cuts_and_a_router_that_is_killed_leave_a_mission_whole(fleet: Fleet) -> None:
    """Wheels rest while a robot hears nothing; all go on, released by the operator where they must, not repaired."""
    site = fleet.site
    fleet.begin()
    fleet.cut("r08", 0.2)
    began_ns, ended_ns = fleet.cut("r08", 1.0)
    site.kill_router()
    fleet.finish()
    settled(site.out)
    judged(site.out)
    assert_at_zero(commands(site.out, "r08", began_ns + HOLD_NS, ended_ns))


@pytest.mark.timeout(400)
def test_after_a_long_cut_a_robot_waits_for_the_operator_and_the_mission_goes_on(fleet: Fleet) -> None:
    """Unless the others have done the rest without it."""
    site = fleet.site
    fleet.again()
    began_ns, ended_ns = fleet.cut("r08", LONG_CUT_S)
    fleet.finish()
    folder = site.out.with_name(f"{site.out.name}-2")
    settled(folder)
    judged(folder)
    assert_at_zero(commands(folder, "r08", began_ns + HOLD_NS, ended_ns))


@pytest.mark.timeout(400)
def test_a_tenth_of_all_frames_lost_splits_no_network_and_stops_no_mission(fleet: Fleet) -> None:
    site = fleet.site
    site.weather(Weather(loss=0.1, jitter_ms=5.0))
    fleet.again()
    fleet.finish()
    folder = site.out.with_name(f"{site.out.name}-3")
    settled(folder)
    judged(folder)
