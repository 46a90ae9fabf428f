"""One browser, as the page's server sees it."""

import asyncio
from collections import deque
from typing import Any

import msgspec


class Client:
    """One browser: a slot for the newest view, a short queue for answers."""

    def __init__(self) -> None:
        self.answers: deque[bytes] = deque(maxlen=64)
        self.cloud_version = -1
        self._view = b""
        self._wake = asyncio.Event()

    def offer(self, view: bytes) -> None:
        """The newest view; one that has not been taken is replaced."""
        self._view = view
        self._wake.set()

    def answer(self, message: dict[str, Any]) -> None:
        self.answers.append(msgspec.json.encode(message))
        self._wake.set()

    async def next(self) -> list[bytes]:
        """Answers and the newest view, once there is something."""
        await self._wake.wait()
        self._wake.clear()
        out = list(self.answers)
        self.answers.clear()
        if self._view:
            out.append(self._view)
            self._view = b""
        return out
