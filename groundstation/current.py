"""Which arena is running on this machine, so that ``stop`` needs no argument in a hurry."""

import os
from pathlib import Path

from contract.arena import Arena, load


class NoArenaError(ValueError):
    """Neither a file was named nor is a session known."""


def state_folder() -> Path:
    """Where this user's stations keep what outlives them; systemd's StateDirectory where there is one."""
    kept = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(kept) if kept else Path(state) / "ahdc"


def _note() -> Path:
    return state_folder() / "arena"


def remember(config: Path) -> None:
    """Note the arena file of the session that starts now; a home that cannot be written is no reason to fail."""
    try:
        _note().parent.mkdir(parents=True, exist_ok=True)
        _note().write_text(str(config.resolve()), encoding="utf-8")
    except OSError:
        return


def recall() -> Path | None:
    """The arena file of the session started last, if it still exists."""
    try:
        config = Path(_note().read_text(encoding="utf-8").strip())
    except OSError:
        return None
    return config if config.is_file() else None


def arena_of(asked: Path | None) -> Arena:
    """The arena of the file asked for, else of the session started last.

    :raises NoArenaError: there is neither.
    :raises contract.arena.ArenaError: the file has faults.
    """
    path = asked or recall()
    if path is None:
        raise NoArenaError("which arena? --arena FILE (no session was started on this machine)")
    return load(path)
