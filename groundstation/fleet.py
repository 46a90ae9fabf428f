"""``fleet``: what every robot does, says and runs, side by side; it only listens."""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

from contract.arena import Arena, digest
from contract.messages import SCHEMA_VERSION, LogEntry, Message, RobotReport
from groundstation.current import arena_of
from groundstation.link import Link, LinkError

LISTEN_S = 1.2
EXAMPLES = """\
  fleet status                  one line a robot: state, network, counters of what it refused
  fleet version                 software, message schema and arena file of every robot; 1 where they differ
  fleet logs --robot r06        what r06 says, until Ctrl-C
"""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.epilog = EXAMPLES
    parser.add_argument("what", choices=("status", "logs", "version"), metavar="status|logs|version")
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    parser.add_argument("--robot", action="append", default=[], metavar="ID", help="this one only; may be repeated")
    parser.add_argument("--wait", type=float, metavar="S", help=f"listen this long ({LISTEN_S:g} s; logs: for ever)")


def run(args: argparse.Namespace) -> int:
    """Exit code 1: a robot is silent, at fault or differs; 2: no such robot."""
    arena = arena_of(args.arena)
    names = args.robot or list(arena.robots)
    strange = [name for name in names if name not in arena.robots and args.what != "logs"]
    if strange:
        print(f"no such robot: {', '.join(strange)}; there are {', '.join(arena.robots)}", file=sys.stderr)
        return 2
    try:
        with Link(arena, "fleet", timeout_s=2.0) as link:
            if args.what == "logs":
                return _logs(link, args.robot, args.wait)
            reports = _reports(link, names, LISTEN_S if args.wait is None else args.wait)
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1
    lines, well = (status_lines if args.what == "status" else version_lines)(arena, names, reports)
    print("\n".join(lines))
    return 0 if well else 1


def _listen(link: Link, seconds: float | None, hear: Callable[[Message], None]) -> None:
    deadline = None if seconds is None else time.monotonic() + seconds
    while deadline is None or time.monotonic() < deadline:
        link.wait(0.25 if deadline is None else min(0.25, deadline - time.monotonic()))
        for _, message in link.drain():
            hear(message)


def _reports(link: Link, names: list[str], seconds: float) -> dict[str, RobotReport]:
    found: dict[str, RobotReport] = {}

    def hear(message: Message) -> None:
        if isinstance(message, RobotReport):
            found[message.robot] = message

    link.subscribe(link.keys.report(name) for name in names)
    _listen(link, seconds, hear)
    return found


def _logs(link: Link, sources: list[str], seconds: float | None) -> int:
    def hear(message: Message) -> None:
        if isinstance(message, LogEntry):
            print(log_line(message), flush=True)

    link.subscribe(map(link.keys.log, sources) if sources else [f"{link.keys.site}/log/*"])
    _listen(link, seconds, hear)
    return 0


def log_line(entry: LogEntry) -> str:
    """Site time in seconds, level, source, event, text."""
    words = f"{entry.event}: {entry.text}" if entry.text and entry.event else entry.text or entry.event
    return f"{entry.stamp_ns / 1e9:12.3f}  {entry.level:<7}  {entry.source:<12}  {words}"


def status_lines(arena: Arena, names: list[str], reports: dict[str, RobotReport]) -> tuple[list[str], bool]:
    """One line a robot, and whether all are well."""
    lines, well = [], True
    for name in names:
        report = reports.get(name)
        if report is None:
            lines.append(f"{name:<8}  SILENT    start its agent, look at its network and certificate")
            well = False
            continue
        parts = [f"{name:<8}", f"{report.run:<8}"]
        parts.append(f"pose {report.pose_age_ms:.0f} ms" if report.pose_valid else "no pose")
        if report.timing is not None:
            parts.append(f"{report.timing.rate_hz:.1f}/{report.timing.nominal_hz:.0f} Hz")
        if report.battery_v is not None:
            parts.append(f"{report.battery_v:.1f} V")
        parts.append(f"links {len(report.links_on)}+{len(report.links_kept)}")
        parts += [f"{counter} {count}" for counter, count in sorted(report.counters.items()) if count]
        if report.reason:
            parts.append(f"{report.reason}; {report.remedy}".rstrip("; "))
        lines.append("  ".join(parts))
        well = well and report.run not in ("stopped", "fault") and not report.motor_faults
    return lines, well


def version_lines(arena: Arena, names: list[str], reports: dict[str, RobotReport]) -> tuple[list[str], bool]:
    """Software, schema and arena file of every robot beside the station's, and whether they agree."""
    own = digest(arena)
    lines = [f"{'station':<8}  schema {SCHEMA_VERSION}  arena file {own}"]
    versions, well = set(), True
    for name in names:
        report = reports.get(name)
        if report is None:
            lines.append(f"{name:<8}  SILENT")
            well = False
            continue
        versions.add(report.software)
        same = (report.schema_version, report.arena_hash) == (SCHEMA_VERSION, own)
        words = (
            f"schema {report.schema_version}  arena file {report.arena_hash}  software {report.software or 'unknown'}"
        )
        lines.append(f"{name:<8}  {words}{'' if same else '  DIFFERS'}")
        well = well and same
    if len(versions) > 1:
        lines.append("software differs between robots")
    return lines, well and len(versions) < 2
