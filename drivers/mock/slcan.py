"""A LAWICEL adapter and the CAN bus behind it: any number of ports and nodes on one bus.

Source: LAWICEL CANUSB manual v1.0D. CR accepts, BELL refuses; frames are taken over with ``z`` or
``Z``. The channel opens with ``O`` (again: refused) once a bit rate is set, closes with ``C``.
"""

from collections import Counter
from typing import Protocol

from drivers.can.frame import CanFrame

OK, BELL = b"\r", b"\a"
RATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
MAX_LINE = 64
HEX = frozenset(b"0123456789ABCDEFabcdef")


class Node(Protocol):
    """A device on the bus."""

    def take_frame(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """Frames it sends in answer."""


class AdapterPort:
    """One computer-side connection: a parser of commands and a buffer of answers."""

    def __init__(self) -> None:
        self.open = False
        self.rate: int | None = None
        self.output = bytearray()
        self.line = bytearray()


class Hub:
    """The bus: what one port sends, every node and every other open port receives."""

    def __init__(self, bitrate: int | None = None) -> None:
        self.bitrate = bitrate
        """A port set to another rate raises errors instead of frames; None accepts any."""
        self.nodes: list[Node] = []
        self.ports: list[AdapterPort] = []
        self.counters: Counter[str] = Counter()
        self.bus_off = False

    def add_port(self) -> AdapterPort:
        self.ports.append(AdapterPort())
        return self.ports[-1]

    def receive(self, port: AdapterPort, data: bytes, now_ns: int) -> None:
        if not data:
            return
        *lines, rest = (bytes(port.line) + data).split(b"\r")
        for line in lines:
            port.output += self._command(port, self._within(line), now_ns)
        port.line[:] = self._within(rest)

    def _within(self, line: bytes) -> bytes:
        """What is left of a line once the adapter's buffer has overflowed as often as it does."""
        overflows, left = divmod(len(line), MAX_LINE + 1)
        if not overflows:
            return line
        self.counters["garbage_line"] += overflows
        return line[len(line) - left :]

    def broadcast(self, frames: list[CanFrame], now_ns: int, source: AdapterPort | None = None) -> None:
        """Put frames on the bus, answers of nodes included."""
        if self.bus_off:
            self.counters["bus_off_frame"] += len(frames)
            return
        for frame in frames:
            text = _text(frame)
            for port in self.ports:
                if port is not source and port.open and self._rate_fits(port):
                    port.output += text
            if source is not None:
                for node in self.nodes:
                    self.broadcast(node.take_frame(frame, now_ns), now_ns)

    def _rate_fits(self, port: AdapterPort) -> bool:
        return self.bitrate is None or port.rate is None or port.rate == self.bitrate

    def _command(self, port: AdapterPort, line: bytes, now_ns: int) -> bytes:
        if not line:
            return OK
        kind = chr(line[0])
        if kind in "tTrR":
            return self._transmit(port, kind, line, now_ns)
        accepted = True
        if kind == "O" or kind == "L":
            accepted, port.open = not port.open, True
        elif kind == "C":
            accepted, port.open = port.open, False
        elif kind == "S" and line[1:].isdigit() and int(line[1:]) < len(RATES):
            accepted = not port.open
            if accepted:
                port.rate = RATES[int(line[1:])]
        elif kind == "V":
            return b"V1013\r"
        elif kind == "N":
            return b"NE001\r"
        elif kind == "F":
            return b"F%02X\r" % (0x80 if self.bus_off else 0)
        elif kind not in "sYZmM":
            self.counters["unknown_command"] += 1
            accepted = False
        return OK if accepted else BELL

    def _transmit(self, port: AdapterPort, kind: str, line: bytes, now_ns: int) -> bytes:
        frame = _frame(kind, line)
        if frame is None:
            self.counters["garbage_line"] += 1
            return BELL
        if not port.open:
            self.counters["channel_closed"] += 1
            return BELL
        if not self._rate_fits(port):
            self.counters["wrong_bitrate"] += 1
            return BELL
        self.broadcast([frame], now_ns, source=port)
        return b"Z\r" if frame.extended else b"z\r"


def _frame(kind: str, line: bytes) -> CanFrame | None:
    digits = 8 if kind in "TR" else 3
    body = line[1:]
    if len(body) <= digits or not HEX.issuperset(body):
        return None
    number, length = int(body[:digits], 16), body[digits] - 48
    payload = body[digits + 1 :]
    remote = kind in "rR"
    if not 0 <= length <= 8 or number > (0x1FFFFFFF if digits == 8 else 0x7FF):
        return None
    if len(payload) != (0 if remote else 2 * length):
        return None
    return CanFrame(number, bytes.fromhex(payload.decode()), digits == 8, remote, length if remote else None)


def _text(frame: CanFrame) -> bytes:
    if not (frame.extended or frame.remote):
        return b"t%03X%d%s\r" % (frame.can_id, len(frame.data), frame.data.hex().upper().encode())
    digits = 8 if frame.extended else 3
    kind = "tTrR"[2 * frame.remote + frame.extended]
    payload = "" if frame.remote else frame.data.hex().upper()
    return f"{kind}{frame.can_id:0{digits}X}{frame.length}{payload}\r".encode()
