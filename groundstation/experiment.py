"""``experiment``: run every trial of an experiment file, keep each in a folder, and say what they tell together.

OUT/experiment.toml   the file          OUT/trials.csv     every trial, one a line
OUT/summary.json      the estimates     OUT/TRIAL/         a run folder each, with ``trial.json``

An interrupted experiment goes on where it was with the same command: a trial with a ``trial.json`` is done. What
was under way is kept as ``TRIAL.aborted-1``, counted, and run again.
"""

import argparse
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

import msgspec

from contract.arena import ArenaError
from contract.tables import Fault
from groundstation import outcomes, runfolder
from groundstation.files import write_whole
from groundstation.outcomes import Ending, Outcome
from groundstation.trials import Experiment, Trial, parse, trials

FILE = "experiment.toml"
DONE = "trial.json"
ABORTED = ".aborted-"


class Stage(Protocol):
    """Where trials are run."""

    def play(self, trial: Trial, folder: Path) -> Outcome:
        """Run one trial in a folder that exists.

        :raises KeyboardInterrupt: the operator has enough; the trial counts as aborted.
        """

    def close(self) -> None: ...


def outcome(trial: Trial, ending: Ending, why: str = "", robots: int | None = None, profile: str = "") -> Outcome:
    """An outcome without figures."""
    return Outcome(
        trial=trial.name,
        robots=trial.robots if robots is None else robots,
        targets=trial.targets,
        profile=trial.profile or profile,
        seed=trial.seed,
        repetition=trial.repetition,
        ending=ending,
        why=why,
    )


def judged(trial: Trial, folder: Path, why: str = "") -> Outcome:
    """The outcome of a recorded trial, from the recording alone; metrics and manifest are written beside it."""
    run = runfolder.read(folder)
    metrics = run.metrics
    if metrics is None:
        return outcome(trial, "error", why or "no mission was started", len(run.history.robots))
    runfolder.write_metrics(run)
    runfolder.write_manifest(run)
    ending: Ending = "completed" if metrics.completed else "stopped" if metrics.ending == "stopped" else "failed"
    if not metrics.completed and "targets left after" in f"{metrics.detail}{why}":
        ending = "timeout"
    blank = outcome(trial, ending, why or metrics.detail, len(metrics.robots), metrics.profile)
    return msgspec.structs.replace(
        blank,
        occupied=metrics.occupied,
        mission_s=metrics.mission_s,
        ratio_to_lower_bound=metrics.ratio_to_lower_bound,
        min_distance_m=metrics.min_distance_m,
        collisions=metrics.collisions,
        splits=metrics.disconnected_frames,
    )


class Book:
    """An experiment's folder."""

    def __init__(self, out: Path, text: str) -> None:
        self.out = out
        out.mkdir(parents=True, exist_ok=True)
        kept = out / FILE
        if kept.exists() and kept.read_text(encoding="utf-8") != text:
            hint = "choose another --out, or run its own file again"
            raise ArenaError(str(out), [Fault("--out", str(out), "holds another experiment", hint)])
        write_whole(kept, text.encode())

    def done(self, trial: Trial) -> Outcome | None:
        """The outcome of a trial that has been run to its end."""
        return _read(self.out / trial.name)

    def begin(self, trial: Trial) -> Path:
        """An empty folder for a trial; one that was begun and not ended is set aside first."""
        folder = self.out / trial.name
        if folder.exists():
            self._set_aside(trial, folder, "the experiment ended in it")
        folder.mkdir()
        return folder

    def keep(self, folder: Path, found: Outcome) -> None:
        write_whole(folder / DONE, outcomes.encode(msgspec.structs.replace(found, folder=folder.name)))

    def abort(self, trial: Trial, why: str) -> None:
        self._set_aside(trial, self.out / trial.name, why)

    def _set_aside(self, trial: Trial, folder: Path, why: str) -> None:
        number = 1
        while (aside := folder.with_name(f"{folder.name}{ABORTED}{number}")).exists():
            number += 1
        folder.rename(aside)
        self.keep(aside, outcome(trial, "aborted", why))

    def all(self, planned: list[Trial]) -> Iterator[Outcome]:
        """Every outcome there is: the trials' in order, each behind its aborted attempts."""
        for trial in planned:
            folder = self.out / trial.name
            for path in (*sorted(self.out.glob(f"{folder.name}{ABORTED}*")), folder):
                found = _read(path)
                if found is not None:
                    yield found

    def summarise(self, planned: list[Trial]) -> list[Outcome]:
        """Write ``trials.csv`` and ``summary.json``."""
        found = list(self.all(planned))
        known = next((entry for entry in found if entry.ending not in ("aborted", "error")), None)
        if known is not None:
            found = [_filled(entry, known) for entry in found]
        write_whole(self.out / "trials.csv", outcomes.csv_of(found))
        summary = {"trials": len(planned), "groups": outcomes.groups(found)}
        write_whole(self.out / "summary.json", msgspec.json.format(msgspec.json.encode(summary)) + b"\n")
        return found


def _filled(entry: Outcome, known: Outcome) -> Outcome:
    """An outcome without figures, with the arena file's robots and profile, which others have found out."""
    return msgspec.structs.replace(entry, robots=entry.robots or known.robots, profile=entry.profile or known.profile)


def _read(folder: Path) -> Outcome | None:
    try:
        return msgspec.json.decode((folder / DONE).read_bytes(), type=Outcome)
    except (OSError, msgspec.DecodeError):
        return None


def conduct(book: Book, planned: list[Trial], stage: Stage) -> list[Outcome]:
    """Run what has not been run yet.

    :raises KeyboardInterrupt: after the trial under way has been set aside.
    """
    for number, trial in enumerate(planned, 1):
        if book.done(trial) is not None:
            continue
        folder = book.begin(trial)
        print(f"{number}/{len(planned)} {trial.name}", flush=True)
        try:
            found = stage.play(trial, folder)
        except KeyboardInterrupt:
            book.abort(trial, "interrupted")
            raise
        book.keep(folder, found)
        time_text = "" if found.mission_s is None else f", {found.mission_s:.1f} s"
        print(f"    {found.ending}{time_text}{f': {found.why}' if found.why else ''}", flush=True)
    return book.summarise(planned)


def stage_of(experiment: Experiment, source: Path) -> Stage:
    """The backend an experiment asks for."""
    if experiment.backend == "lockstep":
        from groundstation.stage_lockstep import LockstepStage

        return LockstepStage(experiment)
    if experiment.backend == "mock":
        from groundstation.stage_mock import MockStage

        return MockStage(experiment, source)
    from groundstation.stage_robots import RobotStage

    return RobotStage(experiment, source)


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Run every trial of an experiment file and aggregate them with 95 % intervals. Ctrl-C leaves it resumable: "
        "the same command with the same --out goes on. Example file:\n\n"
        '  name = "sizes"\n  backend = "lockstep"     # or "mock", "robots" with arena = "lab.toml"\n'
        "  robots = [5, 6]\n  targets = [19, 50]\n"
        '  profiles = ["field", "paper"]\n  seeds = [1, 2, 3]\n  repetitions = 2'
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="experiment file (TOML)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="its folder (a new one under runs/)")
    parser.add_argument("--list", action="store_true", help="name the trials and run nothing")


def run(args: argparse.Namespace) -> int:
    """Exit code 0: every trial run and good; 1: one was not, or interrupted (130); 2: bad input."""
    try:
        text = args.file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        print(f"{args.file}: {error}", file=sys.stderr)
        return 2
    experiment = parse(text, str(args.file))
    planned = trials(experiment)
    if args.list:
        print("\n".join(trial.name for trial in planned))
        return 0
    out = args.out or Path("runs") / f"{experiment.name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    book = Book(out, text)
    stage = stage_of(experiment, args.file)
    try:
        found = conduct(book, planned, stage)
    except KeyboardInterrupt:
        book.summarise(planned)
        print(f"\ninterrupted; go on with: experiment {args.file} --out {out}", file=sys.stderr)
        return 130
    finally:
        stage.close()
    rows = outcomes.table(outcomes.groups(found))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
    print(f"{out}: trials.csv, summary.json; figures of a trial: ahdc-groundstation report {out}/TRIAL")
    return 0 if all(entry.good for entry in found if entry.ending != "aborted") else 1
