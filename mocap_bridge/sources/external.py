"""Poses from another positioning system over the swarm's own network."""

import threading
from collections import deque

import zenoh

from contract.arena import Arena
from contract.keys import Keys
from mocap_bridge.sources.base import SourceFrame, SourceStatus
from mocap_bridge.sources.external_receiver import ExternalReceiver

MAX_WAITING = 64


class ExternalSource:
    """Listens on the site's ``mocap/external`` key once it is attached to a session."""

    def __init__(self, arena: Arena) -> None:
        self._receiver = ExternalReceiver(arena)
        self._key = Keys(arena.arena.name).external
        self._waiting: deque[bytes] = deque(maxlen=MAX_WAITING)
        self._arrived = threading.Event()
        self._subscriber: zenoh.Subscriber[None] | None = None

    def attach(self, session: zenoh.Session) -> None:
        """Subscribe; the callback only stores and wakes."""
        self._subscriber = session.declare_subscriber(self._key, self._store)

    def _store(self, sample: zenoh.Sample) -> None:
        self._waiting.append(bytes(sample.payload))
        self._arrived.set()

    def wait(self, timeout_s: float) -> None:
        """Until a message is there, at most ``timeout_s``."""
        self._arrived.wait(timeout_s)
        self._arrived.clear()

    def receive(self, now_ns: int) -> list[SourceFrame]:
        """Everything that has arrived."""
        frames = []
        while self._waiting:
            frame = self._receiver.receive(self._waiting.popleft(), now_ns)
            if frame is not None:
                frames.append(frame)
        return frames

    def status(self) -> SourceStatus:
        return self._receiver.status(self._key)

    def close(self) -> None:
        if self._subscriber is not None:
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
            self._subscriber = None
