"""A CAN bus as a driver uses it: port errors become typed driver errors, lost writes are counted."""

import errno
from collections import Counter
from collections.abc import Callable, Sequence

from drivers.base import LinkLost, Refused
from drivers.can.frame import CanFrame
from drivers.ports import FramePort

REMEDY = "Check cable, power and adapter, then configure again"
GONE = "Plug the adapter in, then: ip link set {port} up type can bitrate <bit/s>, and configure again"
REMEDIES = {
    errno.ENETDOWN: "Bring the interface up: ip link set {port} up type can bitrate <bit/s>, then configure again",
    errno.ENODEV: GONE,
    errno.ENXIO: GONE,
    errno.ECONNRESET: "Check bitrate, wiring and termination, then: ip link set {port} down, up, and configure again",
}
"""By the errno of the port."""


class CanLine:
    """One device's view of its bus; ``take`` handles a frame and names the counter to raise, or ''."""

    def __init__(self, device: str, port: FramePort, take: Callable[[CanFrame], str]) -> None:
        self.device = device
        self.port = port
        self.counters: Counter[str] = Counter()
        self._take = take

    def open(self) -> None:
        """:raises LinkLost: with the reason."""
        try:
            self.port.open()
        except OSError as error:
            raise self._dead("open", error) from error

    def send(self, frames: Sequence[CanFrame]) -> None:
        try:
            if not self.port.send(frames):
                self.counters["send_dropped"] += 1
        except OSError as error:
            raise self._dead("send", error) from error

    def drain(self) -> None:
        """Handle every frame received."""
        try:
            frames = self.port.receive()
        except OSError as error:
            raise self._dead("receive", error) from error
        for frame in frames:
            reason = self._take(frame)
            if reason:
                self.counters[reason] += 1

    def wait_until(self, done: Callable[[], bool], timeout_s: float, feed: Sequence[CanFrame] = ()) -> bool:
        """Drain until ``done``; ``feed`` is sent every 10 ms meanwhile, which keeps a watchdog fed."""
        feed_ns = now_ns = self.port.now_ns()
        deadline_ns = now_ns + int(timeout_s * 1e9)
        while now_ns < deadline_ns and not done():
            if feed and now_ns >= feed_ns:
                feed_ns = now_ns + 10_000_000
                self.send(feed)
            self.port.wait(min((deadline_ns - now_ns) * 1e-9, 0.01))
            self.drain()
            now_ns = self.port.now_ns()
        return done()

    def total(self) -> Counter[str]:
        """All counters, the port's included."""
        self.counters.update(self.port.take_counters())
        return self.counters

    def lost(self, fault: str, remedy: str = REMEDY) -> LinkLost:
        return LinkLost(self.device, self.port.name, fault, remedy)

    def _dead(self, verb: str, error: OSError) -> LinkLost:
        remedy = REMEDIES.get(error.errno or 0, REMEDY)
        return self.lost(f"cannot {verb}: {error.strerror or error}", remedy.format(port=self.port.name))

    def refused(self, fault: str, remedy: str) -> Refused:
        return Refused(self.device, self.port.name, fault, remedy)
