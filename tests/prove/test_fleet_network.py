"""An hour of missions in network namespaces, links cut and the router killed meanwhile: nothing leaks, nothing hangs.

Before it, one robot's radio is gone for 0.2, 1, 5 and 30 s, a mission each. As root. ``AHDC_FLEET_S`` seconds (3600).
"""

import os
import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundstation import rig
from groundstation.fleet_rig import FleetRig, fleet_arena
from groundstation.weather import Weather
from tests.root.fleet import HOLD_NS, Fleet, assert_at_zero, commands, judged, reports_of, settled

SECONDS = float(os.environ.get("AHDC_FLEET_S", "3600"))
CUTS_S = (0.2, 1.0, 5.0, 30.0)
BACK_NS = 6_000_000_000
"""An attempt to connect is given up after 2.5 s: two of them, and room."""
LONGEST_S = 300.0
"""Of one mission with all its releases: longer is a hang."""
WARM, SETTLING = 3, 0.25
"""What processes hold after so many missions, and at the end of that part of the time, is what they may hold."""
GROWTH, ROOM_KB = 1.1, 4096
"""Of a process's memory from then to the last mission."""


class Size:
    """What a process holds."""

    def __init__(self, pid: int) -> None:
        folder = Path(f"/proc/{pid}")
        status = (folder / "status").read_text()
        self.pid = pid
        self.memory_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
        self.descriptors = len(list(folder.glob("fd/*")))
        self.threads = len(list(folder.glob("task/*")))

    def leaked(self, before: "Size") -> list[str]:
        """What there is more of than a process that begins mission after mission anew may gain."""
        kinds = (
            ("kB", before.memory_kb, self.memory_kb, GROWTH * before.memory_kb + ROOM_KB),
            ("descriptors", before.descriptors, self.descriptors, before.descriptors + 2),
            ("threads", before.threads, self.threads, before.threads + 1),
        )
        return [f"{was} -> {now} {kind}" for kind, was, now, most in kinds if now > most]


def sizes(site: FleetRig) -> dict[str, Size]:
    """By process; a router that has been killed begins anew."""
    return {child.name: Size(child.pid) for child in site.family.children}


def leaks(before: dict[str, Size], after: dict[str, Size]) -> dict[str, list[str]]:
    found = {name: size.leaked(before[name]) for name, size in after.items() if before[name].pid == size.pid}
    return {name: words for name, words in found.items() if words}


def say(words: str) -> None:
    print(f"{time.strftime('%H:%M:%S')}  {words}", flush=True)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    out = tmp_path_factory.mktemp("prove") / "fleet"
    arena = fleet_arena(rig.find_arena("experiment2"), out, "quic", rig.Changes(targets=10))
    with FleetRig(arena, out) as site:
        site.start_network()
        site.start()
        yield Fleet(site)


@pytest.mark.timeout(900)
def test_one_robots_radio_gone_for_a_while(fleet: Fleet) -> None:
    """Its wheels rest, the others stay one network; it is back by itself, and moves again by the rules."""
    for number, seconds in enumerate(CUTS_S):
        if number:
            fleet.next_mission()
        else:
            fleet.begin()
        began_ns, ended_ns = fleet.cut("r08", seconds)
        released = fleet.finish()
        settled(fleet.folder)
        metrics = judged(fleet.folder)
        assert metrics.completed
        if ended_ns - began_ns > HOLD_NS:
            assert_at_zero(commands(fleet.folder, "r08", began_ns + HOLD_NS, ended_ns))
        after = [report for report in reports_of(fleet.folder, "r08") if report.stamp_ns > ended_ns]
        back_ns = after[0].stamp_ns - ended_ns
        assert back_ns < BACK_NS
        assert after[0].run in (("running", "holding", "disarmed") if seconds < 2.0 else ("stopped", "disarmed"))
        say(
            f"cut for {seconds:g} s: back after {back_ns * 1e-9:.2f} s, {after[0].run}; released {released} times; "
            f"mission {metrics.mission_s:.1f} s, no split"
        )


def disturb(site: FleetRig, dice: random.Random, robots: list[str]) -> str:
    """One robot without radio for a while, or a router that is killed and started again; which, in words."""
    time.sleep(dice.uniform(1.0, 3.0))
    if dice.random() < 0.25:
        site.kill_router()
        return "router killed"
    seconds, robot = dice.choice(CUTS_S), dice.choice(robots)
    site.weather(Weather(loss=0.05, cut=(robot,)))
    time.sleep(seconds)
    site.weather(Weather(loss=0.05, jitter_ms=5.0))
    return f"{robot} cut for {seconds:g} s"


@pytest.mark.timeout(SECONDS + 900)
def test_missions_for_an_hour_leave_nothing_behind(fleet: Fleet) -> None:
    site, dice = fleet.site, random.Random(20260501)
    before: dict[str, Size] = {}
    began, missions, released = time.monotonic(), 0, 0
    while time.monotonic() - began < SECONDS or missions <= WARM:
        over = fleet.folder
        fleet.next_mission()
        words = disturb(site, dice, list(site.arena.robots))
        times = fleet.finish(LONGEST_S)
        released, missions = released + times, missions + 1
        settled(fleet.folder)
        metrics = judged(fleet.folder)
        now = sizes(site)
        if missions == WARM or (missions > WARM and time.monotonic() - began < SETTLING * SECONDS):
            before = now
        mb = sum(size.memory_kb for size in now.values()) / 1024
        say(f"mission {missions}: {words}, {metrics.mission_s:.1f} s, released {times}, {mb:.0f} MB in all")
        for name, found in leaks(before, now).items() if before else ():
            say(f"  {name}: {', '.join(found)}")
        (over / "run.mcap").unlink()  # the folder stays: its name is not given again
    site.weather(Weather())
    found = leaks(before, sizes(site))
    codes = site.end()
    say(f"{missions} missions in {time.monotonic() - began:.0f} s, released and started anew {released} times")
    assert not found
    assert set(codes.values()) == {0}, codes


def test_a_leak_would_be_found() -> None:
    """What the hour is judged by sees one descriptor, thread or tenth of memory too many."""
    before = Size(os.getpid())
    for kind in ("memory_kb", "descriptors", "threads"):
        after = Size(os.getpid())
        setattr(after, kind, round(2 * getattr(before, kind)) + ROOM_KB + 3)
        assert leaks({"r06": before}, {"r06": after})
    assert not leaks({"r06": before}, {"r06": before})
