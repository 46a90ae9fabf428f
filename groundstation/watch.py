"""``watch``: progress and every robot, live in the terminal; it only listens."""

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from contract.arena import Arena
from contract.exposure import exposure
from contract.messages import LogEntry, Message, MocapHealth, RobotReport, RunStatus
from groundstation.current import arena_of
from groundstation.link import Link, LinkError
from groundstation.mocap_words import bodies, figures
from groundstation.scenes import clock

if TYPE_CHECKING:
    from rich.console import RenderableType

SILENT_S = 1.0
SYMBOLS = {"running": "▶", "armed": "●", "holding": "‖", "disarmed": "○", "stopped": "■", "fault": "▲"}


class Row(NamedTuple):
    """One robot as people need it: what it does, and if it is not well, why and what to do."""

    robot: str
    state: str
    task: str
    age: str
    rate: str
    misses: str
    links: str
    reason: str
    well: bool


class Watch:
    """What has been heard so far, and the table it makes. Pure: times come from outside."""

    def __init__(self, arena: Arena) -> None:
        self.arena = arena
        self.status: RunStatus | None = None
        self.mocap: MocapHealth | None = None
        self.recorder: LogEntry | None = None
        self._reports: dict[str, tuple[RobotReport, float]] = {}
        self._status_s = 0.0

    def receive(self, message: Message, now_s: float) -> None:
        match message:
            case RobotReport():
                self._reports[message.robot] = (message, now_s)
            case RunStatus():
                self.status, self._status_s = message, now_s
            case MocapHealth():
                self.mocap = message
            case LogEntry() if message.source == "recorder":
                self.recorder = message
            case _:
                pass

    def rows(self, now_s: float) -> list[Row]:
        """One a robot, in the order of the arena file."""
        return [self._row(name, now_s) for name in self.arena.robots]

    def _row(self, name: str, now_s: float) -> Row:
        entry = self._reports.get(name)
        if entry is None:
            return Row(name, "SILENT", "", "", "", "", "", "never reported; start its agent, check its network", False)
        report, heard_s = entry
        if now_s - heard_s > SILENT_S:
            text = f"silent for {now_s - heard_s:.1f} s; it stops by itself, go and see"
            return Row(name, "SILENT", "", "", "", "", "", text, False)
        reason = report.reason + (f"; {report.remedy}" if report.reason and report.remedy else "")
        if not reason and report.motor_faults:
            reason = f"motor: {', '.join(report.motor_faults)}"
        well = (
            report.run in ("running", "armed", "holding", "disarmed") and report.pose_valid and not report.motor_faults
        )
        timing = report.timing
        claim = f" {report.claim + 1}" if report.claim >= 0 else ""
        age = f"{report.pose_age_ms:.0f} ms" if report.pose_age_ms < 1e6 else "never"
        return Row(
            name,
            f"{SYMBOLS.get(report.run, '?')} {report.run}",
            f"{report.task}{claim}",
            age if report.pose_valid else f"{age} invalid",
            f"{timing.rate_hz:.1f}/{timing.nominal_hz:.0f} Hz" if timing else "",
            str(timing.misses) if timing else "",
            f"{len(report.links_on)}+{len(report.links_kept)}",
            reason,
            well,
        )

    def headline(self, now_s: float) -> str:
        """Phase, progress, network and time in one line; first of all, that the link is open to anybody."""
        words = exposure((self.arena.link.router,), self.arena.link.keys)
        return f"{words}  {self._headline(now_s)}" if words else self._headline(now_s)

    def _headline(self, now_s: float) -> str:
        status = self.status
        if status is None or now_s - self._status_s > SILENT_S:
            return "no station session; robots stop without its heartbeat"
        pieces = "one piece" if status.components == 1 else f"{status.components} PIECES"
        return (
            f"{status.phase.upper()}  {len(status.occupied)}/{status.targets} targets  {clock(status.elapsed_s, 1)}  "
            f"network in {pieces}, λ₂ {status.lambda2:.2f}  nearest {status.min_distance_m:.2f} m"
            + (f"  {status.detail}" if status.detail else "")
        )

    def footer(self) -> str:
        """Motion capture and recorder."""
        mocap, recorder = self.mocap, self.recorder
        poses = "mocap: nothing heard"
        if mocap is not None:
            poses = f"mocap {mocap.state}, {figures(mocap)}"
            poses += f": {mocap.detail}" if mocap.detail else ""
            hidden = bodies(mocap)
            poses += f"; {hidden}" if hidden else ""
        return f"{poses}   recorder: {recorder.text if recorder else 'nothing heard'}"


def render(watch: Watch, now_s: float) -> "RenderableType":
    """The live table."""
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="dim", expand=True)
    for head in ("robot", "state", "task", "pose age", "rate", "missed", "links"):
        table.add_column(head, no_wrap=True)
    table.add_column("why, and what to do", ratio=1)
    for row in watch.rows(now_s):
        table.add_row(*row[:-1], style="" if row.well else "bold red")
    status = watch.status
    bar = ProgressBar(total=max(1, status.targets), completed=len(status.occupied)) if status else ProgressBar(total=1)
    return Group(Text(watch.headline(now_s), style="bold"), bar, table, Text(watch.footer(), style="dim"))


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    parser.add_argument("--once", action="store_true", help="listen for a second, print plain lines, end")


def run(args: argparse.Namespace) -> int:
    arena = arena_of(args.arena)
    watch = Watch(arena)
    try:
        with Link(arena, "watch", timeout_s=2.0) as link:
            keys = link.keys
            link.subscribe([keys.status, keys.mocap_health, keys.log("recorder"), *map(keys.report, arena.robots)])
            if args.once:
                return _once(watch, link)
            _live(watch, link)
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    return 0


def _listen(watch: Watch, link: Link, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while (left := deadline - time.monotonic()) > 0:
        link.wait(left)
        for _, message in link.drain():
            watch.receive(message, time.monotonic())


def _once(watch: Watch, link: Link) -> int:
    _listen(watch, link, 1.2)
    now_s = time.monotonic()
    rows = watch.rows(now_s)
    print(watch.headline(now_s))
    for row in rows:
        print("  ".join(text for text in row[:-1] if text))
    print(watch.footer())
    return 0 if all(row.well for row in rows) else 1


def _live(watch: Watch, link: Link) -> None:
    from rich.live import Live

    with Live(render(watch, time.monotonic()), auto_refresh=False, screen=sys.stdout.isatty()) as live:
        while True:
            _listen(watch, link, 0.25)
            live.update(render(watch, time.monotonic()), refresh=True)
