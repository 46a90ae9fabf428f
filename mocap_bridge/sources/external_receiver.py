"""Poses from another positioning system: messages in, frames by name out. Pure."""

from collections import Counter

from contract.arena import Arena
from contract.codec import WireError, decode
from contract.messages import ExternalFrame
from mocap_bridge.frames import ArenaFrame
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.sequence import Sequence
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus

CLOCK_ERROR_NS = 1_000_000
"""Bound assumed for a sender's site time."""
MAX_AHEAD_NS = 5_000_000
MAX_AGE_NS = 2_000_000_000


class ExternalReceiver:
    """Checks and orders the frames of one sender; the poses go through the same checks as all others."""

    def __init__(self, arena: Arena) -> None:
        self._axes = ArenaFrame(arena.mocap)
        self._offsets = {robot.body: robot.heading_offset_rad for robot in arena.robots.values()}
        self._sequence = Sequence()
        self._dropped = 0
        self._session = 0
        self._seen = False
        self._names: frozenset[str] = frozenset()
        self.counters: Counter[str] = Counter()
        self.last_fault = ""

    def receive(self, payload: bytes, now_ns: int) -> SourceFrame | None:
        """One message; what does not decode is counted under ``malformed``."""
        try:
            message = decode(ExternalFrame, payload)
        except WireError as error:
            self.counters["malformed"] += 1
            self.last_fault = str(error)
            return None
        stamp_ns = message.stamp_ns or now_ns
        if not -MAX_AHEAD_NS <= now_ns - stamp_ns <= MAX_AGE_NS:
            self.counters["stamp_not_now"] += 1
            self.last_fault = f"a stamp {(now_ns - stamp_ns) * 1e-9:.3f} s old: stamp_ns is not site time"
            return None
        order = self._sequence.judge(message.seq, stamp_ns * 1e-9, now_ns)
        if order in ("duplicate", "old"):
            self.counters[order] += 1
            return None
        if order == "restart":
            self.counters[order] += 1
            self._session += 1
            self._dropped += self._sequence.dropped
            self._sequence = Sequence()
            self._sequence.judge(message.seq, stamp_ns * 1e-9, now_ns)
        bodies: dict[str, Body] = {}
        for body in message.bodies:
            position, rotation = self._axes.source(
                body.x_m, body.y_m, body.heading_rad, body.z_m, self._offsets.get(body.body, 0.0)
            )
            params = TRACKING_VALID if body.tracked else 0
            bodies[body.body] = (0, *position, *rotation, body.error_m, params)
        self._seen, self._names = True, frozenset(bodies)
        return SourceFrame(self._session, message.seq, stamp_ns, stamp_ns, now_ns, CLOCK_ERROR_NS, bodies)

    def status(self, key: str) -> SourceStatus:
        """Whether anybody has sent yet, and what was wrong with what came."""
        return SourceStatus(
            name="external",
            phase=STEADY if self._seen else f"nobody publishes on {key}",
            problem=self.last_fault if not self._seen else "",
            frames_dropped=self._dropped + self._sequence.dropped,
            malformed=self.counters["malformed"],
            counters=self.counters,
            names=self._names,
        )
