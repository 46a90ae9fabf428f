"""What a station that starts again has to know of the mission under way: its name, its targets, when it began.

Robots know which targets are occupied and say so; they do not say where the targets are. So the session notes them
on every change, and a session that starts within the hour, on the same boot of the machine and with the same arena
file, goes on with them. It starts nobody: robots are disarmed by a new station and wait to be armed and started.
"""

import contextlib
import os
from pathlib import Path

import msgspec

from contract.messages import TargetCloud
from groundstation.current import state_folder

WITHIN_NS = 3600 * 1_000_000_000
FORGET_S = 7 * 86_400.0
AGAIN_NS = 30_000_000_000
"""A mission under way is noted this often although nothing has changed."""
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Note(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A mission as one session leaves it to the next. Times are site time."""

    boot_id: str
    """Of the machine: site time begins anew with each."""
    noted_ns: int
    cloud: TargetCloud
    started_ns: int = 0
    """Of a mission under way; 0: none is."""


def boot_id() -> str:
    """Of this machine; '' where the kernel does not say."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


class Notebook:
    """The note of one arena file on this machine. Whatever the disk does, a session goes on."""

    def __init__(self, arena_hash: str) -> None:
        self.path = state_folder() / f"mission-{arena_hash}.json"
        self._boot_id = boot_id()
        self._written: tuple[object, ...] = ()
        self._due_ns = 0

    def read(self, now_ns: int) -> Note | None:
        """The mission to go on with; None where there is none, or it is too old or of another boot."""
        try:
            note = msgspec.json.decode(self.path.read_bytes(), type=Note)
        except (OSError, msgspec.DecodeError):
            return None
        fresh = 0 <= now_ns - note.noted_ns <= WITHIN_NS
        return note if fresh and note.boot_id == self._boot_id else None

    def write(self, cloud: TargetCloud, started_ns: int, completed: bool, now_ns: int) -> None:
        """Note it where something has changed or the last note is old; a completed mission is forgotten."""
        facts = (cloud, started_ns, completed)
        if facts == self._written and now_ns < self._due_ns:
            return
        self._written, self._due_ns = facts, now_ns + AGAIN_NS
        if completed:
            self.forget()
            return
        note = Note(boot_id=self._boot_id, noted_ns=now_ns, cloud=cloud, started_ns=started_ns)
        partial = self.path.with_suffix(f".{os.getpid()}.part")
        with contextlib.suppress(OSError):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_bytes(msgspec.json.encode(note))
            if not self.path.exists():
                self._clear_out(partial.stat().st_mtime - FORGET_S)
            os.replace(partial, self.path)

    def forget(self) -> None:
        """No mission to go on with."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)

    def _clear_out(self, oldest_s: float) -> None:
        """Notes of arena files that nobody has used for a week."""
        for path in self.path.parent.glob("mission-*.json"):
            if path.stat().st_mtime < oldest_s:
                path.unlink(missing_ok=True)
