"""Record the raw datagrams of a NatNet session with their times, for replay bit for bit.

Connects as the bridge would (same arena file) but publishes nothing; the bridge may run meanwhile.
The file is an MCAP; play it back with mocap.source = "replay" and mocap.recording = FILE.
"""

import argparse
import math
import signal
import sys
import time
from pathlib import Path

from contract.arena import ArenaError, digest, load
from mocap_bridge.sources.choose import SourceError, open_natnet
from mocap_bridge.sources.tape_file import TapeWriter


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = __doc__
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file (TOML)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="MCAP file to write")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after this time (default: on Ctrl-C)")


def run(options: argparse.Namespace) -> int:
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda received, _: stop.append(received))
    try:
        arena = load(options.arena)
        source = open_natnet(arena)
        tape = TapeWriter(options.out, {"arena": arena.arena.name, "arena_hash": digest(arena)})
    except (ArenaError, SourceError, OSError) as error:
        print(f"record: {error}", file=sys.stderr)
        return 2
    source.tap = tape.write
    print("READY record", flush=True)
    frames, end_s = 0, time.monotonic() + options.seconds
    while not stop and time.monotonic() < end_s:
        source.wait(0.02)
        frames += len(source.receive(time.monotonic_ns()))
    tape.close()
    status = source.status()
    source.close()
    print(f"{options.out}: {tape.count} datagrams, {frames} frames from {status.name}, {status.malformed} malformed")
    return 0 if frames else 1
