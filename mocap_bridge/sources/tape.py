"""Raw datagrams with their times: what a recording of a session holds, and its replay bit for bit. Pure.

A tape is fed to a fresh receiver at the recorded times: sending is asked for when it was done then,
so that the receiver goes through the same states and decodes the same frames to the same bits.
"""

from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.sources.natnet_receiver import NatNetReceiver

Way = Literal["received", "sent"]


class Entry(NamedTuple):
    """One datagram."""

    way: Way
    stamp_ns: int
    """Local monotonic time of reading or sending it."""
    data: bytes


class TapePlayer:
    """Feeds a tape to a receiver; ``differences`` counts what it would have sent otherwise than then."""

    def __init__(self, receiver: NatNetReceiver) -> None:
        self.receiver = receiver
        self.differences = 0
        self._expected: list[bytes] = []
        self._asked_ns = -1

    def play(self, entry: Entry) -> SourceFrame | None:
        """One entry, in the order of the tape."""
        if entry.way == "received":
            return self.receiver.receive(entry.data, entry.stamp_ns)
        if entry.stamp_ns != self._asked_ns:
            self.differences += len(self._expected)
            self._expected = self.receiver.outbox(entry.stamp_ns)
            self._asked_ns = entry.stamp_ns
        if entry.data in self._expected:
            self._expected.remove(entry.data)
        else:
            self.differences += 1
        return None

    def frames(self, tape: Iterable[Entry]) -> Iterator[SourceFrame]:
        """Every frame of a tape."""
        for entry in tape:
            frame = self.play(entry)
            if frame is not None:
                yield frame
