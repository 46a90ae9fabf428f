"""The station's place on the network: one client session, a bounded queue in, publishers out."""

import contextlib
import os
import select
import sys
import time
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

from msgspec.structs import replace

from contract import network
from contract.arena import Arena, ArenaError
from contract.codec import WireError, decode, encode
from contract.exposure import exposure
from contract.keys import Keys
from contract.messages import ClockAsk, ClockTell, Message, OrderRequest, StationHeartbeat
from contract.site_clock import SiteClock
from groundstation.network import open_session, publisher

QUEUE = 20_000
TOLD_S = 0.5
HEARD_S = 0.5
"""For the first heartbeat of the session that an order is for."""


class LinkError(RuntimeError):
    """No router answers at the arena's endpoint."""


def identity_of(keys: str, roles: Sequence[str]) -> network.Identity | None:
    """The first of the roles that this computer has a certificate for; None where the link has no keys.

    :raises contract.arena.ArenaError: it has none.
    """
    for role in roles[:-1]:
        with contextlib.suppress(ArenaError):
            return network.identity(keys, role)
    return network.identity(keys, roles[-1])


class Link:
    """A client session of the arena's router. Use it in a ``with`` block: a session left open hangs the exit.

    :param roles: certificates to try, where the link has keys; an operator may only ask and listen.
    :raises contract.arena.ArenaError: this computer has none of these certificates.
    :raises LinkError: on entering, if no router answers within ``timeout_s``.
    """

    def __init__(
        self, arena: Arena, source: str, timeout_s: float = 10.0, roles: Sequence[str] = ("station", "operator")
    ) -> None:
        self.keys = Keys(arena.arena.name)
        self.refused = 0
        """Payloads that were not the message their key carries."""
        self._endpoint = arena.link.router
        self._identity = identity_of(arena.link.keys, roles)
        self._source = source
        self._timeout_s = timeout_s
        self._queue: deque[tuple[str, bytes]] = deque(maxlen=QUEUE)
        self._publishers: dict[str, Any] = {}
        self._event = -1
        self._session: Any = None
        self._token: Any = None
        self._beats: Any = None
        self._boot = 0
        self.epoch = 0
        """Raised when the site keeps another time than before."""
        self._clock = SiteClock()
        self._told: deque[tuple[bytes, int]] = deque(maxlen=16)
        self._ear: Any = None

    def __enter__(self) -> "Link":
        import zenoh

        if words := exposure((self._endpoint,), "" if self._identity is None else "keys"):
            print(words, file=sys.stderr, flush=True)
        try:
            settings = network.client_config(self._endpoint, self._timeout_s, self._identity)
            self._session = open_session(settings)
        except zenoh.ZError as error:
            remedy = "start the mocap bridge"
            if self._identity is not None:
                remedy = "start the router, and see by keys list whether this certificate counts"
            raise LinkError(f"no router answers at {self._endpoint} ({error}); {remedy}") from None
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._token = self._session.liveliness().declare_token(self.keys.presence(self._source))
        return self

    def __exit__(self, *exception: object) -> None:
        self._session.close()
        os.close(self._event)
        self._event = -1

    def subscribe(self, keys: Iterable[str]) -> None:
        """Queue what arrives on these keys."""
        for key in keys:
            self._session.declare_subscriber(key, self._store)

    def _store(self, sample: Any) -> None:
        self._queue.append((str(sample.key_expr), sample.payload.to_bytes()))
        if self._event >= 0:
            os.eventfd_write(self._event, 1)

    def publish(self, key: str, message: Message, channel: str) -> None:
        """Put one message with the quality of service of its channel (:data:`contract.network.QOS`).

        An order names the station's session that is heard now; the first one waits for that, at most ``HEARD_S``.
        """
        if isinstance(message, OrderRequest):
            message = replace(message, station=self.station())
        speaker = self._publishers.get(key)
        if speaker is None:
            speaker = self._publishers[key] = publisher(self._session, key, channel)
        speaker.put(encode(message))

    def station(self) -> int:
        """Boot of the session whose heartbeats are heard; 0: none is. Only the first call waits for one."""
        deadline = 0.0
        if self._beats is None:
            import zenoh

            deadline = time.monotonic() + HEARD_S
            self._beats = self._session.declare_subscriber(self.keys.heartbeat, zenoh.handlers.RingChannel(1))
        while (sample := self._beats.try_recv()) is not None or (not self._boot and time.monotonic() < deadline):
            if sample is None:
                time.sleep(0.005)
                continue
            with contextlib.suppress(WireError):
                self._boot = decode(StationHeartbeat, sample.payload.to_bytes()).boot
        return self._boot

    def now_ns(self) -> int:
        """Site time. The first call waits for the motion-capture bridge to tell it, at most ``TOLD_S``.

        Until then it is this computer's monotonic clock, which is right on the bridge's own computer; and when the
        site keeps another time than before, it is asked for anew.
        """
        clock = self._clock
        if self._ear is None:
            self._ear = self._session.declare_subscriber(self.keys.clock_tell(self._source), self._note_told)
            until_ns = time.monotonic_ns() + round(TOLD_S * 1e9)
            while not clock.ready and time.monotonic_ns() < until_ns:
                self._ask(time.monotonic_ns())
                time.sleep(0.005)
        local_ns = time.monotonic_ns()
        if self._told or clock.due(local_ns):
            self._ask(local_ns)
        if clock.lost:
            clock = self._clock = SiteClock()
            self.epoch += 1
        return clock.ns(local_ns)

    def stamp_ns(self) -> int:
        """Site time as :meth:`now_ns` last knew it; asks nobody, and may be called from any thread."""
        return self._clock.ns(time.monotonic_ns())

    def _note_told(self, sample: Any) -> None:
        self._told.append((sample.payload.to_bytes(), time.monotonic_ns()))

    def _ask(self, local_ns: int) -> None:
        while self._told:
            payload, heard_ns = self._told.popleft()
            with contextlib.suppress(WireError):
                told = decode(ClockTell, payload)
                self._clock.hear(told.asked_ns, told.told_ns, heard_ns)
        if self._clock.due(local_ns):
            asked = ClockAsk(asked_ns=self._clock.ask(local_ns))
            self.publish(self.keys.clock_ask(self._source), asked, "clock_ask")

    def wait(self, timeout_s: float) -> None:
        """Until something has arrived, at most ``timeout_s``."""
        select.select([self._event], [], [], max(0.0, timeout_s))

    def drain(self) -> list[tuple[str, Message]]:
        """Everything that has arrived, decoded; what does not decode is counted."""
        try:
            os.eventfd_read(self._event)
        except BlockingIOError:
            return []
        messages = []
        while self._queue:
            key, payload = self._queue.popleft()
            kind = self.keys.kind(key)
            try:
                if kind is not None:
                    messages.append((key, decode(kind, payload)))
            except WireError:
                self.refused += 1
        return messages
