"""A run folder's files, as far as they are named or written from elsewhere, too."""

import os
from pathlib import Path

RECORDING = "run.mcap"


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    partial = path.with_name(path.name + ".part")
    partial.write_bytes(content)
    os.replace(partial, path)
