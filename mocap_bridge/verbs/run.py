"""Connect to the motion-capture system of the arena file and publish every frame.

Begins the network's router first (when link.router is this host and has no keys), a process that ends with this one,
and prints "READY mocap_bridge"; the motion-capture system may appear later, vanish and come back.
"""

import argparse
import gc
import signal
import sys
from pathlib import Path

from contract import network
from contract.arena import ArenaError, load
from contract.exposure import exposure
from contract.voice import say
from mocap_bridge.sources.choose import SourceError, open_source


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = __doc__
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file (TOML)")
    parser.add_argument(
        "--allow-replay", action="store_true", help="publish frames that the server plays back or edits as valid"
    )


def run(options: argparse.Namespace) -> int:
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda received, _: stop.append(received))
    try:
        arena = load(options.arena)
        identity = network.identity(arena.link.keys, "bridge")
        source = open_source(arena)
    except (ArenaError, SourceError) as error:
        print(error, file=sys.stderr)
        return 2
    import zenoh

    from mocap_bridge.bridge import NAME, Bridge
    from mocap_bridge.network import open_session
    from mocap_bridge.router import RouterError
    from mocap_bridge.sources.base import OnNetwork

    if words := exposure((arena.link.router, *arena.link.listen), arena.link.keys):
        say(words)
    try:
        joined = open_session(arena.link.router, identity)
    except (zenoh.ZError, RouterError) as error:
        hint = "; does a router run, and does it take this certificate?" if identity else ""
        print(f"link.router = {arena.link.router}: {error}{hint}", file=sys.stderr)
        source.close()
        return 1
    with joined:
        if isinstance(source, OnNetwork):
            source.attach(joined.session)
        bridge = Bridge(arena, source, joined, options.allow_replay)
        gc.collect()
        gc.freeze()  # what lives now is never looked at again
        gc.set_threshold(50_000, 20, 100)
        say(f"READY {NAME}", sys.stdout)
        code = 0
        try:
            bridge.run(lambda: bool(stop))
        except RouterError as error:
            print(f"link.router = {arena.link.router}: {error}", file=sys.stderr)
            code = 1
    source.close()
    return code
