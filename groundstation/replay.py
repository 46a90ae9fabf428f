"""``replay --check``: recorded inputs through the same agents; their commands must be the recorded ones, bit for bit.

Needs a recording that begins before the robots start (``demo`` makes such), and the software that made it.
"""

import argparse
import sys
from pathlib import Path

from contract.arena import ArenaError
from groundstation.recording import Recording, RecordingError
from groundstation.replaying import Archive, Difference, Outcome, replay_all, words
from groundstation.runfolder import recording_path


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, or a recording")
    parser.add_argument(
        "--check", action="store_true", required=True, help="compare what the agents do with what was recorded"
    )
    parser.add_argument("--robot", metavar="ID", help="only this robot")


def run(args: argparse.Namespace) -> int:
    try:
        archive = read(recording_path(args.run))
    except (RecordingError, ArenaError) as error:
        print(error, file=sys.stderr)
        return 2
    if args.robot is not None and args.robot not in archive.arena.robots:
        print(f"--robot {args.robot}: the recording has {', '.join(archive.arena.robots)}", file=sys.stderr)
        return 2
    lives = sorted(life for life in archive.journals if life[0] in archive.arena.robots)
    wanted = [life for life in lives if args.robot in (None, life[0])]
    silent = [name for name in archive.arena.robots if args.robot in (None, name) and name not in dict(wanted)]
    for name in silent:
        print(f"{name}: FAILED: no inputs recorded")
    outcomes = replay_all(archive, lives)
    for life in wanted:
        print("\n".join(described(outcomes[life])), flush=True)
    good = bool(wanted) and not silent and all(outcomes[life].good for life in wanted)
    print("equal in every bit" if good else "FAILED", flush=True)
    return 0 if good else 1


def read(path: Path) -> Archive:
    """:raises RecordingError: no recording of ours."""
    recording = Recording(path)
    archive = Archive(recording.arena())
    for recorded in recording.messages():
        if recorded.message is not None:
            archive.receive(recorded.message, recorded.payload)
    return archive


def described(outcome: Outcome) -> list[str]:
    """One robot's outcome in words."""
    counts = f"{outcome.inputs} inputs, {outcome.steps} steps and {outcome.states} states equal"
    if outcome.unrecorded:
        counts += f", {outcome.unrecorded} not in the recording"
    lines = [f"{outcome.robot}: {counts}"]
    if outcome.problem:
        lines.append(f"{outcome.robot}: FAILED: {outcome.problem}")
    for altered in outcome.altered:
        lines.append(f"{outcome.robot}: FAILED: {altered}: recorded otherwise than the robot received it")
    if outcome.difference is not None:
        lines += [f"{outcome.robot}: FAILED: {line}" for line in differing(outcome.difference)]
    return lines


def differing(difference: Difference) -> list[str]:
    """A difference and what led to it."""
    if difference.replayed is None:
        return [f"{difference.what} at {difference.at_ns} ns was recorded, the replayed agent did not take it"]
    lines = [f"first difference: {difference.what} published at {difference.at_ns} ns"]
    lines += [f"  {name}: recorded {was!r}, replayed {now!r}" for name, was, now in difference.fields()]
    lines.append("  inputs before it, ms:")
    for at_ns, entry in difference.context:
        lines.append(f"    {(at_ns - difference.at_ns) * 1e-6:9.3f}  {words(entry)}")
    return lines
