"""Pre-flight: everything the station can tell about a fleet before its wheels get power, as typed checks. Pure."""

import math
from collections.abc import Collection, Iterator
from typing import NamedTuple

from contract.arena import Arena
from contract.checks import CheckResult, Verdict
from contract.exposure import exposure
from contract.margins import cut_m, stopping_m
from contract.messages import MocapHealth, RobotReport
from groundstation.failsafes import STATION_FAILSAFES, Facts

RATE_SHARE = 0.01
"""A loop's rate may be this share off its nominal one."""
ROOM_M = 0.05
"""A robot nearer to another's minimum distance than this at the start is warned of."""


class Fleet(NamedTuple):
    """What was heard while listening."""

    facts: Facts
    places: dict[str, tuple[float, float]]
    """Robots in the newest pose frame, valid, m."""
    health: MocapHealth | None
    heartbeat_ns: int | None
    """Arrival of the station's newest heartbeat; None: none came."""


def preflight(fleet: Fleet) -> list[CheckResult]:
    """Every check of one fleet: site first, then robot by robot."""
    arena = fleet.facts.arena
    results = [*_arena_checks(arena), *_mocap_checks(fleet), *_station_checks(fleet)]
    for name in arena.robots:
        results += _robot_checks(fleet, name)
    return results


SAID_ELSEWHERE = ("reports", "same file and schema", "pose", "loop", "state", *(row.name for row in STATION_FAILSAFES))
"""Checks that a session has words of its own for; where a pose is valid, the loop has run."""


def unfit(fleet: Fleet, crew: Collection[str], overridden: Collection[str] = ()) -> list[str]:
    """What else of the whole list refuses the start of these robots, in words. A bridge not heard of yet is no fault of
    it: that frames come is looked at by itself."""
    found = []
    for result in preflight(fleet):
        known = result.name != "mocap" or fleet.health is not None
        ours = not result.subject or result.subject in crew
        if result.verdict == "fail" and known and ours and result.name not in (*SAID_ELSEWHERE, *overridden):
            found.append(f"{result.subject or result.name}: {result.seen}")
    return found


def _check(name: str, verdict: Verdict, seen: str, remedy: str = "", subject: str = "") -> CheckResult:
    return CheckResult(name=name, verdict=verdict, seen=seen[:400], remedy=remedy[:400], subject=subject)


def _arena_checks(arena: Arena) -> Iterator[CheckResult]:
    control, safety = arena.control, arena.safety
    weak, slow = control.field.brake_deceleration_mps2[0], control.field.motor_lag_s[1]
    braked = stopping_m(control.max_speed_mps, weak, slow)
    cut = cut_m(control.max_speed_mps, safety.watchdog_s, arena.platform.coast_deceleration_mps2)
    seen = f"from {control.max_speed_mps:g} m/s: {braked:.2f} m braked, {cut:.2f} m cut off"
    yield _check("margins", "pass", seen)
    insecure = exposure((arena.link.router, *arena.link.listen), arena.link.keys)
    remedy = "set up certificates: docs/network.md" if insecure else ""
    yield _check("link", "warn" if insecure else "pass", insecure or arena.link.router, remedy)
    unset = not safety.battery_critical_v
    words = "no battery threshold is set" if unset else f"critical below {safety.battery_critical_v:g} V"
    remedy = "set safety.battery_low_v and battery_critical_v" if unset else ""
    emulated = all("wheels" in robot.emulate for robot in arena.robots.values())
    yield _check("battery thresholds", "warn" if unset and not emulated else "pass", words, remedy)


def _mocap_checks(fleet: Fleet) -> Iterator[CheckResult]:
    health = fleet.health
    if health is None:
        yield _check("mocap", "fail", "the bridge says nothing", "start ahdc-mocap-bridge run")
        return
    verdict: Verdict = "pass" if health.state == "ok" else "warn" if health.state == "degraded" else "fail"
    seen = f"{health.state}, {health.rate_hz:.0f} Hz, {health.latency_ms:.1f} ms"
    yield _check("mocap", verdict, f"{seen}; {health.detail}" if health.detail else seen, health.detail)


def _station_checks(fleet: Fleet) -> Iterator[CheckResult]:
    """The station's failsafes; what is said robot by robot below is left out."""
    for row in STATION_FAILSAFES:
        if row.name in ("robot_silent", "robot_differs", "robot_restarted"):
            continue
        words = row.tripped(fleet.facts)
        verdict: Verdict = "pass" if not words else "fail" if row.refuses else "warn"
        yield _check(row.name, verdict, words or "good", f"clears {row.clears}" if words else "")
    seen = fleet.heartbeat_ns is not None
    words = "a station beats" if seen else "no station beats"
    yield _check("station", "pass" if seen else "warn", words, "" if seen else "start ahdc-groundstation session")


def _robot_checks(fleet: Fleet, name: str) -> Iterator[CheckResult]:
    facts = fleet.facts
    report = facts.reports.get(name)
    rows = {row.name: row for row in STATION_FAILSAFES}
    alone = facts._replace(crew=(name,))
    if report is None or rows["robot_silent"].tripped(alone):
        remedy = f"start ahdc-onboard run --robot {name}, look at its log and the network"
        yield _check("reports", "fail", "does not report", remedy, name)
        return
    yield _check("reports", "pass", f"boot {report.boot}", subject=name)
    words = rows["robot_differs"].tripped(alone)
    yield _check(
        "same file and schema", "fail" if words else "pass", words or "same", rows["robot_differs"].clears, name
    )
    words = "" if report.pose_valid else "no valid pose"
    seen = words or f"{report.pose_age_ms:.0f} ms old"
    yield _check(
        "pose", "fail" if words else "pass", seen, "look at the markers and the body's name" if words else "", name
    )
    yield from _state_checks(report, name)
    yield _room(fleet, name)


def _state_checks(report: RobotReport, name: str) -> Iterator[CheckResult]:
    good = report.run in ("disarmed", "armed", "running", "holding") and not (
        report.run == "disarmed" and report.reason
    )
    remedy = "" if good else report.remedy or "release it: ahdc-groundstation release"
    yield _check("state", "pass" if good else "fail", f"{report.run} {report.reason}".strip(), remedy, name)
    if report.motor_faults:
        yield _check("motors", "fail", ", ".join(report.motor_faults), "see docs/drivers.md", name)
    else:
        yield _check("motors", "pass", "no fault", subject=name)
    timing = report.timing
    if timing is None:
        yield _check("loop", "fail", "has not run", "poses do not reach it", name)
    else:
        off = abs(timing.rate_hz - timing.nominal_hz) / timing.nominal_hz
        seen = f"{timing.rate_hz:.1f} of {timing.nominal_hz:.1f} Hz, jitter {timing.jitter_ms:.1f} ms"
        late = off > RATE_SHARE
        yield _check("loop", "warn" if late else "pass", seen, "find what loads this computer" if late else "", name)


def _room(fleet: Fleet, name: str) -> CheckResult:
    least_m = fleet.facts.arena.safety.min_distance_m
    own = fleet.places.get(name)
    gaps = [math.dist(own, place) for other, place in fleet.places.items() if own and other != name]
    gap_m = min(gaps, default=math.inf)
    verdict: Verdict = "fail" if gap_m < least_m else "warn" if gap_m < least_m + ROOM_M else "pass"
    seen = f"nearest robot at {gap_m:.2f} m" if math.isfinite(gap_m) else "no other robot seen"
    return _check("room", verdict, seen, "" if verdict == "pass" else "move it away from the others", name)
