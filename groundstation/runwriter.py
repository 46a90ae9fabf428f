"""A run's MCAP file as it is written: payload bytes unchanged, complete chunks only, whatever happens.

Channels are topics (the Zenoh keys) with ``json`` messages and their ``jsonschema``. A payload on a
foreign key, or one that is not the message its key carries, is kept on a channel without schema
(encoding ``application/octet-stream``) and counted. ``log_time`` and ``publish_time`` are the time of
arrival, site time.
"""

import json
import os
from collections.abc import Mapping

from mcap.writer import CompressionType, Writer

from contract.codec import WireError, decode, json_schema
from contract.keys import Keys

LIBRARY = "ahdc-fieldkit"
RAW = "application/octet-stream"


class Sink:
    """An open file that grows only by whole flushes: a flush that fails leaves the file as it was before.

    What could not be written stays pending and is tried again with the next flush, so a disk that was
    full for a while costs nothing that fits into memory.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._pending = bytearray()
        self.size = 0
        """Bytes in the file."""

    @property
    def pending(self) -> int:
        """Bytes that wait for the next flush."""
        return len(self._pending)

    def write(self, data: bytes) -> int:
        self._pending += data
        return len(data)

    def tell(self) -> int:
        return self.size + len(self._pending)

    def flush(self) -> None:
        """Nothing: the MCAP writer flushes before it is due."""

    def commit(self) -> None:
        """Append what is pending and have the disk confirm it.

        :raises OSError: no space, or the disk fails; the file ends where it ended before.
        """
        view = memoryview(self._pending)
        done = 0
        try:
            while done < len(view):
                done += os.pwrite(self._descriptor, view[done:], self.size + done)
            os.fsync(self._descriptor)
        except OSError:
            os.ftruncate(self._descriptor, self.size)
            raise
        finally:
            view.release()
        self.size += done
        self._pending.clear()


class RunWriter:
    """Writes one recording into a :class:`Sink`."""

    def __init__(self, sink: Sink, keys: Keys) -> None:
        self.messages = 0
        self.unknown = 0
        """Messages on keys that are not ours."""
        self.undecodable = 0
        """Payloads that are not the message of their key."""
        self._sink = sink
        self._keys = keys
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, bool], int] = {}
        self._sequences: dict[int, int] = {}
        self._writer = Writer(sink, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._writer.start(library=LIBRARY)

    def describe(
        self, metadata: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes], now_ns: int
    ) -> None:
        """Metadata records and attached files (name to content), committed at once.

        :raises OSError: see :meth:`Sink.commit`.
        """
        for name, entries in metadata.items():
            self._writer.add_metadata(name, dict(entries))
        for name, content in attachments.items():
            self._writer.add_attachment(now_ns, now_ns, name, "text/plain", content)
        self.commit()

    def write(self, key: str, payload: bytes, log_ns: int) -> None:
        """One message as it arrived."""
        kind = self._keys.kind(key)
        sound = kind is not None
        if kind is None:
            self.unknown += 1
        else:
            try:
                decode(kind, payload)
            except WireError:
                sound = False
                self.undecodable += 1
        channel = self._channel(key, sound)
        sequence = self._sequences[channel] = self._sequences.get(channel, 0) + 1
        self._writer.add_message(channel, log_ns, payload, log_ns, sequence & 0xFFFFFFFF)
        self.messages += 1

    def show(self, topic: str, schema: tuple[str, str, bytes], payload: bytes, log_ns: int) -> None:
        """One message for viewers; ``schema`` is its name, encoding (also the message's) and definition."""
        name, encoding, definition = schema
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, encoding, definition)
        channel = self._channels.get((topic, True))
        if channel is None:
            channel = self._channels[topic, True] = self._writer.register_channel(topic, encoding, self._schemas[name])
        self._writer.add_message(channel, log_ns, payload, log_ns)

    def commit(self) -> None:
        """Close the chunk in progress and have it on the disk.

        :raises OSError: see :meth:`Sink.commit`.
        """
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._sink.commit()

    def finish(self, metadata: Mapping[str, Mapping[str, str]]) -> None:
        """Last metadata, then index, statistics and footer.

        :raises OSError: see :meth:`Sink.commit`.
        """
        for name, entries in metadata.items():
            self._writer.add_metadata(name, dict(entries))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._sink.commit()

    def _channel(self, key: str, sound: bool) -> int:
        channel = self._channels.get((key, sound))
        if channel is None:
            schema = self._schema(key) if sound else 0
            encoding = "json" if sound else RAW
            channel = self._channels[key, sound] = self._writer.register_channel(key, encoding, schema)
        return channel

    def _schema(self, key: str) -> int:
        kind = self._keys.kind(key)
        assert kind is not None
        name = kind.__name__
        if name not in self._schemas:
            text = json.dumps(json_schema(kind)).encode()
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", text)
        return self._schemas[name]
