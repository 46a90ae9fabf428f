"""What the arena page hears: the newest message of every key, and every STOP and log line."""

import contextlib
import time
from collections import deque
from typing import Any

from contract.arena import Arena
from contract.codec import WireError, decode
from contract.messages import Message
from groundstation.link import Link

LINES = 5_000


class Intake(Link):
    """The newest message of every key, and every STOP and log line, each with its time of arrival (ns)."""

    def __init__(self, arena: Arena, source: str, timeout_s: float = 10.0) -> None:
        super().__init__(arena, source, timeout_s)
        self._newest: dict[str, tuple[bytes, int]] = {}
        self._rings: list[Any] = []
        self.present: set[str] = set()
        """Sources whose liveliness token is there."""
        self._lines: deque[tuple[str, bytes, int]] = deque(maxlen=LINES)

    def listen(self) -> None:
        import zenoh

        keys = self.keys
        for key in (keys.mocap_frame, keys.mocap_health, keys.status, keys.targets, keys.heartbeat):
            ring: Any = zenoh.handlers.RingChannel(1)
            self._rings.append(self._session.declare_subscriber(key, ring))
        self.subscribe([keys.stop, f"{keys.site}/log/**", f"{keys.site}/robot/*/report"])
        presence = f"{keys.site}/presence/*"
        self._session.liveliness().declare_subscriber(presence, self._attend, history=True)
        self.station()

    def _attend(self, sample: Any) -> None:
        source = str(sample.key_expr).rpartition("/")[2]
        (self.present.discard if str(sample.kind).endswith("DELETE") else self.present.add)(source)

    def _store(self, sample: Any) -> None:
        key, payload, now_ns = str(sample.key_expr), sample.payload.to_bytes(), time.monotonic_ns()
        if key == self.keys.stop or "/log/" in key:
            self._lines.append((key, payload, now_ns))
        else:
            self._newest[key] = (payload, now_ns)

    def take(self) -> list[tuple[Message, int]]:
        """What has come since, in order of arrival; what does not decode is counted.

        Of what comes often and only the newest counts of, the others are never touched here: it arrives when taken.
        """
        raw = [self._lines.popleft() for _ in range(len(self._lines))]
        now_ns = time.monotonic_ns()
        for ring in self._rings:
            if (sample := ring.try_recv()) is not None:
                raw.append((str(sample.key_expr), sample.payload.to_bytes(), now_ns))
        with contextlib.suppress(KeyError):
            for _ in range(len(self._newest)):
                key, (payload, arrival_ns) = self._newest.popitem()
                raw.append((key, payload, arrival_ns))
        messages = []
        for key, payload, arrival_ns in sorted(raw, key=lambda entry: entry[2]):
            kind = self.keys.kind(key)
            try:
                if kind is not None:
                    messages.append((decode(kind, payload), arrival_ns))
            except WireError:
                self.refused += 1
        return messages
