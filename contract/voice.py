"""What a process says to whoever watches it; where nobody can take it, it is lost, and nothing else happens."""

import contextlib
import sys
from typing import TextIO


def say(text: str, stream: TextIO | None = None) -> None:
    """A line on standard error, or on ``stream``, at once. A full disk, a closed terminal or pipe is no error."""
    with contextlib.suppress(OSError, ValueError):
        print(text, file=sys.stderr if stream is None else stream, flush=True)
