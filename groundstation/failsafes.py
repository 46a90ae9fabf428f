"""The station's failsafes: what it sees of the whole swarm that no single robot can. One row each. Pure.

A row that trips before the start refuses it (``refuses``). While robots have power, ``stop`` is STOP for all, latched;
``warn`` is named in the status, and the mission goes on: robots look after themselves (onboard/failsafes.py).
"""

from collections.abc import Callable, Collection, Mapping
from typing import Literal, NamedTuple

from contract.arena import Arena
from contract.messages import SCHEMA_VERSION, RobotReport


class Facts(NamedTuple):
    """What the station knows at one moment."""

    now_ns: int
    arena: Arena
    arena_hash: str
    crew: tuple[str, ...]
    """Robots of this mission."""
    reports: Mapping[str, RobotReport]
    heard_ns: Mapping[str, int]
    """Arrival of each robot's newest report."""
    boots: Mapping[str, int]
    """Boot of each robot when it was armed."""
    seen: int
    """Robots of the crew in the newest pose frame, valid."""
    frame_ns: int
    """Arrival of that frame; 0: none yet."""
    components: int
    disk_free_mb: float | None = None
    """Where the recording is written; None: nobody has looked."""


class StationFailsafe(NamedTuple):
    name: str
    trigger: str
    threshold: str
    action: Literal["stop", "warn"]
    refuses: bool
    """The start waits until it is clear."""
    deadline: str
    clears: str
    tripped: Callable[[Facts], str]
    """Who or what, in words; empty: all is well."""


def _of(facts: Facts, judge: Callable[[RobotReport], str]) -> str:
    """What a judgement says of every robot that has reported."""
    return "; ".join(words for name in facts.crew if (report := facts.reports.get(name)) and (words := judge(report)))


def differs(report: RobotReport, arena_hash: str) -> str:
    """How a robot's message schema or arena file differs from the station's."""
    if report.schema_version != SCHEMA_VERSION:
        return f"{report.robot} speaks schema {report.schema_version}, station {SCHEMA_VERSION}"
    if report.arena_hash != arena_hash:
        return f"{report.robot} has another arena file ({report.arena_hash}, station {arena_hash})"
    return ""


def _rebooted(facts: Facts) -> str:
    def judge(report: RobotReport) -> str:
        boot = facts.boots.get(report.robot, report.boot)
        return f"{report.robot} has restarted (boot {report.boot}, armed as {boot})" if report.boot != boot else ""

    return _of(facts, judge)


def _ahead(facts: Facts) -> str:
    def judge(report: RobotReport) -> str:
        ahead_ns = report.stamp_ns - facts.heard_ns[report.robot]
        late = ahead_ns > round(facts.arena.safety.clock_tolerance_s * 1e9)
        return f"{report.robot}'s clock is {ahead_ns * 1e-6:.0f} ms ahead of its messages" if late else ""

    return _of(facts, judge)


def _behind(facts: Facts) -> str:
    def judge(report: RobotReport) -> str:
        age_ns = facts.heard_ns[report.robot] - report.stamp_ns
        late = age_ns > round(facts.arena.safety.report_age_s * 1e9)
        return f"{report.robot}'s reports are {age_ns * 1e-6:.0f} ms old when they come" if late else ""

    return _of(facts, judge)


def silent(facts: Facts) -> list[str]:
    """Robots of the crew not heard of for ``safety.report_silence_s``."""
    limit_ns = facts.arena.safety.report_silence_s * 1e9
    return [name for name in facts.crew if facts.now_ns - facts.heard_ns.get(name, -1 << 62) > limit_ns]


def _software(facts: Facts) -> str:
    versions: dict[str, list[str]] = {}
    for name in facts.crew:
        if (report := facts.reports.get(name)) and report.software:
            versions.setdefault(report.software, []).append(name)
    parts = [f"{version}: {', '.join(names)}" for version, names in sorted(versions.items())]
    return f"software differs ({'; '.join(parts)})" if len(parts) > 1 else ""


def _disk(facts: Facts) -> str:
    free, least = facts.disk_free_mb, facts.arena.safety.min_disk_mb
    return f"{free:.0f} MB free for the recording, {least:g} MB needed" if free is not None and free < least else ""


def _split(facts: Facts) -> str:
    whole = facts.components <= 1 or facts.seen < len(facts.crew)
    return "" if whole else f"the swarm is in {facts.components} pieces"


def _mocap(facts: Facts) -> str:
    quiet_s = (facts.now_ns - facts.frame_ns) * 1e-9
    late = quiet_s > facts.arena.safety.report_silence_s
    return "no pose frames" + (f" for {quiet_s:.1f} s" if facts.frame_ns else " yet") if late else ""


_NEXT = "next heartbeat, 50 ms at most"

STATION_FAILSAFES: tuple[StationFailsafe, ...] = (
    StationFailsafe(
        "robot_restarted",
        "a robot's process has restarted since it was armed",
        "equality of boot numbers",
        "stop",
        False,
        _NEXT + "; the robot itself comes up disarmed",
        "release, then arm again",
        _rebooted,
    ),
    StationFailsafe(
        "robot_differs",
        "a robot's message schema or arena file differs from the station's",
        "equality",
        "stop",
        True,
        _NEXT,
        "deploy the same file and version, then release and arm again",
        lambda facts: _of(facts, lambda report: differs(report, facts.arena_hash)),
    ),
    StationFailsafe(
        "clock_ahead",
        "a robot's report is stamped after its arrival",
        "safety.clock_tolerance_s",
        "stop",
        True,
        _NEXT,
        "start its agent anew: it asks for the time again; then release and arm",
        _ahead,
    ),
    StationFailsafe(
        "clock_behind",
        "a robot's report is old when it arrives: its clock is behind, or the network holds messages back",
        "safety.report_age_s",
        "warn",
        True,
        _NEXT,
        "by itself with the next report in time",
        _behind,
    ),
    StationFailsafe(
        "robot_silent",
        "a robot does not report",
        "safety.report_silence_s",
        "warn",
        True,
        _NEXT,
        "by itself with its next report",
        lambda facts: f"silent: {', '.join(names)}" if (names := silent(facts)) else "",
    ),
    StationFailsafe(
        "poses_silent",
        "no pose frame reaches the station",
        "safety.report_silence_s",
        "warn",
        True,
        _NEXT + "; robots hold by pose_silent",
        "by itself with the next frame",
        _mocap,
    ),
    StationFailsafe(
        "swarm_split",
        "the disk graph of the swarm is in pieces",
        "control.sensing_radius_m",
        "warn",
        True,
        _NEXT,
        "by itself when it is one piece",
        _split,
    ),
    StationFailsafe(
        "disk_low",
        "the disk of the recording is nearly full",
        "safety.min_disk_mb",
        "warn",
        True,
        "1 s",
        "by itself with free space",
        _disk,
    ),
    StationFailsafe(
        "software_differs",
        "robots run different software versions",
        "equality",
        "warn",
        False,
        _NEXT,
        "by itself when they agree",
        _software,
    ),
)
"""In order of gravity."""


OVERRIDABLE = ("clock_behind", "swarm_split", "disk_low", "mocap", "room")
"""Rows, and checks of :mod:`groundstation.preflight`, that a named override lets pass before the start; the others no
one can waive."""


def refusals(facts: Facts, said: Collection[str] = (), overridden: Collection[str] = ()) -> list[str]:
    """What refuses the start, in words; rows ``said`` elsewhere are left out, and those the operator takes on."""
    rows = (row for row in STATION_FAILSAFES if row.refuses and row.name not in said)
    return [words for row in rows if row.name not in overridden and (words := row.tripped(facts))]


def stops(facts: Facts) -> str:
    """Why the whole swarm must stop, in words; empty: it need not."""
    return "; ".join(words for row in STATION_FAILSAFES if row.action == "stop" and (words := row.tripped(facts)))


def warnings(facts: Facts) -> str:
    """What is to be said while the mission goes on."""
    return "; ".join(words for row in STATION_FAILSAFES if row.action == "warn" and (words := row.tripped(facts)))


def markdown() -> str:
    """The station's table of docs/safety.md."""
    lines = [
        "| failsafe | trigger | threshold | before the start | with power on | named or STOP sent | clears |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in STATION_FAILSAFES:
        before = "refused" if row.refuses else "-"
        action = "STOP" if row.action == "stop" else "WARN"
        cells = (f"`{row.name}`", row.trigger, row.threshold, before, action, row.deadline, row.clears)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown())
