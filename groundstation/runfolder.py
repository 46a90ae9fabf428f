"""One folder a run, and the verb ``metrics`` that judges it from the recording alone.

run.mcap       everything the swarm said       config.toml    the resolved arena file
metrics.json   what it was worth               manifest.json  where it came from, and file hashes
figures/       after the paper's figures 3-5   report.html    the whole story on a page
"""

import argparse
import hashlib
import sys
from pathlib import Path
from typing import NamedTuple

import msgspec

from contract.arena import ArenaError
from groundstation.files import RECORDING, write_whole
from groundstation.history import History
from groundstation.metrics import Metrics, compute, encode, failures
from groundstation.recording import Recording, RecordingError

METRICS = "metrics.json"
MANIFEST = "manifest.json"
UNLISTED = (MANIFEST, "logs", "ports")


class Run(NamedTuple):
    """A run read back."""

    folder: Path
    recording: Recording
    history: History
    metrics: Metrics | None


def recording_path(path: Path) -> Path:
    """The recording meant by a run folder or by the recording itself."""
    return path / RECORDING if path.is_dir() else path


def read(path: Path) -> Run:
    """Read a run folder, or a recording, and judge it anew from the recording alone.

    :raises RecordingError: there is no recording, or it is not one of ours.
    """
    file = recording_path(path)
    recording = Recording(file)
    try:
        history = History(recording.arena())
    except ArenaError as error:
        raise RecordingError(f"{file}: the attached arena file has faults\n{error}") from None
    for recorded in recording.messages():
        if recorded.message is not None:
            history.receive(recorded.message)
    return Run(file.parent, recording, history, compute(history, recording.undecodable))


def write_metrics(run: Run) -> Path | None:
    """``metrics.json`` of a run; None when no mission was started."""
    if run.metrics is None:
        return None
    path = run.folder / METRICS
    write_whole(path, encode(run.metrics))
    return path


def write_manifest(run: Run) -> Path:
    """``manifest.json``: run id, software, seed and the hash of every file in the folder."""
    files = sorted(
        path
        for path in run.folder.rglob("*")
        if path.is_file() and path.relative_to(run.folder).parts[0] not in UNLISTED
    )
    table = {
        **run.recording.metadata.get("run", {}),
        "software": run.recording.metadata.get("software", {}),
        "recording_whole": run.recording.whole,
        "files": {
            path.relative_to(run.folder).as_posix(): {"bytes": path.stat().st_size, "sha256": sha256(path)}
            for path in files
        },
    }
    path = run.folder / MANIFEST
    write_whole(path, msgspec.json.format(msgspec.json.encode(table)) + b"\n")
    return path


def sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, or its recording")
    parser.add_argument("--check", action="store_true", help="compare with the RUN's metrics.json, write nothing")


def run(args: argparse.Namespace) -> int:
    """Exit code 0: the mission was a success; 1: it was not, or --check found a difference."""
    try:
        found = read(args.run)
    except RecordingError as error:
        print(error, file=sys.stderr)
        return 2
    if found.metrics is None:
        print(f"{found.recording.path}: no mission was started")
        return 1
    if args.check:
        return _check(found)
    write_metrics(found)
    write_manifest(found)
    print(encode(found.metrics).decode(), end="")
    reasons = failures(found.metrics)
    for reason in reasons:
        print(f"FAILED: {reason}", file=sys.stderr)
    return 1 if reasons else 0


def _check(found: Run) -> int:
    path = found.folder / METRICS
    try:
        written = msgspec.json.decode(path.read_bytes())
    except (OSError, msgspec.DecodeError) as error:
        print(f"{path}: {error}", file=sys.stderr)
        return 2
    fresh = msgspec.json.decode(encode(found.metrics)) if found.metrics else {}
    different = [name for name in fresh if written.get(name) != fresh[name]]
    for name in different:
        print(f"{name}: {written.get(name)} written, {fresh[name]} recomputed", file=sys.stderr)
    print(f"{path}: {len(fresh) - len(different)} of {len(fresh)} numbers recomputed alike from the recording")
    return 1 if different else 0
