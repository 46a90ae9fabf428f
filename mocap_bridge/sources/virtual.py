"""Virtual bodies beside tracked ones: the mock arena's poses join the frames of the real source.

A frame has one instant, the exposure of the tracked bodies. A virtual body, whose poses come as messages at times of
their own, is placed on the line through its last two poses at that instant.
"""

import math
from collections import Counter, deque
from typing import NamedTuple

import zenoh

from contract.arena import Arena
from contract.codec import WireError, decode
from contract.keys import Keys
from contract.messages import ExternalFrame
from mocap_bridge.frames import ArenaFrame
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.sources.base import OnNetwork, Source, SourceFrame, SourceStatus

STALE_NS = 100_000_000
"""A virtual body whose last pose is this far from the frame's instant counts as not tracked."""
MAX_GAP_NS = 50_000_000
"""Poses further apart say nothing about a speed."""
MAX_WAITING = 64


class _Pose(NamedTuple):
    stamp_ns: int
    x_m: float
    y_m: float
    heading_rad: float

    def at(self, before: "_Pose", stamp_ns: int) -> "_Pose":
        """On the line from ``before`` through this pose."""
        gap_ns = self.stamp_ns - before.stamp_ns
        if not 0 < gap_ns <= MAX_GAP_NS:
            return self
        share = (stamp_ns - self.stamp_ns) / gap_ns
        turned_rad = math.remainder(self.heading_rad - before.heading_rad, math.tau)
        return _Pose(
            stamp_ns,
            self.x_m + share * (self.x_m - before.x_m),
            self.y_m + share * (self.y_m - before.y_m),
            math.remainder(self.heading_rad + share * turned_rad, math.tau),
        )


class VirtualBodies:
    """Poses of the arena's virtual bodies by name, in the tracked source's axes. Pure."""

    def __init__(self, arena: Arena) -> None:
        self._axes = ArenaFrame(arena.mocap)
        self._offsets = {r.body: r.heading_offset_rad for r in arena.virtual_beside_tracked().values()}
        self._poses: dict[str, tuple[_Pose, _Pose]] = {}
        self.counters: Counter[str] = Counter()

    @property
    def names(self) -> frozenset[str]:
        return frozenset(self._offsets)

    @property
    def silent(self) -> list[str]:
        """Bodies of which nothing was heard yet."""
        return sorted(self._offsets.keys() - self._poses.keys())

    def take(self, payload: bytes) -> None:
        """One message; what does not decode, is not virtual or is older than the last is counted."""
        try:
            message = decode(ExternalFrame, payload)
        except WireError:
            self.counters["virtual_malformed"] += 1
            return
        for body in message.bodies:
            if body.body not in self._offsets:
                self.counters["virtual_foreign"] += 1
                continue
            pose = _Pose(message.stamp_ns, body.x_m, body.y_m, body.heading_rad)
            _, last = self._poses.get(body.body, (pose, pose))
            if -STALE_NS < pose.stamp_ns - last.stamp_ns < 0:
                self.counters["virtual_old"] += 1
                continue
            self._poses[body.body] = last, pose

    def at(self, exposure_ns: int) -> dict[str, Body]:
        """All bodies heard of at this instant; one that fell silent is not tracked."""
        bodies: dict[str, Body] = {}
        for name, (before, last) in self._poses.items():
            fresh = abs(exposure_ns - last.stamp_ns) <= STALE_NS
            _, x_m, y_m, heading_rad = last.at(before, exposure_ns) if fresh else last
            position, rotation = self._axes.source(x_m, y_m, heading_rad, 0.0, self._offsets[name])
            bodies[name] = (0, *position, *rotation, 0.0, TRACKING_VALID if fresh else 0)
        return bodies


class WithVirtual:
    """:class:`mocap_bridge.sources.base.Source` that adds the virtual bodies to the tracked one's frames."""

    def __init__(self, arena: Arena, tracked: Source) -> None:
        self.tracked = tracked
        self.bodies = VirtualBodies(arena)
        self._key = Keys(arena.arena.name).virtual
        self._waiting: deque[bytes] = deque(maxlen=MAX_WAITING)
        self._subscriber: zenoh.Subscriber[None] | None = None

    def attach(self, session: zenoh.Session) -> None:
        """Subscribe; the callback only stores."""
        if isinstance(self.tracked, OnNetwork):
            self.tracked.attach(session)
        self._subscriber = session.declare_subscriber(self._key, lambda sample: self.store(bytes(sample.payload)))

    def store(self, payload: bytes) -> None:
        """A message has arrived, on any thread."""
        self._waiting.append(payload)

    def wait(self, timeout_s: float) -> None:
        self.tracked.wait(timeout_s)

    def receive(self, now_ns: int) -> list[SourceFrame]:
        frames = self.tracked.receive(now_ns)
        while self._waiting:
            self.bodies.take(self._waiting.popleft())
        return [
            frame._replace(bodies={**frame.bodies, **self.bodies.at(frame.exposure_ns or frame.received_ns)})
            for frame in frames
        ]

    def status(self) -> SourceStatus:
        status = self.tracked.status()
        problem = status.problem
        if not problem and (silent := self.bodies.silent):
            problem = f"no virtual body {', '.join(silent)}: start ahdc-groundstation mock-arena with this arena file"
        return status._replace(
            problem=problem,
            counters={**status.counters, **self.bodies.counters},
            names=status.names | self.bodies.names if status.names else status.names,
        )

    def close(self) -> None:
        if self._subscriber is not None:
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
            self._subscriber = None
        self.tracked.close()
