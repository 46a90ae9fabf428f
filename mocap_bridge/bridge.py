"""The bridge process: a source of poses in, whole-frame messages and health out. One thread."""

import time
from collections.abc import Callable

from msgspec.structs import replace

from contract.arena import Arena
from contract.codec import encode
from contract.keys import Keys
from contract.messages import LogEntry, MocapHealth
from mocap_bridge.network import Joined, publisher
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.base import Source
from mocap_bridge.timekeeper import Timekeeper

HEALTH_NS = 1_000_000_000
LOOK_NS = 20_000_000
"""State changes are noticed this soon without a frame."""
FLOWING_LOOK_NS = 100_000_000
"""And this soon while frames come: then they are in what a second of frames was like."""
WAIT_S = 0.02
NAME = "mocap_bridge"


class Bridge:
    """Pumps a source into the network until told to stop."""

    def __init__(self, arena: Arena, source: Source, joined: Joined, allow_edited: bool = False) -> None:
        keys, session = Keys(arena.arena.name), joined.session
        self._source = source
        self._joined = joined
        self._frames = publisher(session, keys.mocap_frame, "mocap_frame")
        self._health = publisher(session, keys.mocap_health, "mocap_health")
        self._log = publisher(session, keys.log(NAME), "log")
        self._timekeeper = Timekeeper(keys, session)
        self._token = session.liveliness().declare_token(keys.presence(NAME))
        self.pipeline = Pipeline(arena, time.monotonic_ns() // 1_000_000, allow_edited)
        self._state = ""
        self._health_due_ns = self._looked_ns = 0

    def run(self, stopping: Callable[[], bool]) -> None:
        """Until ``stopping()``.

        :raises mocap_bridge.router.RouterError: the router has ended, and cannot begin again.
        """
        while not stopping():
            self._source.wait(WAIT_S)
            self.turn(time.monotonic_ns())

    def turn(self, now_ns: int) -> int:
        """Receive, publish, report, look after the router; returns the number of frames published."""
        frames = self._source.receive(now_ns)
        for frame in frames:
            self._frames.put(encode(self.pipeline.frame(frame, time.monotonic_ns())))
        if now_ns - self._looked_ns >= (FLOWING_LOOK_NS if frames else LOOK_NS) or now_ns >= self._health_due_ns:
            self._looked_ns = now_ns
            self._joined.tend()
            self._report(now_ns)
        return len(frames)

    def _report(self, now_ns: int) -> None:
        status = self._source.status()
        state, _ = self.pipeline.health.state(status, now_ns)
        if state == self._state and now_ns < self._health_due_ns:
            return
        health = self.pipeline.report(status, now_ns)
        if refused := self._timekeeper.counters:
            questions = {f"clock_{name}": count for name, count in refused.items()}
            health = replace(health, counters=health.counters | questions)
        self._health.put(encode(health))
        if state != self._state:
            self._log.put(encode(log_of(health)))
        self._state, self._health_due_ns = state, now_ns + HEALTH_NS


def log_of(health: MocapHealth) -> LogEntry:
    """The log entry of a change of state."""
    level = {"ok": "info", "connecting": "info", "degraded": "warning", "stale": "warning"}.get(health.state, "error")
    return LogEntry(
        stamp_ns=health.stamp_ns,
        level=level,  # type: ignore[arg-type]
        source=NAME,
        event=f"mocap_{health.state}",
        text=health.detail,
        fields={"session": health.session, "frame": health.frame, "rate_hz": health.rate_hz},
    )
