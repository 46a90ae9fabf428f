"""``demo``: the paper's experiment in the mock arena, in real time, judged from what was recorded."""

import argparse
import math
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NoReturn

from contract.arena import Arena, ArenaError
from contract.messages import TargetCloud
from groundstation import current, rig, runfolder
from groundstation.conduct import Conductor, new_session
from groundstation.course import ENDED, Plan
from groundstation.link import Link, LinkError
from groundstation.metrics import failures
from groundstation.processes import ChildError
from groundstation.recording import RecordingError
from groundstation.report import write_report
from groundstation.targets import CloudError, cloud_of
from groundstation.watch import Watch, render

DEFAULT_ARENA = "experiment2"
READY_S = 20.0
SETTLE_S = 3.0
PROGRESS_S = 2.0
REFRESH_S = 0.25


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--headless", action="store_true", help="plain lines in place of the live table")
    parser.add_argument(
        "--arena", default=DEFAULT_ARENA, metavar="FILE|NAME", help="arena file or example's name (%(default)s)"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of the target cloud")
    parser.add_argument("--robots", type=int, metavar="N", help="number of robots")
    parser.add_argument("--targets", type=int, metavar="M", help="number of targets")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where the recording goes (a new folder under runs/)")
    parser.add_argument("--timeout", type=float, default=75.0, metavar="S", help="of the mission (%(default)s)")


def run(args: argparse.Namespace) -> int:
    out = args.out or Path("runs") / datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    try:
        arena = rig.mock_arena(rig.find_arena(args.arena), out, rig.Changes(args.robots, args.targets, args.seed))
        cloud = cloud_of(arena, f"{arena.arena.name}-{arena.targets.seed}")
        out.mkdir(parents=True, exist_ok=True)
    except (ArenaError, CloudError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        return _mission(arena, cloud, out, args)
    except KeyboardInterrupt:
        print("\ninterrupted: all processes ended, wheels at zero; recording in", out, file=sys.stderr)
        return 130
    except (ChildError, LinkError) as error:
        print(error, file=sys.stderr)
        return 1
    finally:
        signal.signal(signal.SIGTERM, before)


def _interrupt(*_: object) -> NoReturn:
    raise KeyboardInterrupt


def _mission(arena: Arena, cloud: TargetCloud, out: Path, args: argparse.Namespace) -> int:
    with rig.Rig(arena, out) as processes:
        began = time.monotonic()
        current.remember(processes.config)
        processes.start()
        print(f"{len(arena.robots)} robots ready in {time.monotonic() - began:.1f} s; recording to {out}", flush=True)
        with Link(arena, "station") as link:
            plan = Plan(automatic=True, timeout_s=args.timeout, ready_timeout_s=READY_S)
            session = new_session(arena, cloud, plan, link)
            conductor = Conductor(arena, session, cloud, link)
            show = _lines if args.headless or not sys.stdout.isatty() else _table
            with show(arena, conductor, link) as refresh:

                def over() -> bool:
                    processes.family.check()
                    refresh()
                    return session.phase in ENDED

                conductor.until(over, math.inf)
                conductor.until(lambda: session.at_rest, SETTLE_S)
    print(f"{session.phase}: {session.detail}")
    return _judge(out)


@contextmanager
def _table(arena: Arena, conductor: Conductor, link: Link) -> Iterator[Callable[[], None]]:
    """The live table of ``watch``."""
    from rich.live import Live

    watch = Watch(arena)
    conductor.listener = watch.receive
    link.subscribe([link.keys.mocap_health, link.keys.log("recorder")])
    due_s = 0.0
    with Live(render(watch, time.monotonic()), auto_refresh=False) as live:

        def refresh() -> None:
            nonlocal due_s
            if (now := time.monotonic()) >= due_s:
                due_s = now + REFRESH_S
                live.update(render(watch, now), refresh=True)

        yield refresh


@contextmanager
def _lines(arena: Arena, conductor: Conductor, link: Link) -> Iterator[Callable[[], None]]:
    """A line when something happens, and every two seconds."""
    session = conductor.session
    last_words, last_s = "", 0.0

    def refresh() -> None:
        nonlocal last_words, last_s
        now = time.monotonic()
        words = f"{session.phase} {len(session.occupied)}"
        if words == last_words and now - last_s < PROGRESS_S:
            return
        last_words, last_s = words, now
        status = session.status(time.monotonic_ns())
        print(
            f"{status.elapsed_s:6.1f} s  {status.phase:<9} {len(status.occupied):>3}/{status.targets} targets  "
            f"lambda2 {status.lambda2:.3f}  nearest {status.min_distance_m:.2f} m  {status.detail}",
            flush=True,
        )

    yield refresh


def _judge(out: Path) -> int:
    """Exit code from the recording alone; writes metrics, pictures and manifest beside it."""
    try:
        found = runfolder.read(out)
    except RecordingError as error:
        print(f"FAILED: {error}", file=sys.stderr)
        return 1
    reasons = failures(found.metrics)
    if (metrics := found.metrics) is not None:
        ratio = f", {metrics.ratio_to_lower_bound:.2f} x the lower bound" if metrics.ratio_to_lower_bound else ""
        print(
            f"{metrics.occupied}/{metrics.targets} targets in {metrics.mission_s:.1f} s{ratio}; "
            f"min lambda2 {metrics.min_lambda2:.3f}; nearest {metrics.min_distance_m} m; "
            f"pose to wheel {metrics.pose_to_wheel_ms.p50} ms (p99 {metrics.pose_to_wheel_ms.p99})"
        )
        rates = ", ".join(
            f"{name} {loop.rate_hz:.1f} Hz ({loop.deadline_misses} missed)" for name, loop in metrics.loop.items()
        )
        print(f"loops: {rates}")
        print(f"report: {write_report(found)}")
    for reason in reasons:
        print(f"FAILED: {reason}", file=sys.stderr)
    return 1 if reasons else 0
