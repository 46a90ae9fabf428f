"""Ports of the loopback for what starts in a moment."""

import errno
import itertools
import random
import socket

OURS = range(20_000, 32_000)
"""Below those that systems give to sockets that ask for none (Linux: 32768 and above): between the choice of a port and
its opening nobody comes upon it by chance, as every connection that somebody opens meanwhile could."""


def free_ports(count: int) -> list[int]:
    """So many different ports that are free now, for TCP and UDP both."""
    free = (port for port in random.SystemRandom().sample(OURS, len(OURS)) if _is_free(port))
    found = list(itertools.islice(free, count))
    if len(found) < count:
        raise OSError(errno.EADDRNOTAVAIL, f"no {count} free ports from {OURS[0]} to {OURS[-1]}")
    return found


def _is_free(port: int) -> bool:
    with socket.socket(type=socket.SOCK_STREAM) as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
        try:
            tcp.bind(("127.0.0.1", port))
            udp.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
