"""Runs a :class:`groundstation.session.Session` on the network, at the pace of its heartbeat."""

import time
from collections.abc import Callable

from contract.arena import Arena
from contract.messages import TargetCloud
from groundstation.link import Link
from groundstation.session import Session

HEARTBEAT_NS = 50_000_000
STATUS_NS = 100_000_000
CLOUD_NS = 500_000_000


class Conductor:
    """Publishes heartbeat, cloud and status when they are due, and feeds the session what arrives."""

    def __init__(self, arena: Arena, session: Session, cloud: TargetCloud, link: Link) -> None:
        self.session = session
        self._cloud = cloud
        self._link = link
        self._due = {"heartbeat": 0, "targets": 0, "status": 0}
        keys = link.keys
        link.subscribe([keys.mocap_frame, keys.stop, keys.order])
        link.subscribe(key for robot in arena.robots for key in (keys.report(robot), keys.state(robot)))

    def turn(self) -> None:
        """Take what has arrived, publish what is due, and wait at most until the next heartbeat."""
        for _, message in self._link.drain():
            self.session.receive(message, time.monotonic_ns())
        now_ns = time.monotonic_ns()
        if self._take("heartbeat", HEARTBEAT_NS, now_ns):
            self.session.advance(now_ns)
            self._link.publish(self._link.keys.heartbeat, self.session.heartbeat(now_ns), "heartbeat")
        if self._take("targets", CLOUD_NS, now_ns):
            self._link.publish(self._link.keys.targets, self._cloud, "targets")
        if self._take("status", STATUS_NS, now_ns):
            self._link.publish(self._link.keys.status, self.session.status(now_ns), "status")
        time.sleep(max(0.0, (min(self._due.values()) - time.monotonic_ns()) / 1e9))

    def until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Turn until ``done`` or the time is up; whether it was done."""
        deadline = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline:
                return False
            self.turn()
        return True

    def _take(self, what: str, period_ns: int, now_ns: int) -> bool:
        if now_ns < self._due[what]:
            return False
        late = now_ns - self._due[what] > period_ns
        self._due[what] = now_ns + period_ns if late else self._due[what] + period_ns
        return True
