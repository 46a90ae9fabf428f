"""Memory in a process that has Zenoh's threads in it."""

import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8
"""Of glibc's ``mallopt``, malloc.h."""
LARGE_BYTES = 64 << 10
"""What is larger is given back as soon as it is free, and so is as much free memory at the end of a heap."""
ARENAS = 2
"""The main thread's own, so that a control loop waits for no other, and one for everybody else."""


def share_arenas() -> None:
    """Let Zenoh's threads share one heap; call before they begin. Without glibc nothing happens.

    With a heap each, what a link needs for a moment when it opens is kept in one after the other: over QUIC a process
    grew by a third in twenty reconnections, and by a sixth with one heap, after the first four.
    """
    _set({M_ARENA_MAX: ARENAS})


def give_back() -> None:
    """Keep no memory for the next burst; for a process that takes much at once, as after it has stood still.

    By itself glibc keeps ever larger blocks once such have been freed: a recorder that was frozen again and again grew
    from 46 to 52 MB within a minute, by fits and starts, and so is at 47 from the first time on.
    """
    _set({M_MMAP_THRESHOLD: LARGE_BYTES, M_TRIM_THRESHOLD: LARGE_BYTES})


def _set(options: dict[int, int]) -> None:
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for option, value in options.items():
            mallopt(option, value)
