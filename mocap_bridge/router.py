"""The router of a site without keys, in a process of its own: the bridge's end of it, and the process.

``python -m mocap_bridge.router ENDPOINT`` opens the router session and says READY, or else in one line why it cannot.
It leaves when its standard input ends, and where the bridge is killed, the kernel kills it, too: never left behind.
It is deaf to SIGTERM and SIGINT, so that a bridge that is told to end says its last words through it.
"""

import contextlib
import ctypes
import errno
import os
import select
import signal
import subprocess
import sys
import time
from typing import Any

from contract import network
from contract.allocator import give_back, share_arenas
from contract.voice import say

READY = "READY router"
TAKEN_WAIT_S = 2.0
"""So long an address is waited for that the router of a bridge that was killed may not have left yet."""
LOOK_S = 0.05
GIVE_BACK_S = 5.0
"""What it kept for clients that stood still is given back as often."""
LEAVE_S = 0.5
"""The process has this long to take leave of its clients."""
CLOSE_S = 1.0
"""After this it is killed."""
PACE_S = 1.0
"""It begins anew at most once in this time."""
PR_SET_PDEATHSIG = 1
_DEAF_TO = {signal.SIGTERM, signal.SIGINT}


class RouterError(RuntimeError):
    """The router cannot begin, in Zenoh's words."""


class Router:
    """The process, as the bridge sees it. Call from the thread that lives as long as the bridge.

    :param endpoint: of this host, such as ``tcp/127.0.0.1:7447``.
    :raises RouterError: the address is taken, or is none.
    """

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._begin()
        assert self._process.stdout is not None
        said = self._process.stdout.readline().strip()
        if said != READY:
            code = self._process.wait()
            self.close()
            raise RouterError(said or f"its process ended with code {code}")

    @property
    def pid(self) -> int:
        return self._process.pid

    def tend(self) -> None:
        """Where it has ended say so and begin it anew; not waited for. Call it at least once a second.

        :raises RouterError: its address is another's now: to go on would be a second bridge on one site.
        """
        code = self._process.poll()
        if code is None or time.monotonic() < self._begun_s + PACE_S:
            return
        assert self._process.stdout is not None
        said = self._process.stdout.read().strip()
        self.close()
        if said not in ("", READY):
            raise RouterError(said)
        say(f"the router at {self._endpoint} ended with code {code}: it begins anew")
        self._begin()

    def close(self) -> None:
        """End it; returns once it has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        try:
            self._process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()

    def _begin(self) -> None:
        self._begun_s = time.monotonic()
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, _DEAF_TO)  # until it is deaf by itself
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "mocap_bridge.router", self._endpoint],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def serve(endpoint: str) -> int:
    """The process: until standard input ends; exit code 1 where the address is of no use."""
    for number in _DEAF_TO:
        signal.signal(number, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.environ.setdefault("ZENOH_RUNTIME", network.RUNTIME)
    share_arenas()
    import zenoh

    give_up_s = time.monotonic() + TAKEN_WAIT_S
    while True:
        config = zenoh.Config()
        for key, value in network.router_config(endpoint):
            config.insert_json5(key, value)
        try:
            session: Any = zenoh.open(config)
            break
        except zenoh.ZError as error:
            words = " ".join(str(error).split())
        if os.strerror(errno.EADDRINUSE) not in words or time.monotonic() > give_up_s:
            _say(words)
            return 1
        if select.select([0], [], [], LOOK_S)[0]:
            return 0
    _say(READY)
    while not select.select([0], [], [], GIVE_BACK_S)[0] or os.read(0, 4096):
        give_back()
    signal.setitimer(signal.ITIMER_REAL, LEAVE_S)  # which kills it
    session.close()
    return 0


def _say(words: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        os.write(1, f"{words}\n".encode())


if __name__ == "__main__":
    sys.exit(serve(sys.argv[1]))
