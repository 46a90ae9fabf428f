"""``record``: everything the swarm says into ``DIR/run.mcap``, crash-safe to one second.

A client session of its own with a deep queue; the main thread writes, and once a second closes the
chunk and has the disk confirm it. SIGTERM finishes the file. A full disk is told beforehand and
survived: what was written stays, what could not be written waits in memory and is counted when lost.
One folder a run: when the targets of another mission come after a run, a new folder begins.
"""

import argparse
import itertools
import os
import shutil
import signal
import sys
import time
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from contract.allocator import give_back
from contract.arena import Arena, digest, load
from contract.codec import WireError, decode
from contract.keys import Keys
from contract.messages import LogEntry, TargetCloud
from contract.voice import say
from groundstation.files import RECORDING
from groundstation.link import Link, LinkError
from groundstation.provenance import files, software
from groundstation.recording import CONFIG
from groundstation.runwriter import RunWriter, Sink

COMMIT_S = 1.0
POLL_S = 0.05
TELL_S = 5.0
QUEUE = 200_000
MAX_PENDING_BYTES = 64 << 20
LOW_DISK_BYTES = 500 << 20
LOW_DISK_S = 600.0


class Intake(Link):
    """Everything on the site, as bytes with their time of arrival; full queues drop and count."""

    dropped = 0

    def __init__(self, arena: Arena, timeout_s: float = 10.0) -> None:
        super().__init__(arena, "recorder", timeout_s)
        self._arrived: deque[tuple[str, bytes, int]] = deque()

    def _store(self, sample: Any) -> None:
        if len(self._arrived) >= QUEUE:
            self.dropped += 1
        else:
            self._arrived.append((str(sample.key_expr), sample.payload.to_bytes(), self.stamp_ns()))

    def listen(self) -> None:
        """Subscribe to everything, and return once the router has answered a query sent after that."""
        self.subscribe([self.keys.everything])
        for _ in self._session.get(f"{self.keys.site}/recorder/listening", timeout=2.0):
            pass

    def take(self) -> list[tuple[str, bytes, int]]:
        """Key, payload and time of arrival of what has come since."""
        return [self._arrived.popleft() for _ in range(len(self._arrived))]


class Reel:
    """The recording in progress: a mission that is repeated gets a run folder of its own, ``DIR-2``, ``DIR-3``."""

    def __init__(self, out: Path, arena: Arena, config: bytes, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """:param clock: site time."""
        self.tape = Tape(out / RECORDING, arena, config, clock)
        self._clock = clock
        self.troubles: list[str] = []
        """Of the recordings that are finished."""
        self._out = out
        self._config = config
        self._keys = Keys(arena.arena.name)
        self._cloud = b""
        self._mission: str | None = None
        self._ran = False
        self._begun = False

    def write(self, messages: list[tuple[str, bytes, int]], dropped: int) -> None:
        """Write what has come, the first targets of another mission into a new folder.

        The first messages of a recording are committed at once: a run that has begun can be read, whatever comes.
        """
        begin = 0
        for number, (key, payload, _) in enumerate(messages):
            if key == self._keys.status:
                self._ran = self._ran or b'"phase":"running"' in payload
            elif key == self._keys.targets and payload != self._cloud:
                self._cloud = payload
                mission = _mission_of(payload)
                if self._ran and mission is not None and self._mission not in (None, mission):
                    self.tape.write(messages[begin:number])
                    begin = number
                    self._roll(dropped)
                self._mission = mission or self._mission
        self.tape.write(messages[begin:])
        if not self._begun and self.tape.writer.messages:
            self.tape.commit()
            self._begun = True

    def _next(self) -> "Tape":
        """A recording in a folder of its own.

        :raises OSError: there is no room for one; no folder is left.
        """
        folder = next_folder(self._out)
        folder.mkdir(parents=True)
        try:
            (folder / CONFIG).write_bytes(self._config)
            return Tape(folder / RECORDING, self.tape.arena, self._config, self._clock)
        except OSError:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def _roll(self, dropped: int) -> None:
        try:
            tape = self._next()
        except OSError as error:
            say(f"next run not in a folder of its own: {error}")
            return
        self.tape.close(dropped)
        if self.tape.trouble:
            self.troubles.append(self.tape.trouble)
        self.tape, self._ran, self._begun = tape, False, False
        say(f"recording to {tape.path.parent}", sys.stdout)


def next_folder(out: Path) -> Path:
    """The first of ``OUT-2``, ``OUT-3``, ... that does not exist."""
    return next(path for k in itertools.count(2) if not (path := out.with_name(f"{out.resolve().name}-{k}")).exists())


def _mission_of(payload: bytes) -> str | None:
    try:
        return decode(TargetCloud, payload).mission
    except WireError:
        return None


class Tape:
    """One recording in progress: writes, commits, watches the disk."""

    def __init__(self, path: Path, arena: Arena, config: bytes, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self.path = path
        self.lost = 0
        """Messages that came while the disk was full and memory, too."""
        self.trouble = ""
        self.arena = arena
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        self.sink = Sink(self._descriptor)
        self.writer = RunWriter(self.sink, Keys(arena.arena.name))
        now_ns = clock()
        self.began_ns = now_ns
        try:
            self.writer.describe(
                {"run": _about(arena, now_ns), "software": software()}, {CONFIG: config, **files()}, now_ns
            )
        except OSError:
            os.close(self._descriptor)
            path.unlink()
            raise

    def write(self, messages: list[tuple[str, bytes, int]]) -> None:
        if self.sink.pending > MAX_PENDING_BYTES:
            self.lost += len(messages)
            return
        for key, payload, log_ns in messages:
            self.writer.write(key, payload, log_ns)

    def commit(self) -> None:
        """Have it on the disk, or remember why not."""
        try:
            self.writer.commit()
            self.trouble = ""
        except OSError as error:
            self.trouble = f"cannot write {self.path}: {error.strerror}"

    def close(self, dropped: int) -> None:
        """Finish the file. What the disk refuses is in :attr:`trouble`."""
        ended = {
            "messages": self.writer.messages,
            "unknown_keys": self.writer.unknown,
            "undecodable": self.writer.undecodable,
            "dropped": dropped,
            "lost_disk_full": self.lost,
        }
        try:
            self.writer.finish({"recorder": {name: str(value) for name, value in ended.items()}})
        except OSError as error:
            self.trouble = f"cannot finish {self.path}: {error.strerror}; `recover` makes it whole"
        os.close(self._descriptor)

    def health(self, dropped: int, now_ns: int) -> LogEntry:
        """Size, rate and losses so far, and a warning while the disk fills up or fails."""
        seconds = max(1e-3, (now_ns - self.began_ns) / 1e9)
        rate = self.sink.size / seconds
        free = shutil.disk_usage(self.path.parent).free
        left_s = free / rate if rate else float("inf")
        level: Literal["info", "warning", "error"] = "info"
        text = f"{self.sink.size / 1e6:.1f} MB, {rate / 1e3:.0f} kB/s"
        if self.trouble:
            level, text = "error", f"{self.trouble}; make room, what comes meanwhile is kept in memory"
        elif free < LOW_DISK_BYTES or left_s < LOW_DISK_S:
            level, text = "warning", f"disk nearly full: {free / 1e6:.0f} MB left, {left_s / 60:.0f} min at this rate"
        fields: dict[str, str | int | float | bool | None] = {
            "bytes": self.sink.size,
            "bytes_per_s": round(rate),
            "messages": self.writer.messages,
            "unknown_keys": self.writer.unknown,
            "undecodable": self.writer.undecodable,
            "dropped": dropped,
            "lost": self.lost,
            "disk_free_bytes": free,
        }
        return LogEntry(
            stamp_ns=now_ns, level=level, source="recorder", event="recording", text=text[:400], fields=fields
        )


def _about(arena: Arena, now_ns: int) -> dict[str, str]:
    return {
        "run_id": f"{arena.arena.name}-{datetime.now(UTC):%Y%m%dT%H%M%S}-{os.urandom(2).hex()}",
        "started": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "site_time_ns": str(now_ns),
        "wall_minus_site_ns": str(time.time_ns() - now_ns),
        "arena": arena.arena.name,
        "arena_hash": digest(arena),
        "profile": arena.control.profile,
        "seed": str(arena.targets.seed),
        "robots": " ".join(arena.robots),
    }


def set_aside(path: Path) -> None:
    """Give an earlier recording of this name its time as a second name, so that none is overwritten."""
    if path.exists():
        stamp = datetime.fromtimestamp(path.stat().st_mtime, UTC)
        path.rename(path.with_name(f"{path.stem}-until-{stamp:%Y%m%dT%H%M%S%f}{path.suffix}"))


def record(reel: Reel, intake: Intake, going: Callable[[], bool]) -> None:
    """Write until told to end, then what has still arrived."""
    intake.listen()
    print("READY recorder", flush=True)
    commit_due = tell_due = time.monotonic()
    level = "info"
    while going():
        time.sleep(POLL_S)
        reel.write(intake.take(), intake.dropped)
        tape = reel.tape
        now = time.monotonic()
        if now < commit_due:
            continue
        commit_due = now + COMMIT_S
        tape.commit()
        give_back()
        health = tape.health(intake.dropped, intake.now_ns())
        if now >= tell_due or health.level != level:
            tell_due = now + TELL_S
            intake.publish(intake.keys.log("recorder"), health, "log")
        if health.level != level:
            say(health.text)
            level = health.level
    reel.write(intake.take(), intake.dropped)


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file (TOML)")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help=f"run folder; the recording is DIR/{RECORDING}, that of a repeated mission DIR-2/{RECORDING}",
    )


def run(args: argparse.Namespace) -> int:
    arena = load(args.arena)
    going = [True]
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: going.clear())
    intake = Intake(arena)
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        set_aside(args.out / RECORDING)
        with intake:
            return _record(Reel(args.out, arena, args.arena.read_bytes(), intake.now_ns), intake, lambda: bool(going))
    except OSError as error:
        print(f"{args.out}: {error.strerror}", file=sys.stderr)
    except LinkError as error:
        print(error, file=sys.stderr)
    return 1


def _record(reel: Reel, intake: Intake, going: Callable[[], bool]) -> int:
    try:
        record(reel, intake, going)
    finally:
        reel.tape.close(intake.dropped)
    troubles = [*reel.troubles, *filter(None, [reel.tape.trouble])]
    for trouble in troubles:
        say(trouble)
    return 1 if troubles else 0
