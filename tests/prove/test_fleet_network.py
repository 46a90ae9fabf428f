"""An hour of missions in network namespaces, links cut and the router killed meanwhile: nothing leaks, nothing hangs.

``AHDC_FLEET_S`` seconds of it (3600), as root.
"""

import os
import random
import time
from pathlib import Path

import pytest

from groundstation import rig, runfolder
from groundstation.fleet_operator import Operator
from groundstation.fleet_rig import FleetRig, fleet_arena
from groundstation.weather import Weather

SECONDS = float(os.environ.get("AHDC_FLEET_S", "3600"))
CUTS_S = (0.2, 1.0, 5.0, 30.0)
GROWTH = 1.1
"""Of a process's memory from the third mission to the last."""


def memory_kb(pid: int) -> int:
    text = Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) for line in text.splitlines() if line.startswith("VmRSS"))


def measured(site: FleetRig) -> dict[str, tuple[int, int, int]]:
    """Process -> memory in kB, descriptors, threads; the router begins anew and is left out."""
    found = {}
    for child in site.family.children:
        if child.name != "router":
            folder = Path(f"/proc/{child.pid}")
            found[child.name] = (memory_kb(child.pid), len(list(folder.glob("fd/*"))), len(list(folder.glob("task/*"))))
    return found


def disturb(site: FleetRig, dice: random.Random, robots: list[str]) -> None:
    """One robot without radio for a while, or a router that is killed and started again."""
    time.sleep(dice.uniform(1.0, 3.0))
    if dice.random() < 0.25:
        site.kill_router()
        return
    seconds = dice.choice(CUTS_S)
    site.weather(Weather(loss=0.05, cut=(dice.choice(robots),)))
    time.sleep(seconds)
    site.weather(Weather(loss=0.05, jitter_ms=5.0))


@pytest.mark.timeout(SECONDS + 900)
def test_missions_for_an_hour_leave_nothing_behind(tmp_path: Path) -> None:
    dice = random.Random(20260501)
    out = tmp_path / "fleet"
    arena = fleet_arena(rig.find_arena("experiment2"), out, "quic", rig.Changes(targets=12))
    before: dict[str, tuple[int, int, int]] = {}
    missions = released = 0
    with FleetRig(arena, out) as site:
        site.start_network()
        site.start()
        operator = Operator(site)
        deadline = time.monotonic() + SECONDS
        while time.monotonic() < deadline or missions < 4:
            if missions:
                operator.again()
            else:
                operator.begin()
            disturb(site, dice, list(arena.robots))
            released += operator.finish()
            missions += 1
            if missions == 3:
                before = measured(site)
        after = measured(site)
        codes = site.end()
    assert set(codes.values()) == {0}, codes
    for name, (memory, descriptors, threads) in after.items():
        assert memory <= GROWTH * before[name][0], (name, before[name], memory)
        assert descriptors <= before[name][1] + 2, (name, before[name], descriptors)
        assert threads <= before[name][2] + 1, (name, before[name], threads)
    for number in range(1, missions + 1):
        metrics = runfolder.read(out if number == 1 else out.with_name(f"fleet-{number}")).metrics
        assert metrics is not None
        assert (metrics.disconnected_frames, metrics.collisions) == (0, 0), number
    print(f"{missions} missions, released and started anew {released} times")
