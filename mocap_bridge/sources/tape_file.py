"""Tapes in MCAP files: written so that a kill loses at most a second, read even if cut off.

Topics ``natnet/received`` and ``natnet/sent``, message encoding ``natnet``: the datagram unchanged;
log and publish time are the local monotonic clock. Metadata ``ahdc-mocap`` names arena and server.
"""

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from mocap_bridge.sources.tape import Entry, Way

TOPICS: Mapping[Way, str] = {"received": "natnet/received", "sent": "natnet/sent"}
ENCODING = "natnet"
FLUSH_NS = 1_000_000_000


class TapeError(ValueError):
    """A file that is no tape; the text names it and what is wrong."""


class TapeWriter:
    """Appends entries to a file; messages are written through, not kept in chunks.

    :raises OSError: the file cannot be made.
    """

    def __init__(self, path: Path, notes: Mapping[str, str]) -> None:
        self._file: IO[bytes] = path.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.NONE, use_chunking=False)
        self._writer.start(profile="", library="ahdc-fieldkit")
        self._writer.add_metadata("ahdc-mocap", dict(notes))
        self._channels = {
            way: self._writer.register_channel(topic=topic, message_encoding=ENCODING, schema_id=0)
            for way, topic in TOPICS.items()
        }
        self._flush_due_ns = 0
        self.count = 0

    def write(self, entry: Entry) -> None:
        """One datagram."""
        self._writer.add_message(self._channels[entry.way], entry.stamp_ns, entry.data, entry.stamp_ns, self.count)
        self.count += 1
        if entry.stamp_ns >= self._flush_due_ns:
            self._file.flush()
            self._flush_due_ns = entry.stamp_ns + FLUSH_NS

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()


def read_tape(path: Path) -> Iterator[Entry]:
    """The entries of a tape in the order of writing; a file cut off ends where it was cut.

    :raises TapeError: not an MCAP file, or one without NatNet datagrams.
    """
    ways: dict[int, Way] = {}
    by_topic: dict[str, Way] = {topic: way for way, topic in TOPICS.items()}
    try:
        with path.open("rb") as file:
            for record in _records(file, path):
                if isinstance(record, Channel) and record.message_encoding == ENCODING and record.topic in by_topic:
                    ways[record.id] = by_topic[record.topic]
                elif isinstance(record, Message) and record.channel_id in ways:
                    yield Entry(ways[record.channel_id], record.log_time, record.data)
    except OSError as error:
        raise TapeError(f"{path}: {error.strerror or error}") from None
    if not ways:
        raise TapeError(f"{path}: no NatNet datagrams in it (topics {', '.join(TOPICS.values())})")


def is_tape(path: Path) -> bool:
    """Whether a file holds NatNet datagrams.

    :raises TapeError: not an MCAP file.
    """
    try:
        return next(read_tape(path), None) is not None
    except TapeError as error:
        if "no NatNet datagrams" in str(error):
            return False
        raise


def _records(file: IO[bytes], path: Path) -> Iterator[object]:
    began = False
    try:
        for record in StreamReader(file).records:
            began = True
            yield record
    except (McapError, struct.error, ValueError) as error:
        if not began:
            raise TapeError(f"{path}: not an MCAP file ({error or type(error).__name__})") from None
