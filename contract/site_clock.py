"""Site time on a computer that does not keep it: its own monotonic clock and a measured offset. Pure.

Site time is the monotonic clock of the motion-capture bridge's computer, where the poses are stamped. Everybody else
asks it for the time (:class:`contract.messages.ClockAsk`) and is told (``ClockTell``): an answer bounds the offset by
half its round trip, however unequal the two ways. The tightest of the last answers counts, each loosened by what two
quartz clocks may drift apart since. Where that bound leaves room for no offset at all there is none: on the bridge's
own computer site time is the monotonic clock itself, to the nanosecond.

The offset never jumps once it is known, and site time never runs backwards: changes are slewed. An answer that lies
further away than :data:`JUMP_NS` means another clock (the bridge's computer has started anew): :attr:`SiteClock.lost`.
"""

from collections import deque
from typing import NamedTuple

MAX_DRIFT = 100e-6
"""Of two quartz clocks against one another."""
MAX_SLEW = 2e-3
"""Rate of change of the offset."""
JUMP_NS = 50_000_000
ANSWERS = 16
"""Remembered."""
FIRST = 4
"""Answers that suffice to begin."""
HURRY_NS = 20_000_000
PERIOD_NS = 1_000_000_000
"""Between questions, until the first answers are there and afterwards."""
UNKNOWN_NS = 1 << 62


class _Answer(NamedTuple):
    local_ns: int
    offset_ns: int
    half_ns: int

    def bound_ns(self, local_ns: int) -> int:
        return self.half_ns + int((local_ns - self.local_ns) * MAX_DRIFT)


class SiteClock:
    """Ask when :meth:`due`, :meth:`hear` what comes back, and read site time by :meth:`ns`."""

    def __init__(self) -> None:
        self._answers: deque[_Answer] = deque(maxlen=ANSWERS)
        self._asked: deque[int] = deque(maxlen=ANSWERS)
        self._due_ns = 0
        self._since_ns = 0
        self._base_ns = 0
        self._slew = 0.0
        self._target_ns = 0
        self.lost = False
        """The site keeps another time than before: begin anew, with wheels at rest."""

    @property
    def ready(self) -> bool:
        """Whether enough answers have come to go by."""
        return len(self._answers) >= FIRST

    def due(self, local_ns: int) -> bool:
        """Whether to ask now."""
        return local_ns >= self._due_ns

    def ask(self, local_ns: int) -> int:
        """Note a question; what goes into its ``asked_ns``."""
        self._asked.append(local_ns)
        self._due_ns = local_ns + (PERIOD_NS if self.ready else HURRY_NS)
        return local_ns

    def hear(self, asked_ns: int, told_ns: int, local_ns: int) -> None:
        """The answer to the question of ``asked_ns``, come at ``local_ns``; one to no question of ours is ignored."""
        if asked_ns not in self._asked or local_ns < asked_ns:
            return
        self._asked.remove(asked_ns)
        half_ns = (local_ns - asked_ns + 1) // 2
        answer = _Answer(local_ns, told_ns - asked_ns - half_ns, half_ns)
        before = self.ready
        if before and abs(answer.offset_ns - self._offset(local_ns)) > half_ns + JUMP_NS:
            self.lost = True
            return
        self._answers.append(answer)
        best = min(self._answers, key=lambda entry: entry.bound_ns(local_ns))
        target_ns = 0 if abs(best.offset_ns) <= best.bound_ns(local_ns) else best.offset_ns
        now_ns = self._offset(local_ns) if before else target_ns
        self._since_ns, self._base_ns, self._target_ns = local_ns, now_ns, target_ns
        self._slew = MAX_SLEW if target_ns > now_ns else -MAX_SLEW

    def _offset(self, local_ns: int) -> int:
        if self._base_ns == self._target_ns:
            return self._target_ns
        step_ns = int((local_ns - self._since_ns) * self._slew)
        wanted_ns = self._target_ns - self._base_ns
        return self._target_ns if abs(step_ns) >= abs(wanted_ns) else self._base_ns + step_ns

    def ns(self, local_ns: int) -> int:
        """Site time at a time of the own monotonic clock that is not before the last answer."""
        return local_ns + (self._target_ns if self._base_ns == self._target_ns else self._offset(local_ns))

    def error_ns(self, local_ns: int) -> int:
        """How far :meth:`ns` may be off, what is still to be slewed included; huge before the first answers."""
        if not self.ready:
            return UNKNOWN_NS
        bound_ns = min(entry.bound_ns(local_ns) for entry in self._answers)
        return bound_ns + abs(self._target_ns - self._offset(local_ns))
