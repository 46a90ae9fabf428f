"""Runs a :class:`groundstation.session.Session` on the network, at the pace of its heartbeat."""

import argparse
import secrets
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from contract.arena import Arena, digest, load
from contract.messages import LogEntry, Message, TargetCloud
from contract.voice import say
from groundstation import current
from groundstation.course import Plan
from groundstation.doorkeeper import Doorkeeper
from groundstation.failsafes import OVERRIDABLE
from groundstation.link import Link, LinkError
from groundstation.pickup import Notebook
from groundstation.session import Session
from groundstation.targets import CloudError, cloud_of

HEARTBEAT_NS = 50_000_000
STATUS_NS = 100_000_000
CLOUD_NS = 500_000_000
DISK_NS = 1_000_000_000
REFUSED_NS = 1_000_000_000


def new_session(arena: Arena, cloud: TargetCloud, plan: Plan, link: Link) -> Session:
    """A session with a boot number never used before."""
    return Session(arena, cloud, secrets.randbelow(1 << 48), plan, link.now_ns())


class Conductor:
    """Publishes heartbeat, cloud and status when they are due, and feeds the session what arrives."""

    def __init__(
        self,
        arena: Arena,
        session: Session,
        cloud: TargetCloud,
        link: Link,
        folder: Path | None = None,
        notebook: Notebook | None = None,
    ) -> None:
        """
        :param folder: where the recording is written; the room there is looked at once a second.
        :param notebook: where the mission is noted for a session that starts after this one.
        """
        self._folder = folder
        self._notebook = notebook
        self._phase = session.phase
        self.session = session
        session.cloud = cloud
        self._link = link
        self.listener: Callable[[Message, float], None] | None = None
        """Also told every message, with the monotonic time in seconds."""
        self._told = cloud
        self._door = Doorkeeper()
        self._epoch = link.epoch
        self._refused = 0
        self._due = {"heartbeat": 0, "targets": 0, "status": 0, "disk": 0, "refused": 0}
        keys = link.keys
        link.subscribe([keys.mocap_frame, keys.mocap_health, keys.stop, keys.order, keys.seed])
        link.subscribe(key for robot in arena.robots for key in (keys.report(robot), keys.state(robot)))

    def turn(self) -> None:
        """Take what has arrived, publish what is due, and wait at most until the next heartbeat."""
        if self._epoch != self._link.epoch:
            self._epoch, self._door = self._link.epoch, Doorkeeper(self._door.boot)
            self._refused = 0
        for _, message in self._link.drain():
            if not self._door.lets(message):
                continue
            self.session.receive(message, self._link.now_ns())
            if self.listener is not None:
                self.listener(message, time.monotonic())
        now_ns, local_ns = self._link.now_ns(), time.monotonic_ns()
        if self._take("disk", DISK_NS, local_ns) and self._folder is not None:
            self.session.disk_free_mb = shutil.disk_usage(self._folder).free / 1e6
        if self._take("refused", REFUSED_NS, local_ns):
            self._tell_refused(now_ns)
        if self._take("heartbeat", HEARTBEAT_NS, local_ns):
            self.session.advance(now_ns)
            self._note_overrides(now_ns)
            beat = self.session.heartbeat(now_ns)
            self._door.boot = beat.boot
            self._link.publish(self._link.keys.heartbeat, beat, "heartbeat")
        if self.session.cloud is not self._told:
            self._told, self._due["targets"] = self.session.cloud, local_ns
        if self._take("targets", CLOUD_NS, local_ns):
            self._link.publish(self._link.keys.targets, self.session.cloud, "targets")
        if self._take("status", STATUS_NS, local_ns):
            status = self.session.status(now_ns)
            self._link.publish(self._link.keys.status, status, "status")
            if self._notebook is not None:
                session = self.session
                self._notebook.write(session.cloud, session.started_ns, session.phase == "completed", now_ns)
            if self.listener is not None:
                self.listener(status, time.monotonic())
        time.sleep(max(0.0, (min(self._due.values()) - time.monotonic_ns()) / 1e9))

    def until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Turn until ``done`` or the time is up; whether it was done."""
        deadline = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline:
                return False
            self.turn()
        return True

    def _note_overrides(self, now_ns: int) -> None:
        """What the operator has taken on goes into the recording with every start."""
        before, self._phase = self._phase, self.session.phase
        if self._phase == "running" and before != "running":
            for name in self.session.overrides:
                words = f"{name} overridden by the operator"
                entry = LogEntry(stamp_ns=now_ns, level="warning", source="station", event="override", text=words)
                self._link.publish(self._link.keys.log("station"), entry, "log")

    def _tell_refused(self, now_ns: int) -> None:
        """What was not let in goes into the log, by name and number."""
        refused = self._door.refused
        if refused.total() > self._refused:
            self._refused = refused.total()
            words = ", ".join(f"{name} {count}" for name, count in sorted(refused.items()))
            entry = LogEntry(
                stamp_ns=now_ns,
                level="warning",
                source="station",
                event="refused",
                text=words[:400],
                fields={**refused},
            )
            self._link.publish(self._link.keys.log("station"), entry, "log")

    def _take(self, what: str, period_ns: int, local_ns: int) -> bool:
        """Whether it is due by this computer's own clock: site time may become another."""
        if local_ns < self._due[what]:
            return False
        late = local_ns - self._due[what] > period_ns
        self._due[what] = local_ns + period_ns if late else self._due[what] + period_ns
        return True


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file (TOML)")
    parser.add_argument("--quorum", type=int, default=0, metavar="N", help="start with N robots, late ones join")
    parser.add_argument(
        "--override", action="append", default=[], choices=OVERRIDABLE, metavar="CHECK",
        help=f"start although this check fails ({', '.join(OVERRIDABLE)}); recorded",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="where the recording is written")
    parser.add_argument(
        "--mission", default="", metavar="NAME",
        help="begin a mission of this name (the mission that a session left within the hour, else the arena's)",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """``session``: be the station until SIGTERM; the operator's verbs arm, start, hold and release."""
    arena = load(args.arena)
    try:
        cloud = cloud_of(arena, args.mission or arena.arena.name)
    except CloudError as error:
        print(error, file=sys.stderr)
        return 2
    if not 0 <= args.quorum <= len(arena.robots):
        print(f"session: --quorum {args.quorum}: from 1 to {len(arena.robots)} robots, 0 for all", file=sys.stderr)
        return 2
    plan = Plan(quorum=args.quorum, overrides=tuple(args.override))
    going = [True]
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: going.clear())
    try:
        with Link(arena, "station") as link:
            current.remember(args.arena)
            session, notebook = new_session(arena, cloud, plan, link), Notebook(digest(arena))
            if not args.mission and (note := notebook.read(link.now_ns())) is not None:
                session.go_on(note.cloud, note.started_ns)
                print(f"goes on with mission {note.cloud.mission}, {len(note.cloud.targets)} targets", flush=True)
            conductor = Conductor(arena, session, session.cloud, link, args.out, notebook)
            print("READY station", flush=True)
            words = ""
            while going:
                conductor.turn()
                if (now := f"{session.phase}: {session.detail}") != words:
                    words = now
                    say(words, sys.stdout)
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1
    return 0
