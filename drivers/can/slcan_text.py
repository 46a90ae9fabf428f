"""LAWICEL text of CAN frames, computer side: pure encode, and a reader fed in arbitrary chunks.

Source: LAWICEL CANUSB manual v1.0D, section "Commands": ``tiiildd..`` standard, ``T`` extended,
``r`` and ``R`` remote; the adapter answers CR for accepted, BELL for refused, ``z``/``Z`` CR for a
frame taken over.
"""

from collections import Counter

from drivers.can.frame import CanFrame

MAX_LINE = 64
HEX = frozenset(b"0123456789ABCDEFabcdef")
ASK_STATUS = b"F\r"
STATUS_TEXTS = {
    0x80: "the adapter reports bus errors (bus-off): check bitrate, wiring and termination",
    0x20: "the adapter is error passive: check wiring and termination",
    0x02: "the adapter's transmit queue is full: nothing on the bus acknowledges frames",
}
"""Bits of the status byte, gravest first."""


def encode(frame: CanFrame) -> bytes:
    """One line with its CR."""
    if not (frame.extended or frame.remote):
        return b"t%03X%d%s\r" % (frame.can_id, len(frame.data), frame.data.hex().upper().encode())
    kind = ("R" if frame.extended else "r") if frame.remote else "T"
    number = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
    payload = "" if frame.remote else frame.data.hex().upper()
    return f"{kind}{number}{frame.length}{payload}\r".encode()


class SlcanReader:
    """Frames from what an adapter sends; refused lines are counted by name, never raised.

    Refusals before the first acknowledged frame are the handshake's (a channel closed or opened
    twice) and not counted.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self.flags = 0
        """Status of the adapter's controller as last answered to :data:`ASK_STATUS`."""
        self._rest = b""
        self._settled = False

    @property
    def status(self) -> str:
        """The gravest thing the adapter says of its bus, '' for nothing."""
        return next((text for bit, text in STATUS_TEXTS.items() if self.flags & bit), "")

    def feed(self, data: bytes) -> list[CanFrame]:
        if not data:
            return []
        *lines, rest = (self._rest + data).split(b"\r")
        if len(rest) > MAX_LINE:
            self.counters["slcan_garbage"] += 1
            rest = b""
        self._rest = rest
        frames = []
        for line in lines:
            if b"\a" in line:
                if self._settled:
                    self.counters["slcan_refused"] += line.count(b"\a")
                line = line.rpartition(b"\a")[2]
            if not line:
                continue
            if line in (b"z", b"Z"):
                self._settled = True
                continue
            if len(line) == 3 and line[:1] == b"F" and line.isalnum():
                self.flags = int(line[1:], 16) if HEX.issuperset(line[1:]) else self.flags
                continue
            frame = parse(line)
            if frame is None:
                self.counters["slcan_garbage"] += 1
            else:
                frames.append(frame)
        return frames


def parse(line: bytes) -> CanFrame | None:
    """A frame from one line without its CR; None for anything else."""
    kind = line[:1]
    extended = kind in (b"T", b"R")
    remote = kind in (b"r", b"R")
    digits = 8 if extended else 3
    if not (extended or remote or kind == b"t") or not line.isalnum():
        return None
    try:
        can_id = int(line[1 : 1 + digits], 16)
        length = int(line[1 + digits : 2 + digits])
        data = bytes.fromhex(line[2 + digits :].decode("ascii"))
    except ValueError:
        return None
    if length > 8 or can_id >= (1 << 29 if extended else 1 << 11) or len(data) != (0 if remote else length):
        return None
    return CanFrame(can_id, data, extended, remote, length if remote else None)
