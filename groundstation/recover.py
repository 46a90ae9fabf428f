"""``recover``: rewrite a recording that was cut off into a whole one, with index, summary and statistics."""

import argparse
import os
import sys
from pathlib import Path
from typing import NamedTuple

from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.writer import CompressionType, Writer

from groundstation.recording import Damaged, Recording, RecordingError
from groundstation.runwriter import LIBRARY, Sink

DAMAGED = ".damaged"
"""Appended to the name of an attached file whose checksum is wrong: the new file's checksum would vouch for it."""


class Recovered(NamedTuple):
    """What a recovery found."""

    messages: int
    chunks: int
    damaged_chunks: int
    was_whole: bool
    seconds: float
    """From the first message to the last."""


def recover(source: Path, target: Path) -> Recovered:
    """Copy everything up to the last complete chunk of ``source`` into an indexed file ``target``.

    The target appears under its name only when it is complete.

    :raises RecordingError: the source is not a recording.
    :raises OSError: the target cannot be written.
    """
    recording = Recording(source)
    partial = target.with_name(target.name + ".part")
    descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        sink = Sink(descriptor)
        messages, seconds = _rewrite(recording, sink)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    finally:
        os.close(descriptor)
    partial.replace(target)
    return Recovered(messages, recording.chunks, recording.damaged_chunks, recording.whole, seconds)


def _rewrite(recording: Recording, sink: Sink) -> tuple[int, float]:
    writer = Writer(sink, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
    writer.start(library=LIBRARY)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    count, orphans, first_ns, last_ns = 0, 0, 0, 0
    recording.damaged_chunks = 0
    for record in recording.opened():
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas[record.schema_id]
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schema, dict(record.metadata)
            )
        elif isinstance(record, McapMessage):
            channel = channels.get(record.channel_id)
            if channel is None:
                orphans += 1
                continue
            writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            first_ns = record.log_time if not count else min(first_ns, record.log_time)
            last_ns = max(last_ns, record.log_time)
            count += 1
            if sink.pending > 1 << 22:
                sink.commit()
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, dict(record.metadata))
        elif isinstance(record, Attachment):
            name = record.name + (DAMAGED if isinstance(record, Damaged) else "")
            writer.add_attachment(record.create_time, record.log_time, name, record.media_type, bytes(record.data))
    story = {"source": recording.path.name, "was_whole": str(recording.whole).lower()}
    if recording.damaged_chunks:
        story |= {"damaged_chunks": str(recording.damaged_chunks), "messages_without_channel": str(orphans)}
    writer.add_metadata("recovery", story)
    writer.finish()  # type: ignore[no-untyped-call]
    sink.commit()
    return count, (last_ns - first_ns) / 1e9


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", type=Path, metavar="IN", help="recording that was cut off, such as run1/run.mcap")
    parser.add_argument("--out", type=Path, required=True, metavar="OUT", help="whole recording to write")


def run(args: argparse.Namespace) -> int:
    if args.out.exists() and args.source.exists() and args.out.samefile(args.source):
        print(f"{args.out}: is the recording itself; choose another name", file=sys.stderr)
        return 2
    try:
        found = recover(args.source, args.out)
    except RecordingError as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{args.out}: {error.strerror}", file=sys.stderr)
        return 1
    for name in sorted(Recording(args.source).damaged):
        print(f"{args.source}: {name} in it is damaged, kept as {name}{DAMAGED}", file=sys.stderr)
    damage = f", {found.damaged_chunks} damaged chunks left out" if found.damaged_chunks else ""
    state = "was whole" if found.was_whole else "was cut off"
    print(f"{args.out}: {found.messages} messages over {found.seconds:.1f} s in {found.chunks} chunks{damage}; {state}")
    return 0
