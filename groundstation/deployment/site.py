"""What the site says on its network while software is about to change: whether a mission runs, and who is well."""

import time
from collections.abc import Mapping

from contract.arena import Arena
from contract.messages import Message, RobotReport, RunStatus
from groundstation.link import Link

LISTEN_S = 1.3
"""Status and reports come ten times a second."""
UNDER_WAY = ("armed", "running", "homing")
POWERED = ("armed", "running", "holding")


class Heard:
    """The newest status and reports."""

    def __init__(self) -> None:
        self.status: RunStatus | None = None
        self.reports: dict[str, RobotReport] = {}

    def take(self, message: Message) -> None:
        if isinstance(message, RunStatus):
            self.status = message
        elif isinstance(message, RobotReport):
            self.reports[message.robot] = message


def listen(arena: Arena, seconds: float = LISTEN_S) -> Heard:
    """What is said within that time.

    :raises groundstation.link.LinkError: no router answers, so no mission can be running.
    """
    heard = Heard()
    with Link(arena, "deploy", timeout_s=2.0) as link:
        link.subscribe([link.keys.status])
        link.subscribe(link.keys.report(name) for name in arena.robots)
        deadline = time.monotonic() + seconds
        while (left_s := deadline - time.monotonic()) > 0:
            link.wait(left_s)
            for _, message in link.drain():
                heard.take(message)
    return heard


def busy(status: RunStatus | None, reports: Mapping[str, RobotReport]) -> str:
    """Why software must not change now; empty: it may."""
    if status is not None and status.phase in UNDER_WAY:
        return f"mission {status.mission} is {status.phase}"
    powered = sorted(name for name, report in reports.items() if report.run in POWERED)
    return f"the motors of {', '.join(powered)} are on" if powered else ""
