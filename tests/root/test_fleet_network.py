"""A fleet in network namespaces: router, station, bridge and every robot on its own, QUIC with mutual TLS between them.

A mission after the other on one fleet, since its start takes longest: cut links, a router that restarts, a bad radio.
"""

import json
from collections.abc import Iterator

import pytest

from contract.codec import encode
from contract.keys import Keys
from contract.messages import Message, MocapFrame, NeighbourState, OrderRequest, RobotReport, StationHeartbeat
from groundstation import rig
from groundstation.access import STATE_BYTES
from groundstation.fleet_rig import PORT, FleetRig, fleet_arena
from groundstation.weather import Weather
from tests.root.fleet import (
    HOLD_NS,
    Fleet,
    assert_at_zero,
    commands,
    judged,
    secrets_of,
    settled,
    told,
    written,
)

ROBOTS, TARGETS = 6, 5
LONG_CUT_S = 5.0


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    out = tmp_path_factory.mktemp("fleet")
    changes = rig.Changes(robots=ROBOTS, targets=TARGETS, seed=3)
    arena = fleet_arena(rig.find_arena("experiment2"), out, "quic", changes)
    with FleetRig(arena, out) as site:
        site.start_network()
        site.start()
        yield Fleet(site)


@pytest.mark.timeout(400)
def test_cuts_and_a_router_that_is_killed_leave_a_mission_whole(fleet: Fleet) -> None:
    """Wheels rest while a robot hears nothing; all go on, released by the operator where they must, not repaired."""
    site, folder = fleet.site, fleet.folder
    fleet.begin()
    fleet.cut("r08", 0.2)
    began_ns, ended_ns = fleet.cut("r08", 1.0)
    site.kill_router()
    fleet.finish()
    settled(folder)
    judged(folder)
    assert_at_zero(commands(folder, "r08", began_ns + HOLD_NS, ended_ns))


@pytest.mark.timeout(400)
def test_after_a_long_cut_a_robot_waits_for_the_operator_and_the_mission_goes_on(fleet: Fleet) -> None:
    """Unless the others have done the rest without it."""
    folder = fleet.next_mission()
    began_ns, ended_ns = fleet.cut("r08", LONG_CUT_S)
    fleet.finish()
    settled(folder)
    judged(folder)
    assert_at_zero(commands(folder, "r08", began_ns + HOLD_NS, ended_ns))


@pytest.mark.timeout(400)
def test_a_tenth_of_all_frames_lost_and_intruders_besides_stop_no_mission(fleet: Fleet) -> None:
    """Loss on the radio; on the wire a stolen robot's flood of its logs and of states too big for the router, a crowd
    that never says who it is, and holders of the station's, the bridge's and a robot's own keys who say again what was
    said in the first mission. All are processes of their own."""
    site, out = fleet.site, fleet.site.out
    keys, router = Keys(site.arena.arena.name), site.network.address("router")
    old = list(told(out))
    replays: dict[str, tuple[str, Message]] = {
        "station": (keys.heartbeat, next(m for m in old if isinstance(m, StationHeartbeat) and m.order == "run")),
        "bridge": (keys.mocap_frame, next(m for m in old if isinstance(m, MocapFrame))),
        "r08": (keys.state("r08"), next(m for m in old if isinstance(m, NeighbourState) and m.robot == "r08")),
        "operator": (keys.order, next(m for m in old if isinstance(m, OrderRequest) and m.order == "run")),
    }
    lasts = {who: keys.log(who) for who in ("r08", "station")}
    lasts |= {"bridge": keys.log("mocap_bridge"), "operator": keys.order}
    site.weather(Weather(loss=0.1, jitter_ms=5.0))
    folder = fleet.next_mission()
    crowd = {"crowd": True, "address": [router, PORT], "udp_port": PORT, "connections": 200}
    attackers = [
        fleet.attack("mocap", "r08", **crowd),
        fleet.attack("mocap", "r08", put=[keys.log("r08")], bytes=2000, times=10_000, last=keys.log("r08")),
        fleet.attack("mocap", "r08", put=[keys.state("r08")], bytes=STATE_BYTES + 1, times=500, last=keys.log("r08")),
        *(
            fleet.attack("mocap", who, put=[key], again=[key], hex=encode(said).hex(), times=100, last=lasts[who])
            for who, (key, said) in replays.items()
        ),
    ]
    told_us = [json.loads(process.stdout.readline()) for process in attackers if process.stdout is not None]
    assert [entry.get("held", entry.get("opened")) for entry in told_us] == [200, *[True] * (len(attackers) - 1)]
    fleet.finish()
    for process in attackers:
        process.communicate(timeout=30.0)
    site.weather(Weather())
    settled(folder)
    judged(folder)
    reports: dict[str, list[RobotReport]] = {name: [] for name in site.arena.robots}
    for message in told(folder):
        if isinstance(message, RobotReport):
            reports[message.robot].append(message)
    for name, mine in reports.items():
        for counter in ("heartbeat replayed", "frame not newer"):
            assert mine[-1].counters.get(counter, 0) > mine[0].counters.get(counter, 0), (name, counter)


def test_nothing_that_a_fleet_leaves_behind_holds_a_secret(fleet: Fleet) -> None:
    secrets, text = secrets_of(fleet.site.out), written(fleet.site.out)
    assert len(secrets) > ROBOTS
    assert b"link" in text
    assert not [secret for secret in secrets if secret in text]
