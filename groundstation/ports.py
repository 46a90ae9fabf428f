"""Ports of the loopback for what starts in a moment."""

import contextlib
import random
import socket
from collections.abc import Sequence

OURS = range(20_000, 32_000)
"""Below those that systems give to sockets that ask for none (Linux: 32768 and above): between the choice of a port and
its opening nobody comes upon it by chance, as every connection that somebody opens meanwhile could."""
TRIES = 50


def free_ports(*kinds: socket.SocketKind) -> list[int]:
    """A port of each kind that is free now; no two are the same."""
    draw = random.SystemRandom()
    with contextlib.ExitStack() as stack:
        taken: list[int] = []
        for kind in kinds:
            entry = stack.enter_context(socket.socket(socket.AF_INET, kind))
            taken.append(_bind(entry, [port for port in draw.sample(OURS, TRIES) if port not in taken]))
        return taken


def _bind(entry: socket.socket, ports: Sequence[int]) -> int:
    for port in ports:
        with contextlib.suppress(OSError):
            entry.bind(("127.0.0.1", port))
            return port
    entry.bind(("127.0.0.1", 0))
    return int(entry.getsockname()[1])
