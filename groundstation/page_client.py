"""One browser, as the page's server sees it."""

import asyncio
from collections import deque
from typing import Any

import msgspec


class Client:
    """One browser: a slot for the newest whole view, one for the newest poses since, a short queue for answers."""

    def __init__(self) -> None:
        self.answers: deque[bytes] = deque(maxlen=64)
        self.cloud_version = -1
        self._view = b""
        self._poses = b""
        self._wake = asyncio.Event()

    def offer(self, view: bytes) -> None:
        """The newest whole view; what has not been taken is replaced."""
        self._view, self._poses = view, b""
        self._wake.set()

    def move(self, poses: bytes) -> None:
        """The newest poses; a whole view that has not been taken stays and goes first."""
        self._poses = poses
        self._wake.set()

    def answer(self, message: dict[str, Any]) -> None:
        self.answers.append(msgspec.json.encode(message))
        self._wake.set()

    async def next(self) -> list[bytes]:
        """Answers, the newest whole view and the newest poses, once there is something."""
        await self._wake.wait()
        self._wake.clear()
        out = [*self.answers, *filter(None, (self._view, self._poses))]
        self.answers.clear()
        self._view = self._poses = b""
        return out
