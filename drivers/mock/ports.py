"""Pseudo-terminals: the computer's end opens like any serial device, under a stable name."""

import contextlib
import os
import tty
from collections import Counter
from pathlib import Path

from drivers.ports import CHUNK_BYTES


class PtyPort:
    """One pty. Writes never wait: what the reader does not drain is dropped and counted."""

    def __init__(self, link: Path | None = None) -> None:
        self.link = link
        """A symbolic link to the pty, like a /dev/serial/by-id name."""
        self.counters: Counter[str] = Counter()
        self._master = -1
        self._slave = -1

    @property
    def path(self) -> str:
        """What the driver opens."""
        return str(self.link) if self.link is not None else os.ttyname(self._slave)

    @property
    def plugged(self) -> bool:
        return self._master >= 0

    def plug(self) -> None:
        """Create the pty (again).

        :raises FileExistsError: the link's name belongs to something else, such as a real device.
        """
        if self.plugged:
            return
        if self.link is not None and not _replaceable(self.link):
            raise FileExistsError(f"{self.link} is not a link to a pty; remove it or name another path")
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        if self.link is not None:
            self.link.parent.mkdir(parents=True, exist_ok=True)
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """The device is gone: reads and writes at the other end fail from now on."""
        if not self.plugged:
            return
        if self.link is not None:
            with contextlib.suppress(OSError):
                self.link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def fileno(self) -> int:
        return self._master

    def read(self) -> bytes:
        if not self.plugged:
            return b""
        try:
            return os.read(self._master, CHUNK_BYTES)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> None:
        if not data or not self.plugged:
            return
        try:
            sent = os.write(self._master, data)
        except (BlockingIOError, OSError):
            sent = 0
        if sent < len(data):
            self.counters["overrun_bytes"] += len(data) - sent


def _replaceable(link: Path) -> bool:
    """Nothing there, or a link to a pty of an earlier run."""
    if link.is_symlink():
        return str(link.readlink()).startswith("/dev/pts/")
    return not link.exists()
