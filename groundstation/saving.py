"""A lockstep run as a run folder, laid out like a real mission's: recording, arena file, metrics, manifest.

Times in it are virtual, and nothing in it depends on when or where it was made but the software's name: the same
run gives the same bytes.
"""

import os
from pathlib import Path
from types import TracebackType

from contract.arena import Arena, digest
from contract.keys import Keys
from groundstation import files, runfolder
from groundstation.provenance import software
from groundstation.recording import CONFIG
from groundstation.runwriter import RunWriter, Sink

COMMIT_NS = 1_000_000_000


class SavedRun:
    """A run folder that is written while the run is played.

    :raises FileExistsError: the folder holds a recording already.
    """

    def __init__(self, arena: Arena, folder: Path, name: str) -> None:
        from groundstation.rig import write_config

        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._descriptor = os.open(folder / files.RECORDING, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        write_config(arena, folder / CONFIG)
        self._writer = RunWriter(Sink(self._descriptor), Keys(arena.arena.name))
        about = {
            "run_id": name,
            "started": "virtual time",
            "place": "Lockstep simulation",
            "arena": arena.arena.name,
            "arena_hash": digest(arena),
            "profile": arena.control.profile,
            "seed": str(arena.targets.seed),
            "robots": " ".join(arena.robots),
        }
        self._writer.describe({"run": about, "software": software()}, {CONFIG: (folder / CONFIG).read_bytes()}, 0)
        self._commit_ns = COMMIT_NS

    def hear(self, key: str, payload: bytes, now_ns: int) -> None:
        """Write what was published."""
        self._writer.write(key, payload, now_ns)
        if now_ns >= self._commit_ns:
            self._commit_ns = now_ns + COMMIT_NS
            self._writer.commit()

    def __enter__(self) -> "SavedRun":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.finish({"recorder": {"messages": str(self._writer.messages), "dropped": "0"}})
        os.close(self._descriptor)
        if kind is None:
            found = runfolder.read(self._folder)
            runfolder.write_metrics(found)
            runfolder.write_manifest(found)
