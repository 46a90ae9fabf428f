"""``radio``: the same mission over a worse and worse radio, side by side. As root: everybody in its own namespace."""

import argparse
import itertools
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from contract.arena import ArenaError
from contract.messages import RobotReport
from contract.tables import Fault
from groundstation import rig, runfolder
from groundstation.files import RECORDING
from groundstation.fleet_operator import FleetError, Operator
from groundstation.fleet_rig import FleetRig, Protocol, fleet_arena
from groundstation.netns import NamespaceError
from groundstation.processes import ChildError
from groundstation.recording import Recording
from groundstation.weather import Weather

LOSSES, JITTERS_MS = (0.0, 0.05, 0.1, 0.2), (0.0, 50.0)
PROTOCOLS: tuple[Protocol, ...] = ("quic", "tls")
SETTLE_S = 3.0
"""The recorder commits once a second."""
LEAVE_S = 1.0
"""From the bad radio's beginning, the robots armed, until the start."""
LONGEST_S = 120.0
EXAMPLES = """\
  radio --out radio                        losses 0, 5, 10, 20 %, jitter 0, 50 ms, over quic and tls (TCP): 20 minutes
  radio --out radio --loss 0.1 --protocol quic --robots 3 --targets 6
  radio --out radio --loss 0 --jitter 20 --overtaking

Every mission begins with the robots at their starts. The table goes to DIR/radio.md, the figures to DIR/radio.json,
every mission's recording beside them.
"""


class Row(NamedTuple):
    """One mission."""

    protocol: str
    loss: float
    jitter_ms: float
    overtaking: bool
    completed: bool
    mission_s: float
    """Until it was completed or given up."""
    released: int
    """How often an operator had to release and start anew."""
    pose_age_p50_ms: float | None
    pose_age_p99_ms: float | None
    rate_hz: float
    """Least control rate of a robot."""
    trips: int
    """Times a running robot held, stopped or failed."""
    disconnected_frames: int
    collisions: int


def trips(reports: Iterable[RobotReport]) -> int:
    """How often robots that ran were held, stopped or at fault in their next report."""
    last: dict[str, str] = {}
    count = 0
    for report in reports:
        count += last.get(report.robot) == "running" and report.run in ("holding", "stopped", "fault")
        last[report.robot] = report.run
    return count


def row_of(folder: Path, protocol: str, weather: Weather, released: int) -> Row:
    """What a mission came to, from its recording."""
    metrics = runfolder.read(folder).metrics
    if metrics is None:
        raise FleetError(f"{folder}: no mission in the recording")
    messages = (entry.message for entry in Recording(folder / RECORDING).messages())
    return Row(
        protocol=protocol,
        loss=weather.loss,
        jitter_ms=weather.jitter_ms,
        overtaking=weather.overtaking,
        completed=metrics.completed,
        mission_s=metrics.mission_s,
        released=released,
        pose_age_p50_ms=metrics.pose_age_ms.p50,
        pose_age_p99_ms=metrics.pose_age_ms.p99,
        rate_hz=min((loop.rate_hz for loop in metrics.loop.values() if loop.rate_hz), default=0.0),
        trips=trips(message for message in messages if isinstance(message, RobotReport)),
        disconnected_frames=metrics.disconnected_frames,
        collisions=metrics.collisions,
    )


def markdown(rows: Sequence[Row]) -> str:
    """The table of docs/network.md: a line a weather, the protocols side by side."""
    protocols = list(dict.fromkeys(row.protocol for row in rows))
    found = {(row.loss, row.jitter_ms, row.protocol): row for row in rows}
    kinds = ("mission, s", "pose age, ms", "trips", "released", "splits")
    head = ["loss, %", "jitter, ms", *(f"{kind}, {protocol}" for kind in kinds for protocol in protocols)]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for loss, jitter_ms in dict.fromkeys((row.loss, row.jitter_ms) for row in rows):
        cells = [_cells(found.get((loss, jitter_ms, protocol))) for protocol in protocols]
        words = [cell for kind in zip(*cells, strict=True) for cell in kind]
        lines.append(f"| {100 * loss:g} | {jitter_ms:g} | {' | '.join(words)} |")
    return "\n".join(lines)


def _cells(row: Row | None) -> tuple[str, ...]:
    """Mission time, median and 99th percentile of the pose age, trips, releases, frames in which the network split."""
    if row is None:
        return ("-",) * 5
    age = "none" if row.pose_age_p50_ms is None else f"{row.pose_age_p50_ms:.0f} / {row.pose_age_p99_ms or 0:.0f}"
    time_s = f"{row.mission_s:.1f}" if row.completed else f"not in {row.mission_s:.0f}"
    return time_s, age, str(row.trips), str(row.released), str(row.disconnected_frames)


def configure(parser: argparse.ArgumentParser) -> None:
    parser.epilog = EXAMPLES
    parser.add_argument("--arena", default="experiment2", metavar="FILE|NAME", help="arena file or example's name")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    parser.add_argument("--loss", type=float, nargs="+", default=LOSSES, metavar="P", help="probabilities, each way")
    parser.add_argument("--jitter", type=float, nargs="+", default=JITTERS_MS, metavar="MS", help="of every frame")
    parser.add_argument("--protocol", nargs="+", choices=("quic", "tls", "tcp"), default=PROTOCOLS, help="one or more")
    parser.add_argument("--overtaking", action="store_true", help="late frames are overtaken: no radio cell does that")
    parser.add_argument("--longest", type=float, default=LONGEST_S, metavar="S", help="of a mission (%(default)g s)")
    parser.add_argument("--robots", type=int, metavar="N")
    parser.add_argument("--targets", type=int, metavar="M")
    parser.add_argument("--seed", type=int, metavar="N")


def run(args: argparse.Namespace) -> int:
    """Exit code 1: a network split, or missions are missing; that a mission takes too long is a result like others."""
    if bad := [p for p in args.loss if not 0.0 <= p < 1.0] + [j for j in args.jitter if not 0.0 <= j <= 1000.0]:
        raise ArenaError("radio", [Fault("loss or jitter", str(bad), "losses from 0 to below 1, jitter 0 to 1000 ms")])
    rows: list[Row] = []
    try:
        args.out.mkdir(parents=True)
        for protocol in args.protocol:
            _missions(args, protocol, rows)
    except OSError as error:
        print(f"{args.out}: {error.strerror}; name a new folder", file=sys.stderr)
        return 2
    except (ChildError, FleetError, NamespaceError) as error:
        print(error, file=sys.stderr)
    (args.out / "radio.md").write_text(markdown(rows) + "\n", encoding="utf-8")
    (args.out / "radio.json").write_bytes(msgspec.json.format(msgspec.json.encode([row._asdict() for row in rows])))
    print(markdown(rows))
    whole = len(rows) == len(args.protocol) * len(args.loss) * len(args.jitter)
    return 0 if whole and not any(row.disconnected_frames or row.collisions for row in rows) else 1


def _missions(args: argparse.Namespace, protocol: Protocol, rows: list[Row]) -> None:
    """All weathers over one protocol, on one fleet."""
    out: Any = args.out / protocol
    changes = rig.Changes(args.robots, args.targets, args.seed)
    arena = fleet_arena(rig.find_arena(args.arena), out, protocol, changes)
    with FleetRig(arena, out) as site:
        site.start_network()
        site.start()
        operator = Operator(site)
        for number, (loss, jitter_ms) in enumerate(itertools.product(args.loss, args.jitter), 1):
            weather = Weather(loss=loss, jitter_ms=jitter_ms, overtaking=args.overtaking)
            if number > 1:
                operator.home()
            released = _mission(operator, weather, first=number == 1, longest_s=args.longest)
            time.sleep(SETTLE_S)
            rows.append(
                row_of(out if number == 1 else out.with_name(f"{out.name}-{number}"), protocol, weather, released)
            )
            print(markdown(rows[-1:]).rpartition("\n")[2], file=sys.stderr, flush=True)


def _mission(operator: Operator, weather: Weather, first: bool, longest_s: float) -> int:
    """One mission, begun under good weather; how often it was released and started anew, -1: it was given up."""

    def worsen() -> None:
        operator.site.weather(weather)
        time.sleep(LEAVE_S)

    try:
        operator.begin(worsen) if first else operator.again(worsen)
        return operator.finish(longest_s)
    except FleetError as error:
        print(error, file=sys.stderr)
        operator.site.order("release")
        return -1
    finally:
        operator.site.weather(Weather())
