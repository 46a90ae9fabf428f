"""A serial port as a driver uses it."""

from collections.abc import Callable, Iterator

from drivers.line import DeviceLine
from drivers.ports import BytePort


class Line(DeviceLine[BytePort]):
    """One device's serial line."""

    def send(self, data: bytes) -> bool:
        """False if the line had no room: the bytes are dropped, never queued."""
        try:
            sent = self.port.send(data)
        except OSError as error:
            raise self.dead("send", error) from error
        if not sent or self.dropped_in_a_row:
            self.note(sent)
        return sent

    def receive(self) -> bytes:
        try:
            return self.port.receive()
        except OSError as error:
            raise self.dead("receive", error) from error

    def ask(self, request: bytes, seconds: float, repeat_s: float = 0.1) -> Iterator[bytes]:
        """Send a request again and again; yield what arrives, until the time is up."""
        start_ns = sent_ns = self.port.now_ns()
        self.send(request)
        while (now_ns := self.port.now_ns()) < start_ns + int(seconds * 1e9):
            if now_ns - sent_ns > int(repeat_s * 1e9):
                sent_ns = now_ns
                self.send(request)
            self.port.wait(0.02)
            yield self.receive()

    def answer(self, request: bytes, parse: Callable[[bytes], bool], seconds: float = 0.3) -> bool:
        """Ask until ``parse`` has seen what it waits for."""
        return any(parse(data) for data in self.ask(request, seconds))
