"""A CAN bus as a driver uses it."""

from collections.abc import Callable, Sequence

from drivers.can.frame import CanFrame
from drivers.line import DeviceLine
from drivers.ports import FramePort


class CanLine(DeviceLine[FramePort]):
    """One device's view of its bus; ``take`` handles a frame and names the counter to raise, or ''."""

    def __init__(self, device: str, port: FramePort, take: Callable[[CanFrame], str]) -> None:
        super().__init__(device, port)
        self._take = take

    def send(self, frames: Sequence[CanFrame]) -> None:
        try:
            sent = self.port.send(frames)
        except OSError as error:
            raise self.dead("send", error) from error
        if not sent or self.dropped_in_a_row:
            self.note(sent)

    def drain(self) -> None:
        """Handle every frame received."""
        try:
            frames = self.port.receive()
        except OSError as error:
            raise self.dead("receive", error) from error
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
