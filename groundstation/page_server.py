"""``page``: the arena page's server. Its own client session of the router; it only asks, the station decides.

Every browser has one slot, newest view wins, so a frozen browser delays no other. STOP comes in by WebSocket
and by POST, needs no token, no focus and no session, and is repeated here until every robot has answered.
"""

import argparse
import asyncio
import contextlib
import os
import secrets
import signal
import sys
from pathlib import Path

import uvicorn

from groundstation.current import arena_of, state_folder
from groundstation.link import LinkError
from groundstation.page_intake import Intake
from groundstation.page_live import Page, is_loopback
from groundstation.page_web import MOST_TEXT, application

DEFAULT_PORT = 8765


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file (the one of the session started last)")
    parser.add_argument("--port", type=int, default=DEFAULT_PORT, help="TCP port; 0 for a free one (%(default)s)")
    parser.add_argument("--replay", type=Path, metavar="RUN", help="show this run folder or recording, with a scrubber")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen on (%(default)s); another one needs a token, printed here, but never for STOP",
    )


def run(args: argparse.Namespace) -> int:
    """Serve until SIGTERM or Ctrl-C."""
    if args.replay is not None:
        return _replay(args)
    if not 0 <= args.port <= 65535:
        print(f"--port {args.port}: 0 to 65535", file=sys.stderr)
        return 2
    arena = arena_of(args.arena)
    token = "" if is_loopback(args.host) else secrets.token_urlsafe(12)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    try:
        link = Intake(arena, "page")
        with link:
            link.listen()
            return asyncio.run(_serve(Page(arena, link, token), args.host, args.port, token))
    except LinkError as error:
        print(error, file=sys.stderr)
        return 1


def _replay(args: argparse.Namespace) -> int:
    """Serve a recording; STOP goes to its arena, if its router answers."""
    from groundstation.page_replay import NoLink, ReplayPage
    from groundstation.playback import Playback
    from groundstation.recording import Recording, RecordingError
    from groundstation.runfolder import recording_path

    try:
        recording = Recording(recording_path(args.replay))
        arena = recording.arena()
        playback = Playback(arena, ((m.log_ns, m.message) for m in recording.messages() if m.message is not None))
    except (RecordingError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    token = "" if is_loopback(args.host) else secrets.token_urlsafe(12)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    with contextlib.ExitStack() as stack:
        link: Intake = NoLink(arena)
        with contextlib.suppress(LinkError):
            live = Intake(arena, "page", timeout_s=1.0)
            stack.enter_context(live)
            live.listen()
            link = live
        return asyncio.run(_serve(ReplayPage(arena, link, token, playback), args.host, args.port, token))


def told(token: str) -> str:
    """What follows the address: the token on a terminal, the file it is in where this is a log."""
    if not token or sys.stdout.isatty():
        return f"#token={token}" if token else ""
    path = state_folder() / "page-token"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(f"{token}\n")
    return f"#token=... (in {path})"


async def _serve(page: Page, host: str, port: int, token: str) -> int:
    config = uvicorn.Config(
        application(page),
        host=host,
        port=port,
        log_level="warning",
        access_log=False,
        timeout_graceful_shutdown=1,
        ws_max_size=MOST_TEXT,
        ws_per_message_deflate=False,
    )
    server = uvicorn.Server(config)
    serving = asyncio.create_task(server.serve())
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    if server.started:
        number = server.servers[0].sockets[0].getsockname()[1]
        shown = f"[{host}]" if ":" in host else host
        print(f"READY page http://{shown}:{number}/{told(token)}", flush=True)
    try:
        await serving
    except SystemExit:
        print(f"cannot listen on {host}:{port}; choose another --port", file=sys.stderr)
        return 1
    return 0
