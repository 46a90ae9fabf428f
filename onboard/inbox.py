"""What has arrived and was not read yet: the newest payload of every key, most urgent first.

A Zenoh callback only stores bytes and wakes the loop; it never decodes and never blocks, so a slow
control step cannot delay a stop that arrives behind other traffic.
"""

import contextlib
import os
from collections.abc import Mapping
from functools import lru_cache

from contract.codec import WireError, decode
from contract.keys import Keys
from contract.messages import Message


class Inbox:
    """Latest-wins slots. ``put`` may be called from any thread, the rest from the loop only."""

    def __init__(self, urgency: Mapping[str, int]) -> None:
        """:param urgency: key to rank; the smallest is taken first."""
        self._slots: dict[str, bytes] = {}
        self._urgency = dict(urgency)
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def fileno(self) -> int:
        """Readable while something waits, and after :meth:`wake`."""
        return self._event

    def put(self, key: str, payload: bytes) -> None:
        self._slots[key] = payload
        self.wake()

    def wake(self) -> None:
        os.eventfd_write(self._event, 1)

    def take(self) -> list[tuple[str, bytes]]:
        """Everything that waits, most urgent first; nothing that arrives meanwhile is lost."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._event)
        slots = self._slots
        waiting = list(slots)
        if len(waiting) > 1:
            waiting.sort(key=lambda key: self._urgency.get(key, len(self._urgency)))
        return [(key, slots.pop(key)) for key in waiting]

    def close(self) -> None:
        os.close(self._event)


@lru_cache(maxsize=512)
def _route(keys: Keys, key: str) -> tuple[type[Message] | None, str | None]:
    return keys.kind(key), keys.robot_of(key)


def read(keys: Keys, key: str, payload: bytes) -> Message:
    """The message a key carries, its sender being the one the key names.

    :raises WireError: not a key of ours, not the message it carries, or another robot's name in it.
    """
    kind, robot = _route(keys, key)
    if kind is None:
        raise WireError("key", f"{key} is not a key of site {keys.site}")
    message = decode(kind, payload)
    named = getattr(message, "robot", None)
    if named is not None and named != robot:
        raise WireError(kind.__name__, f"robot {named} on the key of {robot}")
    return message
