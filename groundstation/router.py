"""``router``: the router of a secured site: mutual TLS, and rules for every holder of a certificate.

A process of its own, so that it can be renewed while the site runs: when the arena file, who counts by the register, or
its own certificate changes, it begins anew in the same process, with rules made afresh. Robots hold for that moment and
go on.
"""

import argparse
import os
import signal
import sys
import time
from pathlib import Path

from contract import network
from contract.arena import Arena, ArenaError, load
from groundstation import access
from groundstation.keyring import Keyring, KeysError
from groundstation.network import open_session

LOOK_S = 0.5


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file with link.keys")


def run(args: argparse.Namespace) -> int:
    """Until SIGTERM or Ctrl-C; exit code 1 where the address is taken, 2 for bad input."""
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda received, _: stop.append(received))
    arena = load(args.arena)
    if not arena.link.keys:
        print("without link.keys the mocap bridge begins the router; nothing to do here", file=sys.stderr)
        return 2
    import zenoh

    seen = fingerprint(args.arena, arena)
    try:
        session = open_session(settings_of(arena))
    except (KeysError, zenoh.ZError) as error:
        print(f"router at {listening(arena)}: {error}", file=sys.stderr)
        return 1
    print(f"READY router {listening(arena)}", flush=True)
    with session:
        while not stop:
            time.sleep(LOOK_S)
            found = fingerprint(args.arena, arena)
            if found != seen:
                seen = found
                if renewable(args.arena):
                    break
    if not stop:
        # only exec frees a QUIC address at once
        os.execv(sys.executable, [sys.executable, "-m", "groundstation", "router", "--arena", str(args.arena)])
    return 0


def renewable(path: Path) -> bool:
    """Whether a router can begin from these files; if not, says why the old rules stay."""
    try:
        settings_of(load(path))
    except (ArenaError, KeysError) as error:
        print(f"the old rules stay: {error}", file=sys.stderr, flush=True)
        return False
    return True


def listening(arena: Arena) -> str:
    """Where the router of an arena listens."""
    return ", ".join(arena.link.listen or (arena.link.router,))


def counted(arena: Arena) -> dict[str, str]:
    """Robot or role to the common name that counts.

    :raises groundstation.keyring.KeysError: no register.
    """
    return Keyring(Path(arena.link.keys)).register().common_names()


def fingerprint(path: Path, arena: Arena) -> tuple[object, ...]:
    """Changes whenever something changes that the router was configured from.

    A certificate that is renewed under the same name is none of that: the sessions of a site outlive its renewal.
    """
    keys = Path(arena.link.keys)
    try:
        found: list[object] = [sorted(counted(arena).items())]
    except KeysError as error:
        found = [str(error)]
    for part in (path, keys / "ca.pem", keys / "router" / "certificate.pem"):
        try:
            status = part.stat()
            found.append((status.st_mtime_ns, status.st_ino))
        except OSError:
            found.append(None)
    return tuple(found)


def settings_of(arena: Arena) -> network.Settings:
    """Zenoh settings of the router, its rules made from arena file and register.

    :raises contract.arena.ArenaError: no certificate of the router.
    :raises groundstation.keyring.KeysError: no register.
    """
    identity = network.identity(arena.link.keys, "router")
    rules = access.rules(arena, counted(arena))
    return network.router_config(arena.link.router, arena.link.listen, identity, rules)
