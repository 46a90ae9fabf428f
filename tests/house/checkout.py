"""The checkout the house tests read: its root, its rooms, its files."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("contract", "onboard", "drivers", "mocap_bridge", "groundstation")


def tracked(*patterns: str) -> list[Path]:
    """Files under version control that match the patterns (git's), in order and present on disk."""
    command = ["git", "-c", "safe.directory=*", "ls-files", "-z", "--", *patterns]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in sorted(listed.stdout.split("\0")) if name and (ROOT / name).is_file()]
