"""What a robot tells the service manager that runs it: ready, alive, how it is. Silent where there is none."""

import ctypes
import gc
import os
import socket
from collections.abc import Mapping

from onboard.vitals import MOTORS_ON, Vitals, stale

STATUS_EVERY_NS = 1_000_000_000
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4


def lock_memory() -> bool:
    """Keep every page in memory that has been used once; False where ``LimitMEMLOCK`` forbids it (mlockall(2))."""
    libc = ctypes.CDLL(None, use_errno=True)
    return bool(libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0)


def quiet() -> None:
    """Keep the garbage collector out of the loop: what lives now is never looked at again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


class Service:
    """The service manager's ear: one datagram a message (sd_notify(3)).

    :param environment: ``NOTIFY_SOCKET`` and ``WATCHDOG_USEC`` as systemd sets them; without the first nothing
        is said and nothing costs anything.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if address else None
        self._pet_every_ns = int(environment.get("WATCHDOG_USEC", "0")) * 1000 // 4
        self._petted_ns = 0
        self._told_ns = 0
        self._powered_ns = 0
        self._words = ""
        self._ending = False
        self.release = environment.get("AHDC_RELEASE", "")

    @property
    def managed(self) -> bool:
        """Whether a service manager runs this process."""
        return self._socket is not None

    def waiting(self, text: str) -> None:
        """Not ready yet, and why."""
        self._say(f"STATUS={self._signed(text)}")

    def ready(self, text: str) -> None:
        """Up and working."""
        self._say(f"READY=1\nSTATUS={self._signed(text)}")

    def beat(self, vitals: Vitals, now_ns: int) -> str:
        """To be called by every turn of the loop; says why, the first time the watchdog is not petted."""
        if self._socket is None:
            return ""
        if vitals.run not in MOTORS_ON or not self._powered_ns:
            self._powered_ns = now_ns
        if now_ns - self._petted_ns < self._pet_every_ns:
            return ""
        why = stale(vitals, now_ns, self._powered_ns)
        if why:
            first, self._ending = not self._ending, True
            return why if first else ""
        self._petted_ns, self._ending = now_ns, False
        words = f"{vitals.run}: {vitals.reason}" if vitals.reason else vitals.run
        if words != self._words or now_ns - self._told_ns > STATUS_EVERY_NS:
            self._words, self._told_ns = words, now_ns
            self._say(f"WATCHDOG=1\nSTATUS={self._signed(words)}")
        else:
            self._say("WATCHDOG=1")
        return ""

    def stopping(self) -> None:
        """On the way out, by order."""
        self._say("STOPPING=1")

    def _signed(self, text: str) -> str:
        line = " ".join(text.split())
        return f"{line} [{self.release}]" if self.release else line

    def _say(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), socket.MSG_DONTWAIT, self._address)
        except OSError:
            return
