"""Sweeps of missions in virtual time: ``ahdc-groundstation simulate``."""

import argparse
import math
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import msgspec

from contract import profiles
from groundstation import estimates
from groundstation.activity import ACTIVITIES
from groundstation.conditions import PRESETS, Conditions, Interval
from groundstation.estimates import Estimate
from groundstation.files import RECORDING, write_whole
from groundstation.progress import Progress
from groundstation.result import Result
from groundstation.sweep import Calibrated, Job, local

MAX_LIMIT_S = 86_400.0
SHOWN_SEEDS = 20
MM, MRAD, MS = 1e-3, 1e-3, 1e-3


class Setting(argparse.Action):
    """A number, an interval A:B or a share within bounds, times a unit; kept under the option's name."""

    def __init__(
        self, *args: Any, low: float = 0.0, high: float = 1.0, unit: float = 1.0, pair: bool = False, **kwargs: Any
    ) -> None:
        super().__init__(*args, **kwargs)
        self._low, self._high, self._unit, self._pair = low, high, unit, pair

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, text: Any, _: Any = None
    ) -> None:
        words = str(text).split(":")
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = [math.nan]
        sound = all(self._low <= value <= self._high for value in values) and values == sorted(values)
        if not sound or len(values) > (2 if self._pair else 1):
            shape = "A:B, or one number," if self._pair else "a number"
            parser.error(f"{self.option_strings[0]} {text}: needs {shape} from {self._low:g} to {self._high:g}")
        scaled = [value * self._unit for value in values]
        setattr(namespace, self.dest, (scaled[0], scaled[-1]) if self._pair else scaled[0])


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Fly missions in virtual time with the very control law of the robots. "
        "Example: ahdc-groundstation simulate --robots 6 --targets 19 --runs 100 --seed 1 --workers 2"
    )
    add = parser.add_argument
    add("--robots", type=int, default=6, metavar="N", help="robots (default 6)")
    add("--targets", type=int, default=19, metavar="M", help="targets (default 19)")
    add("--runs", type=int, default=10, metavar="R", help="missions, seeds S, S+1, ... (default 10)")
    add("--seed", type=int, default=1, metavar="S", help="first seed (default 1)")
    add("--profile", choices=profiles.known(), default="field", help="control profile (default field)")
    add("--workers", type=int, default=1, metavar="K", help="processes (default 1)")
    add("--cluster", metavar="ADDRESS", help="play on the Dask cluster of that scheduler, e.g. tcp://10.0.0.5:8786")
    add("--limit-s", type=float, default=180.0, help="give a mission up after this virtual time (default 180)")
    add("--wire", action="store_true", help="every hop real bytes: NatNet, JSON, CAN or serial (half as fast)")
    add("--json", type=Path, metavar="FILE", help="write settings, summary and every run as JSON")
    add("--save", type=Path, metavar="DIR", help="keep each run as a folder DIR/seed-S that `report` draws")
    world = parser.add_argument_group("conditions", "A:B is an interval; each option replaces that part of the preset")
    add = world.add_argument
    add("--conditions", choices=tuple(PRESETS), default="ideal", help="what the world does (default ideal)")
    interval: dict[str, Any] = {"action": Setting, "pair": True, "metavar": "A:B"}
    number: dict[str, Any] = {"action": Setting, "metavar": "X"}
    ages: dict[str, Any] = {"high": 900.0, "unit": MS}
    add("--pose-age-ms", **interval, **ages, help="age of a frame on arrival, a robot's own pose included")
    add("--message-age-ms", **interval, **ages, help="age of a neighbour's message on arrival")
    add("--pose-noise-mm", **number, high=100.0, unit=MM, help="standard deviation of positions, each axis")
    add("--heading-noise-mrad", **number, high=1000.0, unit=MRAD, help="standard deviation of headings")
    add("--loss", **number, help="share of neighbours' messages lost, 0 to 1")
    add("--frame-loss", **number, help="share of frames lost, 0 to 1")
    add("--motor-lag-ms", **interval, high=1000.0, unit=MS, help="lag from command to rim speed, drawn per robot")
    add("--accel", **interval, low=0.1, high=1e6, help="rim acceleration and deceleration, m/s^2, drawn per robot")
    add("--told-lag-ms", **interval, high=1000.0, unit=MS, help="lag the robots believe in (default: the motors')")
    add("--told-accel", **interval, low=0.1, high=1e6, help="deceleration the robots believe in (default: the motors')")


def conditions_of(args: argparse.Namespace) -> Conditions:
    """The preset with whatever was set in its place."""
    given: dict[str, Interval | float | None] = {
        "pose_age_s": args.pose_age_ms,
        "message_age_s": args.message_age_ms,
        "position_noise_m": args.pose_noise_mm,
        "heading_noise_rad": args.heading_noise_mrad,
        "loss": args.loss,
        "frame_loss": args.frame_loss,
        "lag_s": args.motor_lag_ms,
        "deceleration_mps2": args.accel,
    }
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return PRESETS[args.conditions]._replace(**changes)


def jobs_of(args: argparse.Namespace) -> list[Job]:
    """Every run asked for."""
    world = conditions_of(args)
    told = None
    if args.told_lag_ms or args.told_accel:
        told = Calibrated(args.told_accel or world.deceleration_mps2, args.told_lag_ms or world.lag_s)
    return [
        Job(
            args.robots,
            args.targets,
            seed,
            args.profile,
            args.conditions,
            args.limit_s,
            args.wire,
            world,
            told,
            str(args.save / f"seed-{seed}") if args.save else "",
        )
        for seed in range(args.seed, args.seed + args.runs)
    ]


def trouble(args: argparse.Namespace) -> str:
    """What is wrong with the arguments; empty for nothing."""
    for name in ("robots", "targets", "runs", "workers"):
        if getattr(args, name) < 1:
            return f"--{name} {getattr(args, name)}: at least 1 needed"
    if not 0.0 < args.limit_s <= MAX_LIMIT_S:
        return f"--limit-s {args.limit_s:g}: above 0, at most {MAX_LIMIT_S:g} s"
    if args.cluster and (args.save or args.workers > 1):
        other = "--save" if args.save else "--workers"
        return f"{other}: not together with --cluster, whose workers have folders and processes of their own"
    if args.save:
        for seed in range(args.seed, args.seed + args.runs):
            if (path := args.save / f"seed-{seed}" / RECORDING).exists():
                return f"--save {args.save}: {path} exists; give another folder"
    return ""


def run(args: argparse.Namespace) -> int:
    """Exit code 0: every mission complete, whole and clear; 1: not so; 2: bad arguments; 130: interrupted."""
    if wrong := trouble(args):
        print(f"simulate: {wrong}", file=sys.stderr)
        return 2
    jobs = jobs_of(args)
    results: list[Result] = []
    before = signal.signal(signal.SIGTERM, _interrupt)
    interrupted = False
    try:
        progress = Progress(len(jobs), sys.stderr, time.monotonic())
        for result in _played(args, jobs):
            if result is not None:
                results.append(result)
                progress.count(result)
            progress.show(time.monotonic())
    except KeyboardInterrupt:
        interrupted = True
    except ConnectionError as error:
        print(f"simulate: {error}", file=sys.stderr)
        return 2
    finally:
        signal.signal(signal.SIGTERM, before)
    progress.show(time.monotonic(), last=True)
    unfinished = [job.seed for job in jobs[len(results) :]]
    if args.json:
        write_whole(args.json, report_of(jobs[0], results, unfinished))
    print("\n".join(lines(summary(results), results)))
    if interrupted:
        print(f"interrupted; seeds from {unfinished[0]} on are missing" if unfinished else "interrupted")
        return 130
    good = all(r.completed and not r.disconnected_steps and not r.collisions for r in results)
    return 0 if good else 1


def _interrupt(*_: object) -> NoReturn:
    raise KeyboardInterrupt


def _played(args: argparse.Namespace, jobs: list[Job]) -> Iterator[Result | None]:
    if not args.cluster:
        return local(jobs, args.workers)
    from groundstation.cluster import spread

    return spread(jobs, args.cluster)


def report_of(job: Job, results: list[Result], unfinished: list[int]) -> bytes:
    """The sweep as JSON: settings, summary, every run, and the seeds an interrupt left out."""
    settings = {**job._asdict(), "conditions": job.faced._asdict(), "preset": job.conditions}
    settings["told"] = job.told._asdict() if job.told else None
    for name in ("world", "save", "seed"):
        del settings[name]
    table = {"settings": settings, "summary": summary(results), "runs": results, "unfinished": unfinished}
    return msgspec.json.format(msgspec.json.encode(table)) + b"\n"


def summary(results: list[Result]) -> dict[str, Any]:
    """Shares, means and medians with their 95 % intervals, seeds of what went wrong, where the time went."""
    done = [r for r in results if r.completed]
    ratios = [r.ratio_to_lower_bound for r in done if r.ratio_to_lower_bound is not None]
    times = [r.mission_s for r in done]
    robot_s = sum(sum(r.time_s.values()) for r in results)
    words = list(dict.fromkeys([*ACTIVITIES, *(word for r in results for word in r.time_s)]))
    spent = {word: sum(r.time_s.get(word, 0.0) for r in results) for word in words}
    return {
        "runs": len(results),
        "completed": estimates.share(len(done), len(results)),
        "mission_s": {"mean": estimates.mean(times), "median": estimates.median(times)},
        "ratio_to_lower_bound": {"mean": estimates.mean(ratios), "median": estimates.median(ratios)},
        "split": estimates.share(sum(r.disconnected_steps > 0 for r in results), len(results)),
        "collided": estimates.share(sum(r.collisions > 0 for r in results), len(results)),
        "min_distance_m": min((r.min_distance_m for r in results if r.ending != "error"), default=None),
        "failed_seeds": [r.seed for r in results if not r.completed],
        "split_seeds": [r.seed for r in results if r.disconnected_steps],
        "collided_seeds": [r.seed for r in results if r.collisions],
        "time_share": {word: round(value / robot_s, 4) for word, value in spent.items() if robot_s and value},
    }


def lines(found: dict[str, Any], results: list[Result]) -> list[str]:
    """The summary for people."""

    def seeds(name: str) -> str:
        known = found[name]
        more = ", ..." if len(known) > SHOWN_SEEDS else ""
        return f", seeds {known[:SHOWN_SEEDS]}{more}" if known else ""

    def percent(share: Estimate) -> str:
        if share.value is None or share.low is None or share.high is None:
            return "-"
        return f"{100 * share.value:.4g} % ({100 * share.low:.3g} to {100 * share.high:.3g})"

    mission, ratio = found["mission_s"], found["ratio_to_lower_bound"]
    text = [
        f"completed {found['completed'].of - len(found['failed_seeds'])} of {found['runs']}, "
        f"{percent(found['completed'])}" + seeds("failed_seeds").replace("seeds", "failed seeds"),
        f"mission, s: mean {mission['mean']}, median {mission['median']}",
        f"ratio to the lower bound: mean {ratio['mean']}, median {ratio['median']}",
        f"split {percent(found['split'])}{seeds('split_seeds')}; collided {percent(found['collided'])}"
        f"{seeds('collided_seeds')}; least distance {found['min_distance_m']} m",
        "where the time went: "
        + ", ".join(f"{word} {100 * share:.1f} %" for word, share in found["time_share"].items()),
        f"in brackets 95 %: shares by {estimates.SHARE}, means by {estimates.MEAN}, medians by {estimates.MEDIAN}",
    ]
    return text + [f"seed {r.seed}: {r.ending}: {r.why}" for r in results if r.ending in ("error", "no scenario")][:5]
