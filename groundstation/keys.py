"""``keys``: the site's certificate authority, and short-lived certificates for robots, station, bridge and router."""

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path

from contract.arena import Arena, ArenaError, load
from contract.exposure import ROLES, host_of
from contract.tables import Fault, nearest
from groundstation import certificates
from groundstation.keyring import Keyring, KeysError
from groundstation.register import Register, lifetime

DAYS = 30.0
EXAMPLES = """\
  keys init --arena lab6.toml               the site's own authority, once
  keys issue --arena lab6.toml              certificates for every role and robot that has none
  keys issue --arena lab6.toml r06 --replace     a new one for r06; give it keys/r06.tar
  keys revoke --arena lab6.toml r06         r06 may neither speak nor hear, at once
  keys list --arena lab6.toml               who has what until when

Private keys are written readable by their owner only and are never printed. See docs/network.md.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.epilog = EXAMPLES
    parser.add_argument("deed", choices=("init", "issue", "revoke", "list"), metavar="init|issue|revoke|list")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"robots of the arena file, or {', '.join(ROLES)}")
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file with link.keys")
    parser.add_argument("--days", type=float, default=DAYS, metavar="N", help="how long it is valid (%(default)g)")
    parser.add_argument("--replace", action="store_true", help="make new ones where there are valid ones")
    parser.add_argument(
        "--authority", type=Path, metavar="DIR", help="folder of the authority's private key (link.keys/authority)"
    )


def run(args: argparse.Namespace) -> int:
    """Exit code 1: the folder does not allow it; 2: bad input."""
    arena = load(args.arena)
    if not arena.link.keys:
        text = 'missing; add keys = "keys" and router = "quic/ADDRESS:7447"'
        raise ArenaError(str(args.arena), [Fault("link.keys", "", text)])
    if not 0.0 < args.days <= 825.0:
        print(f"--days {args.days:g}: above 0 and up to 825", file=sys.stderr)
        return 2
    if words := _unknown(args.names, arena):
        print(words, file=sys.stderr)
        return 2
    keyring = Keyring(Path(arena.link.keys), args.authority)
    deeds = {"init": _init, "issue": _issue, "revoke": _revoke, "list": _list}
    try:
        return deeds[args.deed](keyring, arena, args)
    except KeysError as error:
        print(error, file=sys.stderr)
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
    return 1


def _unknown(names: list[str], arena: Arena) -> str:
    known = [*arena.robots, *ROLES]
    strange = [name for name in names if name not in known]
    words = (f"{name}: no robot of {arena.arena.name} and no role; {nearest(name, known)}" for name in strange)
    return "\n".join(line.rstrip("; ") for line in words)


def servers_of(arena: Arena) -> list[str]:
    """Addresses and names under which the router's certificate is valid: those of the arena file, and loopback."""
    hosts = [host_of(entry) for entry in (arena.link.router, *arena.link.listen)]
    return [host for host in dict.fromkeys([*hosts, "127.0.0.1", "localhost"]) if host not in ("0.0.0.0", "::")]


def establish(arena: Arena, days: float, now: datetime) -> None:
    """An authority and certificates for everybody, whatever there was before."""
    keyring = Keyring(Path(arena.link.keys))
    keyring.found(arena.arena.name, now, replace=True)
    for name in (*ROLES, *arena.robots):
        keyring.issue(name, days, now, servers_of(arena) if name == "router" else ())


def _init(keyring: Keyring, arena: Arena, args: argparse.Namespace) -> int:
    keyring.found(arena.arena.name, datetime.now(UTC), args.replace)
    print(f"authority of {arena.arena.name} in {keyring.folder}; next: keys issue --arena {args.arena}")
    return 0


def _issue(keyring: Keyring, arena: Arena, args: argparse.Namespace) -> int:
    now = datetime.now(UTC)
    register = keyring.register()
    names = args.names or [name for name in (*ROLES, *arena.robots) if args.replace or _wants(register, name, now)]
    if not names:
        print("everybody has a valid certificate; --replace makes new ones")
    for name in names:
        servers = servers_of(arena) if name == "router" else ()
        common_name = keyring.issue(name, args.days, now, servers, args.replace)
        bundle = keyring.bundle(name)
        print(f"{name:<10} {common_name}, {args.days:g} days; {bundle}")
    return 0


def _wants(register: Register, name: str, now: datetime) -> bool:
    """Whether a holder lacks a valid certificate; one that was revoked gets another only when it is named."""
    entry = register.current(name)
    return entry.not_after <= now if entry is not None else not register.is_revoked(name)


def _revoke(keyring: Keyring, arena: Arena, args: argparse.Namespace) -> int:
    if not args.names:
        print("revoke whom? keys revoke NAME", file=sys.stderr)
        return 2
    for name in args.names:
        keyring.revoke(name)
        print(f"{name} revoked; the router takes it in within a second")
    return 0


def _list(keyring: Keyring, arena: Arena, args: argparse.Namespace) -> int:
    register, held, now = keyring.register(), keyring.held(), datetime.now(UTC)
    good = True
    for name in dict.fromkeys([*ROLES, *arena.robots, *register.common_names()]):
        entry = register.current(name)
        if entry is None:
            revoked = register.is_revoked(name)
            print(f"{name:<10} {'revoked' if revoked else 'no certificate'}")
            good = good and revoked
            continue
        words, well = lifetime(entry.not_after, now)
        here = name in held and certificates.about(held[name]).fingerprint == entry.fingerprint
        print(f"{name:<10} {entry.common_name:<10} {words}{'' if here else '; its file is not in this folder'}")
        good = good and well
    for path in keyring.too_open():
        print(f"{path}: readable by others; chmod 600 {keyring.folder / path}")
        good = False
    return 0 if good else 1
