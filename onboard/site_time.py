"""This computer's way to the site's time: questions to the motion-capture bridge, answers into a clock."""

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from contract.codec import WireError, decode, encode
from contract.keys import Keys
from contract.messages import ClockAsk, ClockTell
from contract.site_clock import HURRY_NS, SiteClock
from contract.voice import say
from onboard.network import publisher

SAY_EVERY_NS = 5_000_000_000


class SiteTime:
    """Site time of one process; Zenoh's threads note what arrives, :meth:`turn` takes it in.

    :param tolerance_ns: with a larger error the time is not :attr:`sure`.
    """

    def __init__(self, session: Any, keys: Keys, source: str, tolerance_ns: int) -> None:
        import zenoh

        self.clock = SiteClock()
        self._source = source
        self._tolerance_ns = tolerance_ns
        self._told: deque[tuple[bytes, int]] = deque(maxlen=16)
        note: Any = zenoh.handlers.Callback(
            lambda sample: self._told.append((sample.payload.to_bytes(), time.monotonic_ns())), indirect=False
        )
        self._ear = session.declare_subscriber(keys.clock_tell(source), note)
        self._speaker = publisher(session, keys.clock_ask(source), "clock_ask")
        self.sure = False
        """Whether stamps can be judged: the error is within the tolerance, and the clock is the one it was."""

    def now_ns(self) -> int:
        return self.clock.ns(time.monotonic_ns())

    def turn(self) -> None:
        """Take in what was answered, ask when it is time to. Once a control period is plenty."""
        clock, local_ns = self.clock, time.monotonic_ns()
        while self._told:
            payload, heard_ns = self._told.popleft()
            try:
                told = decode(ClockTell, payload)
            except WireError:
                continue
            clock.hear(told.asked_ns, told.told_ns, heard_ns)
            self._judge(local_ns)
        if clock.due(local_ns):
            self._judge(local_ns)
            self._speaker.put(encode(ClockAsk(asked_ns=clock.ask(local_ns))))

    def _judge(self, local_ns: int) -> None:
        self.sure = not self.clock.lost and self.clock.error_ns(local_ns) <= self._tolerance_ns

    def wait(self, stopping: Callable[[], bool]) -> None:
        """Until the first answers are there, or ``stopping()``."""
        say_ns = time.monotonic_ns() + SAY_EVERY_NS
        while not self.clock.ready and not stopping():
            self.turn()
            time.sleep(HURRY_NS / 4e9)
            if time.monotonic_ns() > say_ns:
                say_ns += SAY_EVERY_NS
                words = "waits for the site's time: does the motion-capture bridge run?"
                say(f"{self._source}: {words}")
