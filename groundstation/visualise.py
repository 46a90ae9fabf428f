"""``foxglove``: a copy of a recording with visual channels beside its own, and a layout to open it with."""

import argparse
import os
import sys
from pathlib import Path

from contract.arena import ArenaError
from contract.keys import Keys
from groundstation.files import write_whole
from groundstation.recording import Recording, RecordingError
from groundstation.runfolder import recording_path
from groundstation.runwriter import RunWriter, Sink

LAYOUT = Path(__file__).parent / "layouts" / "foxglove.json"
SITE = "SITE"
"""Stands for the site's name in the layout."""
NAME = "foxglove.mcap"
COMMIT_BYTES = 1 << 22


def visualise(source: Path, target: Path) -> dict[str, int]:
    """Write ``target``: everything of ``source``, bytes unchanged, and the visual channels; messages by visual topic.

    :raises RecordingError: the source is not a recording of ours.
    :raises OSError: the target cannot be written.
    """
    from groundstation.visual import SCHEMAS, Visual

    recording = Recording(source)
    arena = recording.arena()
    visual = Visual(arena)
    schemas = {kind: kind.get_schema() for kind in SCHEMAS}
    counts: dict[str, int] = {}
    partial = target.with_name(target.name + ".part")
    descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        sink = Sink(descriptor)
        writer = RunWriter(sink, Keys(arena.arena.name))
        writer.describe(recording.metadata, recording.attachments, 0)
        for log_ns, key, message, payload in recording.messages():
            writer.write(key, payload, log_ns)
            for topic, kind, content in visual.receive(message, log_ns) if message is not None else ():
                schema = schemas[kind]
                writer.show(topic, (schema.name, schema.encoding, schema.data), content, log_ns)
                counts[topic] = counts.get(topic, 0) + 1
            if sink.pending > COMMIT_BYTES:
                writer.commit()
        writer.finish({})
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    finally:
        os.close(descriptor)
    partial.replace(target)
    return counts


def layout(site: str) -> bytes:
    """The shipped layout for a site."""
    return LAYOUT.read_text(encoding="utf-8").replace(SITE, site).encode()


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Write RUN/foxglove.mcap: the recording with frames, robots, links, targets and log as Foxglove's schemas, "
        "which Foxglove and rerun show as they are; and foxglove-layout.json to import there. "
        "Needs: pip install 'ahdc-fieldkit[viz]'."
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, or its recording")
    parser.add_argument("--out", type=Path, metavar="FILE", help=f"the new file (RUN/{NAME})")


def run(args: argparse.Namespace) -> int:
    try:
        import foxglove  # noqa: F401
    except ImportError:
        print("foxglove: needs foxglove-sdk; remedy: pip install 'ahdc-fieldkit[viz]'", file=sys.stderr)
        return 1
    source = recording_path(args.run)
    target = args.out or source.with_name(NAME)
    if source.exists() and target.exists() and target.samefile(source):
        print(f"{target} is the recording itself; choose another --out", file=sys.stderr)
        return 2
    try:
        counts = visualise(source, target)
        site = Recording(source).arena().arena.name
        write_whole(target.with_name("foxglove-layout.json"), layout(site))
    except (RecordingError, ArenaError) as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{target}: {error.strerror}", file=sys.stderr)
        return 1
    for topic, count in sorted(counts.items()):
        print(f"{topic:<24}{count:>8}")
    print(f"{target}, {target.stat().st_size / 1e6:.1f} MB, and foxglove-layout.json beside it")
    return 0
