"""``deploy``: the field kit onto the robots' computers: at once, checked before and after, taken back on failure."""

import argparse
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from contract.arena import Arena, load, robot_or_fault
from contract.checks import CheckResult, worst
from drivers.registry import wheel_faults
from groundstation.deployment import plan
from groundstation.deployment.course import Outcome, Runner, follow
from groundstation.deployment.facts import Facts, preflight, read
from groundstation.deployment.pins import PinError
from groundstation.deployment.remote import Ssh
from groundstation.deployment.render import folder_of
from groundstation.deployment.site import busy, listen
from groundstation.deployment.workshop import Workshop, key_faults
from groundstation.link import LinkError

AT_ONCE = 8


class Visit(NamedTuple):
    """What became of one robot."""

    outcome: Outcome
    facts: Facts | None
    checks: list[CheckResult]
    took_s: float


class Deployment:
    """One call of the verb."""

    def __init__(self, arena: Arena, names: Sequence[str], runners: Mapping[str, Runner], root: str = "") -> None:
        self.arena = arena
        self.names = list(names)
        self.wanted: plan.Wanted = "ready"
        self._runners = runners
        self._root = root
        self._lock = threading.Lock()
        self._began_s = time.monotonic()

    def tell(self, robot: str, text: str) -> None:
        """A line of progress."""
        with self._lock:
            print(f"{time.monotonic() - self._began_s:6.1f} s  {robot:<8}  {text}", flush=True)

    def everywhere(self, work: Callable[[str], Visit]) -> list[Visit]:
        """The work for every robot, some at once, results in order."""
        with ThreadPoolExecutor(AT_ONCE) as pool:
            return list(pool.map(work, self.names))

    def look(self, robot: str) -> tuple[Facts | None, list[CheckResult]]:
        """Probe one computer."""
        self.tell(robot, f"pre-flight at {self.arena.robots[robot].host}")
        sent_s = time.time()
        code, text = self._runners[robot](plan.probe(self._target(robot)))
        back_s = time.time()
        if code:
            words = " | ".join(text.strip().splitlines()[-2:]) or f"ssh ended with {code}"
            remedy = f"try: ssh -p {self.arena.deploy.port} {self.arena.deploy.user}@{self.arena.robots[robot].host}"
            return None, [CheckResult(name="ssh", verdict="fail", seen=words[:400], remedy=remedy, subject=robot)]
        facts = read(text, sent_s, back_s)
        return facts, [*preflight(facts, robot), *key_faults(self.arena, robot)]

    def install(self, robot: str, workshop: Workshop, dry: bool) -> Visit:
        """Pre-flight, then every step; a dry run tells the steps and does none."""
        began_s = time.monotonic()
        facts, checks = self.look(robot)
        refused = self._refusal(robot, facts, checks, began_s)
        if refused or facts is None:
            return refused or Visit(Outcome(robot, "refused"), facts, checks, 0.0)
        self.tell(robot, f"wheels for Python {facts.minor} on {facts.machine}")
        try:
            release = workshop.release(robot, facts)
        except PinError as error:
            return Visit(Outcome(robot, "refused", str(error)), facts, checks, time.monotonic() - began_s)
        target = self._target(robot)
        steps = plan.deployment(target, release, self.wanted)
        if dry:
            for step in steps:
                self.tell(robot, f"would: {step.says}")
            return Visit(Outcome(robot, "done", f"would run {release.name}", facts.current), facts, checks, 0.0)
        outcome = follow(
            robot,
            steps,
            lambda: plan.rollback(target, facts.current, self.wanted),
            self._runners[robot],
            lambda text: self.tell(robot, text),
            release,
            facts.current,
        )
        self.tell(robot, outcome.ending)
        return Visit(outcome, facts, checks, time.monotonic() - began_s)

    def go_back(self, robot: str, dry: bool) -> Visit:
        """To the release before the one that runs."""
        began_s = time.monotonic()
        facts, checks = self.look(robot)
        refused = self._refusal(robot, facts, checks, began_s)
        if refused or facts is None:
            return refused or Visit(Outcome(robot, "refused"), facts, checks, 0.0)
        if not facts.previous or facts.previous == facts.current:
            return Visit(
                Outcome(robot, "refused", "there is no release before this one", facts.current), facts, checks, 0
            )
        steps = plan.rollback(self._target(robot), facts.previous, self.wanted)
        return self._plain(robot, steps, facts, checks, began_s, dry, facts.previous)

    def take_away(self, robot: str, dry: bool) -> Visit:
        """Remove all of it."""
        began_s = time.monotonic()
        facts, checks = self.look(robot)
        if facts is None or not facts.root:
            return Visit(Outcome(robot, "refused", _why(checks)), facts, checks, time.monotonic() - began_s)
        return self._plain(robot, plan.removal(self._target(robot)), facts, checks, began_s, dry, "")

    def _plain(
        self,
        robot: str,
        steps: Sequence[plan.Step],
        facts: Facts,
        checks: list[CheckResult],
        began_s: float,
        dry: bool,
        release: str,
    ) -> Visit:
        for step in steps:
            self.tell(robot, f"would: {step.says}" if dry else step.says)
            fault = "" if dry else plan.fault_of(step, *self._runners[robot](step))
            if fault:
                outcome = Outcome(robot, "failed", fault, "", facts.current)
                return Visit(outcome, facts, checks, time.monotonic() - began_s)
        runs = facts.current if dry else release
        return Visit(Outcome(robot, "done", "", runs, facts.current), facts, checks, time.monotonic() - began_s)

    def _refusal(self, robot: str, facts: Facts | None, checks: list[CheckResult], began_s: float) -> Visit | None:
        if worst(checks) != "fail":
            return None
        current = facts.current if facts else ""
        return Visit(Outcome(robot, "refused", _why(checks), current), facts, checks, time.monotonic() - began_s)

    def _target(self, robot: str) -> plan.Target:
        return plan.Target(robot, folder_of(self.arena, robot), self._root)


def _why(checks: list[CheckResult]) -> str:
    return "; ".join(f"{check.name}: {check.seen} ({check.remedy})" for check in checks if check.verdict == "fail")


def table(arena: Arena, visits: Sequence[Visit]) -> list[str]:
    """A row a robot, then what wants a person's eye."""
    head = ("robot", "host", "machine", "python", "ran", "runs", "ended", "took")
    rows = [head]
    for outcome, facts, _, took_s in visits:
        machine = facts.machine if facts else "-"
        python = facts.version if facts else "-"
        cells = (
            machine,
            python or "-",
            outcome.before or "-",
            outcome.release or "-",
            outcome.ending,
            f"{took_s:.0f} s",
        )
        rows.append((outcome.robot, arena.robots[outcome.robot].host, *cells))
    wide = [max(len(row[column]) for row in rows) for column in range(len(head))]
    lines = ["  ".join(cell.ljust(size) for cell, size in zip(row, wide, strict=True)).rstrip() for row in rows]
    for outcome, _, checks, _ in visits:
        if outcome.detail:
            lines.append(f"{outcome.robot}: {outcome.detail}")
        lines += [f"{outcome.robot}: {c.name}: {c.seen} ({c.remedy})" for c in checks if c.verdict == "warn"]
    return lines


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("arena", type=Path, metavar="ARENA.toml", help="arena file; robots with a host are deployed to")
    parser.add_argument("--only", action="append", default=[], metavar="ID", help="this robot alone; may be repeated")
    parser.add_argument("--dry-run", action="store_true", help="look and tell what would be done; change nothing")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--rollback", action="store_true", help="go back to the release before the one that runs")
    what.add_argument("--remove", action="store_true", help="take everything away again")
    what.add_argument(
        "--fetch", action="store_true", help="only fetch wheels for every processor and Python, to take along"
    )
    parser.add_argument("--wheels", type=Path, metavar="DIR", help="take wheels from this folder, not from the network")
    parser.add_argument(
        "--ssh", action="append", default=[], metavar="WORD", help="one more word for ssh, such as --ssh=-iKEY"
    )
    parser.epilog = "exit codes: 0 every robot is as asked, 1 one is not (the table says why), 2 bad input"


def run(args: argparse.Namespace) -> int:
    """Exit code as in the epilog."""
    arena = load(args.arena, wheel_faults)
    for name in args.only:
        robot_or_fault(arena, name)
    names = [name for name in args.only or arena.robots if arena.robots[name].host]
    if not names and not args.fetch:
        missing = ", ".join(args.only or arena.robots)
        print(f'no host is known of {missing}; in {args.arena}: [robots.ID] host = "192.168.7.16"', file=sys.stderr)
        return 2
    deploy = arena.deploy
    runners = {name: Ssh(arena.robots[name].host, deploy.user, deploy.port, tuple(args.ssh)) for name in names}
    with tempfile.TemporaryDirectory(prefix="ahdc-deploy-") as scratch:
        try:
            return conduct(args, Deployment(arena, names, runners), Path(scratch))
        except PinError as error:
            print(error, file=sys.stderr)
            return 1


def conduct(args: argparse.Namespace, deployment: Deployment, scratch: Path) -> int:
    """What the options ask for, on every robot, and the table.

    :raises groundstation.deployment.pins.PinError: nothing can be installed from here.
    """
    arena = deployment.arena
    if args.fetch:
        print("\n".join(Workshop(arena, scratch, args.wheels).fetch_all()))
        return 0
    try:
        heard = listen(arena)
        if words := busy(heard.status, heard.reports):
            print(f"{words}: software is not changed now; ahdc-groundstation release, then deploy", file=sys.stderr)
            return 1
    except LinkError:
        deployment.wanted = "waiting"
        print("no router answers: no mission runs, and robots will wait for it", flush=True)
    if args.rollback:
        visits = deployment.everywhere(lambda name: deployment.go_back(name, args.dry_run))
    elif args.remove:
        visits = deployment.everywhere(lambda name: deployment.take_away(name, args.dry_run))
    else:
        workshop = Workshop(arena, scratch, args.wheels)
        visits = deployment.everywhere(lambda name: deployment.install(name, workshop, args.dry_run))
    print("\n" + "\n".join(table(arena, visits)))
    return 0 if all(visit.outcome.ending == "done" for visit in visits) else 1
