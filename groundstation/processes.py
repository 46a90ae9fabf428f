"""Child processes that never outlive their launcher, and end in order.

The kernel kills a child when its launcher dies (``PR_SET_PDEATHSIG``), set between fork and exec
with a recheck of the parent, so there is no moment in which a child can be orphaned. Children have
their own process group: Ctrl-C reaches the launcher alone, which then ends them.
"""

import contextlib
import ctypes
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO

PR_SET_PDEATHSIG = 1
TERM_WAIT_S = 2.0

_libc = ctypes.CDLL(None, use_errno=True)


def _die_with(parent: int, niceness: int) -> None:
    """Runs in the child between fork and exec."""
    _libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    with contextlib.suppress(OSError):
        os.nice(niceness)
    if os.getppid() != parent:
        os._exit(1)
    signal.pthread_sigmask(signal.SIG_SETMASK, set())


def kin(pid: int) -> list[int]:
    """The processes that the main thread of a process has started and not yet taken leave of; none if it is no more."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


class ChildError(RuntimeError):
    """A process did not become ready, or ended when it should not have."""


class Child:
    """One process: its name, its command, and a log file with all it writes to stderr.

    :param niceness: added to this process's own; a negative one needs a privilege and is else left off.
    :param inside: a command that becomes the process, such as ``ip netns exec NAME``.
    """

    def __init__(
        self, name: str, module: str, arguments: list[str], log: Path, niceness: int = 0, inside: Sequence[str] = ()
    ) -> None:
        self.name = name
        self.log = log
        self.ready = False
        self.ends = 0
        """Processes with a higher number end later."""
        self._text = b""
        parent = os.getpid()
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        with log.open("wb") as sink:
            self._process = subprocess.Popen(
                [*inside, sys.executable, "-m", module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=sink,
                env=environment,
                process_group=0,
                preexec_fn=lambda: _die_with(parent, niceness),
            )
        assert self._process.stdout is not None
        self._stdout: IO[bytes] = self._process.stdout
        os.set_blocking(self._stdout.fileno(), False)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def code(self) -> int | None:
        """Exit code, None while it runs."""
        return self._process.poll()

    def fileno(self) -> int:
        return self._stdout.fileno()

    def listen(self) -> bool:
        """Drain stdout; True at its end. Notices the READY line."""
        with contextlib.suppress(BlockingIOError):
            while chunk := os.read(self._stdout.fileno(), 65536):
                self._text = (self._text + chunk)[-4096:]
                self.ready = self.ready or b"READY" in self._text
            return True
        return False

    def last_words(self) -> str:
        """The end of its log, for an error message."""
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return "\n".join(lines[-12:])

    def signal(self, number: int) -> None:
        if self.code is None:
            self._process.send_signal(number)

    def signal_kin(self, number: int) -> None:
        """To those that it has started: the bridge's router."""
        for pid in kin(self.pid) if self.code is None else ():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)

    def wait(self, timeout_s: float) -> bool:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(max(0.0, timeout_s))
        return self.code is not None

    def close(self) -> None:
        self._stdout.close()


class Family:
    """The children of one launcher. Leaving the ``with`` block ends them all, whatever happened."""

    def __init__(self) -> None:
        self.children: list[Child] = []

    def __enter__(self) -> "Family":
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()

    def start(
        self,
        name: str,
        module: str,
        arguments: list[str],
        log: Path,
        niceness: int = 0,
        ends: int = 0,
        inside: Sequence[str] = (),
    ) -> Child:
        """One more process; ``ends``: those with a higher number end after all with a lower one."""
        child = Child(name, module, arguments, log, niceness, inside)
        child.ends = ends
        self.children.append(child)
        return child

    def wait_ready(self, timeout_s: float) -> None:
        """Until every child has said READY.

        :raises ChildError: naming the child, with the end of its log.
        """
        poll = select.poll()
        waiting = {child.fileno(): child for child in self.children if not child.ready}
        for number in waiting:
            poll.register(number, select.POLLIN)
        deadline = time.monotonic() + timeout_s
        while waiting:
            left_s = deadline - time.monotonic()
            if left_s <= 0:
                names = ", ".join(child.name for child in waiting.values())
                words = "\n".join(child.last_words() for child in waiting.values())
                raise ChildError(f"not ready after {timeout_s:g} s: {names}\n{words}")
            for number, _ in poll.poll(left_s * 1000):
                child = waiting[number]
                ended = child.listen()
                if child.ready:
                    poll.unregister(number)
                    del waiting[number]
                elif ended:
                    child.wait(1.0)
                    raise ChildError(f"{child.name} ended with code {child.code} at its start\n{child.last_words()}")

    def check(self) -> None:
        """:raises ChildError: a child has ended."""
        for child in self.children:
            child.listen()
            if child.code is not None:
                raise ChildError(f"{child.name} ended with code {child.code}\n{child.last_words()}")

    def child(self, name: str) -> Child:
        """The process of that name.

        :raises KeyError: there is none.
        """
        return {child.name: child for child in self.children}[name]

    def forget(self, name: str) -> None:
        """Kill a process, if it lives, and have it no longer in the family.

        :raises KeyError: there is none.
        """
        child = self.child(name)
        child.signal(signal.SIGKILL)
        child.wait(TERM_WAIT_S)
        child.close()
        self.children.remove(child)

    def end(self) -> dict[str, int | None]:
        """SIGTERM to one group after the other, in the order of ``ends``; what is left of a group is killed.

        Returns the exit code of every child, by name.
        """
        codes: dict[str, int | None] = {}
        for number in sorted({child.ends for child in self.children}):
            group = [child for child in self.children if child.ends == number]
            for child in group:
                child.signal(signal.SIGTERM)
            deadline = time.monotonic() + TERM_WAIT_S
            for child in group:
                if not child.wait(deadline - time.monotonic()):
                    child.signal(signal.SIGKILL)
                    child.wait(1.0)
                codes[child.name] = child.code
                child.close()
        self.children.clear()
        return codes
