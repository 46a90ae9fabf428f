"""Reads a recording, whole or cut off: everything up to the last complete chunk."""

import struct
import tomllib
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import IO, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Metadata
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk

from contract.arena import Arena, parse
from contract.codec import WireError, decode
from contract.keys import Keys
from contract.messages import Message

CONFIG = "config.toml"
"""Name of the attachment that holds the resolved arena file."""

_CUT = (McapError, ValueError, OverflowError, struct.error, EOFError)


class RecordingError(ValueError):
    """Not a recording of ours; the text says which file and why."""


class Damaged(Attachment):
    """An attached file whose checksum is wrong."""


class Recorded(NamedTuple):
    """One message of a recording."""

    log_ns: int
    """Arrival at the recorder, site time."""
    key: str
    message: Message | None
    """None: a foreign key, or a payload that is not the message of its key."""
    payload: bytes


class Recording:
    """A recording on disk. ``scan`` has been done: metadata and attachments are there.

    :raises RecordingError: no such file, or not MCAP.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.whole = False
        """It ends with a footer, that is, the recorder finished it."""
        self.chunks = 0
        self.damaged_chunks = 0
        """Chunks whose checksum is wrong; they are left out."""
        self.damaged: set[str] = set()
        """Attached files whose checksum is wrong."""
        self.undecodable = 0
        """Of the messages iterated last."""
        for record in records(path):
            if isinstance(record, Metadata):
                self.metadata[record.name] = dict(record.metadata)
            elif isinstance(record, Attachment):
                self.attachments[record.name] = bytes(record.data)
                if isinstance(record, Damaged):
                    self.damaged.add(record.name)
            elif isinstance(record, Chunk):
                self.chunks += 1
            elif isinstance(record, Footer):
                self.whole = True

    def arena(self) -> Arena:
        """The resolved arena file that was recorded with the run.

        :raises RecordingError: there is none, or it is not what was written.
        :raises contract.arena.ArenaError: it has faults.
        """
        text = self.attachments.get(CONFIG)
        if text is None:
            raise RecordingError(f"{self.path}: no {CONFIG} attached; recorded by something else?")
        if CONFIG in self.damaged:
            raise RecordingError(f"{self.path}: {CONFIG} in it is damaged: its checksum is wrong; take another copy")
        return parse(tomllib.loads(text.decode("utf-8")), f"{self.path}:{CONFIG}")

    def messages(self) -> Iterator[Recorded]:
        """Every message in the order of arrival."""
        keys = Keys(self.arena().arena.name)
        topics: dict[int, str] = {}
        self.undecodable = self.damaged_chunks = 0
        for record in self.opened():
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, McapMessage):
                key = topics.get(record.channel_id)
                if key is None:
                    self.undecodable += 1
                    continue
                yield Recorded(record.log_time, key, self._decoded(keys, key, record.data), record.data)

    def opened(self) -> Iterator[McapRecord]:
        """Every record, chunks replaced by what is in them; a damaged chunk is counted and left out."""
        for record in records(self.path):
            if not isinstance(record, Chunk):
                yield record
                continue
            content = content_of(record)
            if content is None:
                self.damaged_chunks += 1
            else:
                yield from content

    def _decoded(self, keys: Keys, key: str, payload: bytes) -> Message | None:
        kind = keys.kind(key)
        if kind is None:
            return None
        try:
            return decode(kind, payload)
        except WireError:
            self.undecodable += 1
            return None


def records(path: Path) -> Iterator[McapRecord]:
    """The records of an MCAP file in order, chunks unopened, up to where the file was cut off.

    :raises RecordingError: no such file, or it does not start as MCAP.
    """
    try:
        stream = path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from None
    with stream:
        if stream.read(8) != b"\x89MCAP0\r\n":
            raise RecordingError(f"{path}: not an MCAP file, or cut off within its first 8 bytes")
        limit = path.stat().st_size
        reader = StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=limit)
        try:
            for record in reader.records:
                unsound = isinstance(record, Attachment) and not _sound(record, stream)
                yield Damaged(**asdict(record)) if unsound else record
        except _CUT:
            return


def _sound(attached: Attachment, stream: IO[bytes]) -> bool:
    """Whether the record that has just been read bears its own checksum; 0 stands for none."""
    stream.seek(-4, 1)
    (checksum,) = struct.unpack("<I", stream.read(4))
    content = struct.pack("<QQ", attached.log_time, attached.create_time)
    for words in (attached.name.encode(), attached.media_type.encode()):
        content += struct.pack("<I", len(words)) + words
    content += struct.pack("<Q", len(attached.data)) + attached.data
    return checksum in (0, zlib.crc32(content))


def content_of(chunk: Chunk) -> list[McapRecord] | None:
    """What is in a chunk; None where its checksum is wrong."""
    try:
        return breakup_chunk(chunk, validate_crc=True)
    except Exception:
        return None
