"""Orders from another terminal: ``stop`` to the robots themselves, the others to the station's session.

``stop`` needs nothing but the router: it is repeated at 20 Hz until every robot of the arena file
has reported that it obeys, and says so robot by robot.
"""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Literal, NamedTuple

from contract.arena import Arena
from contract.messages import Message, OrderRequest, RobotReport, RunStatus, StopRequest
from groundstation.current import arena_of
from groundstation.link import Link, LinkError

REPEAT_S = 0.05
CONFIRM_S = 0.5
ORDER_CONFIRM_S = 5.0

ORDERS: dict[str, tuple[Literal["arm", "run", "hold", "disarm"], str]] = {
    "arm": ("arm", "armed"),
    "start": ("run", "running"),
    "hold": ("hold", "holding"),
    "release": ("disarm", "disarmed"),
}
"""Verb -> (order, run state that confirms it)."""


class Acknowledgement(NamedTuple):
    robot: str
    latency_s: float | None
    """From the first request to the report that obeys it; None: silent."""


def stop_all(arena: Arena, link: Link, stop_id: int, source: str, give_up_s: float) -> list[Acknowledgement]:
    """Publish StopRequests at 20 Hz until every robot has acknowledged or ``give_up_s`` has passed."""
    link.subscribe(link.keys.report(robot) for robot in arena.robots)
    heard: dict[str, float] = {}
    began = time.monotonic()
    due = began
    while len(heard) < len(arena.robots) and (now := time.monotonic()) - began < give_up_s:
        if now >= due:
            request = StopRequest(stamp_ns=link.stamp_ns(), source=source, stop_id=stop_id)
            link.publish(link.keys.stop, request, "stop")
            due = now + REPEAT_S
        link.wait(due - time.monotonic())
        for _, message in link.drain():
            if isinstance(message, RobotReport) and message.stop_id == stop_id:
                heard.setdefault(message.robot, time.monotonic() - began)
    return [Acknowledgement(robot, heard.get(robot)) for robot in arena.robots]


def describe(acknowledgements: list[Acknowledgement]) -> tuple[list[str], bool]:
    """Lines for a person, and whether all is confirmed in time."""
    lines = []
    for robot, latency_s in acknowledgements:
        if latency_s is None:
            lines.append(f"{robot}  NOT CONFIRMED  cut its power if it moves")
        else:
            late = "  (late)" if latency_s > CONFIRM_S else ""
            lines.append(f"{robot}  stopped  {latency_s * 1000:.0f} ms{late}")
    silent = [robot for robot, latency_s in acknowledgements if latency_s is None]
    if silent:
        lines.append(f"STOP NOT CONFIRMED by {', '.join(silent)}")
    return lines, not silent


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    wait_s = {"stop": CONFIRM_S, "status": 0.5}.get(parser.get_default("verb"), ORDER_CONFIRM_S)
    parser.add_argument("--wait", type=float, default=wait_s, metavar="S", help="for silent robots (%(default)s s)")


def run(args: argparse.Namespace) -> int:
    """Exit code 0 once every robot has obeyed; 1 naming those that have not."""
    arena = arena_of(args.arena)
    work = {"stop": _stop, "status": _status}.get(args.verb, _order)
    return work(arena, args)


def _stop(arena: Arena, args: argparse.Namespace) -> int:
    source = f"terminal {os.getpid()}"
    stop_id = time.time_ns() // 1_000_000
    try:
        with Link(arena, f"stop-{os.getpid()}", timeout_s=2.0) as link:
            acknowledgements = stop_all(arena, link, stop_id, source, max(args.wait, REPEAT_S))
    except LinkError as error:
        print(f"STOP NOT SENT: {error}; cut the robots' power if they move", file=sys.stderr)
        return 1
    lines, confirmed = describe(acknowledgements)
    print("\n".join(lines))
    return 0 if confirmed else 1


def _order(arena: Arena, args: argparse.Namespace) -> int:
    order, state = ORDERS[args.verb]
    try:
        with Link(arena, f"order-{os.getpid()}", timeout_s=2.0) as link:
            request = OrderRequest(
                stamp_ns=link.now_ns(),
                source=f"terminal {os.getpid()}",
                number=time.time_ns() // 1_000_000,
                order=order,
            )
            return _ask(arena, link, request, state, args.wait)
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1


def _ask(arena: Arena, link: Link, request: OrderRequest, state: str, wait_s: float) -> int:
    link.subscribe([link.keys.status, *(link.keys.report(robot) for robot in arena.robots)])
    reports: dict[str, RobotReport] = {}
    status: RunStatus | None = None
    deadline = time.monotonic() + wait_s
    due = time.monotonic()
    while time.monotonic() < deadline:
        if time.monotonic() >= due:
            link.publish(link.keys.order, request, "order")
            due = time.monotonic() + 0.2
        link.wait(due - time.monotonic())
        for _, message in link.drain():
            if isinstance(message, RobotReport):
                reports[message.robot] = message
            elif isinstance(message, RunStatus):
                status = message
        if all(name in reports and reports[name].run == state for name in arena.robots):
            print(f"all {len(arena.robots)} robots {state}")
            return 0
    if status is None:
        print("no station session answers; run `ahdc-groundstation session` or the demo", file=sys.stderr)
    print("\n".join(status_lines(arena, reports, status)))
    return 1


def _status(arena: Arena, args: argparse.Namespace) -> int:
    """One line a robot; exit code 1 if one is silent or at fault."""
    try:
        with Link(arena, f"status-{os.getpid()}", timeout_s=2.0) as link:
            reports, status = _listen(arena, link, args.wait)
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1
    print("\n".join(status_lines(arena, reports, status)))
    good = all(name in reports and reports[name].run != "fault" for name in arena.robots)
    return 0 if good else 1


def _listen(arena: Arena, link: Link, seconds: float) -> tuple[dict[str, RobotReport], RunStatus | None]:
    link.subscribe([link.keys.status, *(link.keys.report(robot) for robot in arena.robots)])
    reports: dict[str, RobotReport] = {}
    status: Message | None = None
    deadline = time.monotonic() + seconds
    while (left := deadline - time.monotonic()) > 0:
        link.wait(left)
        for _, message in link.drain():
            if isinstance(message, RobotReport):
                reports[message.robot] = message
            elif isinstance(message, RunStatus):
                status = message
    return reports, status if isinstance(status, RunStatus) else None


def status_lines(arena: Arena, reports: dict[str, RobotReport], status: RunStatus | None) -> list[str]:
    """The session and every robot of the arena, one line each."""
    head = "no station session"
    if status is not None:
        head = f"{status.phase}  {len(status.occupied)}/{status.targets} targets  {status.detail}".rstrip()
    lines = [head]
    for name in arena.robots:
        report = reports.get(name)
        lines.append(f"{name}  silent" if report is None else f"{name}  {report.run}  {report.reason}".rstrip())
    return lines
