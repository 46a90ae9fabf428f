"""``doctor``: pre-flight checks over the whole fleet, before any wheel gets power. Needs the router alone."""

import argparse
import shutil
import time
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from contract.arena import Arena, digest
from contract.checks import CheckResult, worst
from contract.messages import Message, MocapFrame, MocapHealth, RobotReport, StationHeartbeat
from groundstation.connectivity import summary
from groundstation.current import arena_of
from groundstation.failsafes import Facts
from groundstation.link import Link, LinkError
from groundstation.preflight import Fleet, preflight
from groundstation.targets import SURE_SHARE, CloudError, cloud_of, on_the_way

LISTEN_S = 1.5
"""The bridge tells its health once a second."""


class Ear:
    """Everything the checks look at, as it arrives."""

    def __init__(self, arena: Arena, disk_free_mb: float | None) -> None:
        self._arena = arena
        self._disk_free_mb = disk_free_mb
        self._reports: dict[str, RobotReport] = {}
        self._heard_ns: dict[str, int] = {}
        self._places: dict[str, tuple[float, float]] = {}
        self._frame_ns = 0
        self._health: MocapHealth | None = None
        self._heartbeat_ns: int | None = None

    def receive(self, message: Message, now_ns: int) -> None:
        match message:
            case RobotReport():
                self._reports[message.robot], self._heard_ns[message.robot] = message, now_ns
            case MocapFrame():
                self._frame_ns = now_ns
                known = self._arena.robots
                self._places = {b.robot: (b.x_m, b.y_m) for b in message.bodies if b.valid and b.robot in known}
            case MocapHealth():
                self._health = message
            case StationHeartbeat():
                self._heartbeat_ns = now_ns
            case _:
                pass

    def fleet(self, now_ns: int) -> Fleet:
        """What has been heard by now."""
        _, pieces = summary(list(self._places.values()), self._arena.control.sensing_radius_m)
        facts = Facts(
            now_ns=now_ns,
            arena=self._arena,
            arena_hash=digest(self._arena),
            crew=tuple(self._arena.robots),
            reports=self._reports,
            heard_ns=self._heard_ns,
            boots={},
            seen=len(self._places),
            frame_ns=self._frame_ns,
            components=pieces,
            disk_free_mb=self._disk_free_mb,
        )
        return Fleet(facts, self._places, self._health, self._heartbeat_ns)


def listen(arena: Arena, seconds: float, folder: Path) -> Fleet:
    """What the site says in that time, and the room on the disk of ``folder``.

    :raises groundstation.link.LinkError: no router answers.
    """
    ear = Ear(arena, shutil.disk_usage(folder).free / 1e6)
    with Link(arena, "doctor", timeout_s=2.0) as link:
        keys = link.keys
        link.subscribe([keys.mocap_frame, keys.mocap_health, keys.heartbeat])
        link.subscribe(keys.report(name) for name in arena.robots)
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            link.wait(left)
            for _, message in link.drain():
                ear.receive(message, link.now_ns())
        return ear.fleet(link.now_ns())


def lines(results: list[CheckResult]) -> list[str]:
    """A table for a person: what is wrong with its remedy below, then one line of what all comes to."""
    wide = max(len(result.name) for result in results)
    who = max(len(result.subject) for result in results)
    found = []
    for result in results:
        found.append(f"{result.verdict.upper():<4}  {result.subject:<{who}}  {result.name:<{wide}}  {result.seen}")
        if result.verdict != "pass" and result.remedy:
            found.append(f"{'':<{who + wide + 10}}-> {result.remedy}")
    count = {verdict: sum(result.verdict == verdict for result in results) for verdict in ("pass", "warn", "fail")}
    found.append(f"{count['pass']} pass, {count['warn']} warn, {count['fail']} fail")
    return found


def pointed(arena: Arena) -> CheckResult:
    """Whether the swarm comes upon a target where the arena file points it: it does not search."""
    try:
        cloud = cloud_of(arena, arena.arena.name)
    except CloudError as error:
        return CheckResult(name="targets", verdict="fail", seen=str(error)[:400], remedy="fewer, or a larger floor")
    points, way_rad = [(target.x_m, target.y_m) for target in cloud.targets], cloud.start_direction_rad
    starts = [robot.start for robot in arena.robots.values()]
    if on_the_way(starts, points, way_rad, SURE_SHARE * arena.control.sensing_radius_m):
        return CheckResult(name="targets", verdict="pass", seen=f"{len(points)}, the first in sight on the way out")
    seen = f"the way out, {way_rad:.2f} rad, passes all {len(points)} out of sight, and the swarm does not search"
    remedy = "leave targets.start_direction_rad out, or point it at a target; close gaps between targets"
    return CheckResult(name="targets", verdict="warn", seen=seen, remedy=remedy)


def certificates(arena: Arena, now: datetime) -> list[CheckResult]:
    """Checks of the certificates; none where the link has no keys."""
    if not arena.link.keys:
        return []
    from groundstation.expiry import certificate_checks
    from groundstation.keyring import Keyring, KeysError

    keyring, names = Keyring(Path(arena.link.keys)), ("router", "bridge", "station", *arena.robots)
    try:
        register = keyring.register()
    except KeysError as error:
        if (keyring.folder / "authority").exists() or not keyring.held():
            return [CheckResult(name="certificates", verdict="fail", seen=str(error)[:400], remedy="keys init")]
        register = None
    return list(certificate_checks(names, register, keyring.held(), keyring.too_open(), now))


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    parser.add_argument("--json", action="store_true", help="the checks as JSON, to standard output")
    parser.add_argument("--wait", type=float, default=LISTEN_S, metavar="S", help="listen this long (%(default)s s)")
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="where a recording will be written")


def run(args: argparse.Namespace) -> int:
    """Exit code 0 where nothing fails, 1 where something does."""
    arena = arena_of(args.arena)
    try:
        results = preflight(listen(arena, args.wait, args.out))
    except LinkError as error:
        remedy = "start the router" if arena.link.keys else "start the mocap bridge"
        results = [CheckResult(name="router", verdict="fail", seen=str(error)[:400], remedy=remedy)]
    results += [pointed(arena), *certificates(arena, datetime.now(UTC))]
    if args.json:
        print(msgspec.json.format(msgspec.json.encode(results)).decode())
    else:
        print("\n".join(lines(results)))
    return 1 if worst(results) == "fail" else 0
