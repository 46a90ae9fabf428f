"""The site's clock: the bridge's computer stamps the poses, so its monotonic clock is site time. Tells whoever asks."""

import time
from collections import Counter

import zenoh

from contract.codec import WireError, decode, encode
from contract.keys import Keys
from contract.messages import ClockAsk, ClockTell
from mocap_bridge.network import publisher

MOST = 250
"""Askers that are remembered; a site has a tenth of that."""


class Timekeeper:
    """Answers on Zenoh's own threads: neither poses nor health wait for it, and it for neither."""

    def __init__(self, keys: Keys, session: zenoh.Session) -> None:
        self.counters: Counter[str] = Counter()
        """What was refused, by name."""
        self._keys = keys
        self._session = session
        self._speakers: dict[str, zenoh.Publisher] = {}
        self._ear = session.declare_subscriber(f"{keys.site}/clock/ask/*", self._answer)

    def _answer(self, sample: zenoh.Sample) -> None:
        told_ns = time.monotonic_ns()
        source = str(sample.key_expr).rpartition("/")[2]
        try:
            asked_ns = decode(ClockAsk, sample.payload.to_bytes()).asked_ns
            key = self._keys.clock_tell(source)
        except (WireError, ValueError) as error:
            self.counters[type(error).__name__] += 1
            return
        if source not in self._speakers:
            if len(self._speakers) >= MOST:
                self._speakers.clear()
            self._speakers[source] = publisher(self._session, key, "clock_tell")
        self._speakers[source].put(encode(ClockTell(asked_ns=asked_ns, told_ns=told_ns)))
