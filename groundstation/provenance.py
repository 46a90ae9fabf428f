"""Where a run's software came from: git revision, changes on top of it, package versions."""

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("ahdc-fieldkit", "eclipse-zenoh", "mcap", "msgspec", "numpy", "pyserial", "python-can")
MAX_DIFF_BYTES = 1 << 20


def _git(*arguments: str) -> str | None:
    """Output of git in the checkout this package lies in; None without git or a checkout of ours."""
    try:
        done = subprocess.run(
            ["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, timeout=5.0, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout


def _is_checkout() -> bool:
    return _git("ls-files", "--error-unmatch", "groundstation/provenance.py") is not None


def software() -> dict[str, str]:
    """Versions by name; ``git_revision`` and ``git_dirty`` where it runs from a checkout."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    if _is_checkout():
        found["git_revision"] = (_git("rev-parse", "HEAD") or "").strip()
        found["git_dirty"] = "true" if (_git("status", "--porcelain", "--untracked-files=no") or "") else "false"
    return found


def files() -> dict[str, bytes]:
    """Lock file and changes on top of the revision, by name, where it runs from a checkout."""
    found: dict[str, bytes] = {}
    lock = ROOT / "requirements.lock"
    if lock.is_file():
        found["requirements.lock"] = lock.read_bytes()
    changes = (_git("diff", "HEAD") or "").encode() if _is_checkout() else b""
    if changes:
        found["changes.diff"] = changes[:MAX_DIFF_BYTES]
    return found
