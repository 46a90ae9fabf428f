"""A serial port as a driver uses it: port errors become typed driver errors, lost writes are counted."""

from collections import Counter
from collections.abc import Callable, Iterator

from drivers.base import LinkLost, Refused
from drivers.ports import BytePort
from drivers.serial.bandwidth import Bandwidth


class Line:
    """One device's serial line."""

    def __init__(self, device: str, port: BytePort) -> None:
        self.device = device
        self.port = port
        self.counters: Counter[str] = Counter()

    def open(self, bandwidth: Bandwidth) -> None:
        """:raises Refused: the line cannot carry a control period's traffic; with the arithmetic.
        :raises LinkLost: it does not open.
        """
        if not bandwidth.fits:
            raise self.refused(str(bandwidth), "Raise baud, or control.control_period_s")
        try:
            self.port.open()
        except OSError as error:
            raise self.lost(f"cannot open: {error}") from error

    def send(self, data: bytes) -> bool:
        """False if the line had no room: the bytes are dropped, never queued."""
        try:
            sent = self.port.send(data)
        except OSError as error:
            raise self.lost(f"cannot send: {error}") from error
        if not sent:
            self.counters["send_dropped"] += 1
        return sent

    def receive(self) -> bytes:
        try:
            return self.port.receive()
        except OSError as error:
            raise self.lost(f"cannot receive: {error}") from error

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

    def lost(self, fault: str) -> LinkLost:
        remedy = "Check power, cable, baud and id, then configure again"
        return LinkLost(self.device, self.port.name, fault, remedy)

    def refused(self, fault: str, remedy: str) -> Refused:
        return Refused(self.device, self.port.name, fault, remedy)
