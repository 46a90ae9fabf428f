"""``page``: the arena page's server. Its own client session of the router; it only asks, the station decides.

Every browser has one slot, newest view wins, so a frozen browser delays no other. STOP comes in by WebSocket
and by POST, needs no token, no focus and no session, and is repeated here until every robot has answered.
"""

import argparse
import asyncio
import contextlib
import ipaddress
import secrets
import signal
import sys
import time
from collections import deque
from collections.abc import AsyncIterator, MutableMapping
from pathlib import Path
from typing import Any, cast, get_args

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection
from starlette.requests import Request as HttpRequest
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from contract.arena import Arena, load
from contract.codec import WireError, decode
from contract.messages import Message, OrderRequest, Request, StopRequest, TargetCloud
from groundstation.current import recall
from groundstation.link import Link, LinkError
from groundstation.page_seed import SeedError, cloud, points_of
from groundstation.page_state import PageState

WEB = Path(__file__).parent / "web"
DEFAULT_PORT = 8765
VIEW_S = 0.05
STOP_POLL_S = 0.01
ASK_NS = 1_000_000_000
ASK_AGAIN_NS = 200_000_000
LINES = 5_000
MOST_TEXT = 256 << 10
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'",
    "Cache-Control": "no-cache",
    "X-Content-Type-Options": "nosniff",
}


class Intake(Link):
    """The newest message of every key, and every STOP and log line, each with its time of arrival (ns)."""

    def __init__(self, arena: Arena, source: str, timeout_s: float = 10.0) -> None:
        super().__init__(arena, source, timeout_s)
        self._newest: dict[str, tuple[bytes, int]] = {}
        self._lines: deque[tuple[str, bytes, int]] = deque(maxlen=LINES)

    def listen(self, arena: Arena) -> None:
        keys = self.keys
        self.subscribe([keys.mocap_frame, keys.mocap_health, keys.status, keys.targets, keys.heartbeat, keys.stop])
        self.subscribe([f"{keys.site}/log/**", *(keys.report(robot) for robot in arena.robots)])

    def _store(self, sample: Any) -> None:
        key, payload, now_ns = str(sample.key_expr), sample.payload.to_bytes(), time.monotonic_ns()
        if key == self.keys.stop or "/log/" in key:
            self._lines.append((key, payload, now_ns))
        else:
            self._newest[key] = (payload, now_ns)

    def take(self) -> list[tuple[Message, int]]:
        """What has come since, in order of arrival; what does not decode is counted."""
        raw = [self._lines.popleft() for _ in range(len(self._lines))]
        with contextlib.suppress(KeyError):
            for _ in range(len(self._newest)):
                key, (payload, arrival_ns) = self._newest.popitem()
                raw.append((key, payload, arrival_ns))
        messages = []
        for key, payload, arrival_ns in sorted(raw, key=lambda entry: entry[2]):
            kind = self.keys.kind(key)
            try:
                if kind is not None:
                    messages.append((decode(kind, payload), arrival_ns))
            except WireError:
                self.refused += 1
        return messages


class Client:
    """One browser: a slot for the newest view, a short queue for answers."""

    def __init__(self) -> None:
        self.answers: deque[bytes] = deque(maxlen=64)
        self.cloud_version = -1
        self._view = b""
        self._wake = asyncio.Event()

    def offer(self, view: bytes) -> None:
        """The newest view; one that has not been taken is replaced."""
        self._view = view
        self._wake.set()

    def answer(self, message: dict[str, Any]) -> None:
        self.answers.append(msgspec.json.encode(message))
        self._wake.set()

    async def next(self) -> list[bytes]:
        """Answers and the newest view, once there is something."""
        await self._wake.wait()
        self._wake.clear()
        out = list(self.answers)
        self.answers.clear()
        if self._view:
            out.append(self._view)
            self._view = b""
        return out


class Page:
    """The page's clients, its state, and what it asks of the station."""

    def __init__(self, arena: Arena, link: Intake, token: str) -> None:
        self.arena = arena
        self.state = PageState(arena, time.monotonic_ns())
        self.clients: set[Client] = set()
        self._link = link
        self._token = token
        self._asked: list[tuple[OrderRequest | TargetCloud, int]] = []
        self._ask_due_ns = 0

    # --- stop: first, and free of every condition ---------------------------------------------------

    def stop(self, stop_id: object, source: object) -> int:
        """Send STOP before anything else; returns its number."""
        now_ns = time.monotonic_ns()
        number = stop_id if type(stop_id) is int and 0 < stop_id < 1 << 53 else time.time_ns() // 1_000_000
        words = source if isinstance(source, str) and 0 < len(source) <= 40 else "the page"
        pressed = self.state.latch.pressed
        if pressed is None or pressed.stop_id != number:
            self.state.note(f"STOP sent by {words}", "error", now_ns)
        self._publish_stop(self.state.latch.press(number, words, now_ns))
        self._asked.clear()
        return number

    def _publish_stop(self, request: StopRequest) -> None:
        self._link.publish(self._link.keys.stop, request, "stop")

    # --- the other orders ---------------------------------------------------------------------------

    def act(self, message: dict[str, Any]) -> str:
        """Do what a browser asks; '' if it is under way, else why not."""
        now_ns = time.monotonic_ns()
        number = time.time_ns() // 1_000_000
        match message.get("do"):
            case "order":
                order = message.get("order")
                if order not in get_args(Request):
                    return f"order {order!r}: {', '.join(get_args(Request))}"
                order = cast(Request, order)
                if self.state.latch.pressed is not None or (order == "disarm" and self._stopped()):
                    return "stopped: release first"
                self._ask(OrderRequest(stamp_ns=now_ns, source="page", number=number, order=order), now_ns)
            case "release":
                typed = str(message.get("typed", ""))[:2000].strip().upper()
                silent = self.state.silent(now_ns)
                if refusal := self.state.latch.release(typed, silent, number, "page", now_ns):
                    return refusal
                self.state.note("Release typed", "info", now_ns)
            case "seed":
                try:
                    wish = cloud(
                        self.arena, points_of(message.get("points")), f"{self.arena.arena.name}-{number % 1_000_000}"
                    )
                except SeedError as error:
                    return str(error)
                status = self.state.status
                if status is None or status.phase not in ("waiting", "ready"):
                    return "targets change only while disarmed"
                self._ask(wish, now_ns)
            case other:
                return f"no such request: {other!r}"
        return ""

    def _stopped(self) -> bool:
        return any(report.run == "stopped" for report in self.state.reports().values())

    def _ask(self, request: OrderRequest | TargetCloud, now_ns: int) -> None:
        kind = type(request)
        self._asked = [entry for entry in self._asked if type(entry[0]) is not kind]
        self._asked.append((request, now_ns + ASK_NS))
        self._ask_due_ns = 0

    def _publish(self, request: OrderRequest | TargetCloud | StopRequest) -> None:
        keys = self._link.keys
        match request:
            case StopRequest():
                self._publish_stop(request)
            case OrderRequest():
                self._link.publish(keys.order, request, "order")
            case TargetCloud():
                self._link.publish(keys.seed, request, "seed")

    # --- the beat -----------------------------------------------------------------------------------

    async def run(self) -> None:
        """20 views a second; while a STOP waits for answers the network is read every 10 ms."""
        view_due = time.monotonic()
        while True:
            self.turn(time.monotonic_ns())
            now = time.monotonic()
            if now >= view_due:
                view_due = view_due + VIEW_S if now - view_due < VIEW_S else now + VIEW_S
                self._show()
            waiting = self.state.latch.pressed is not None and self.state.latch.silent
            left = view_due - time.monotonic()
            await asyncio.sleep(max(0.0, min(STOP_POLL_S, left) if waiting else left))

    def turn(self, now_ns: int) -> None:
        """Take what has arrived, send what is due."""
        for message, arrival_ns in self._link.take():
            self.state.receive(message, arrival_ns)
        for request in self.state.latch.due(now_ns):
            self._publish(request)
        if self._asked and now_ns >= self._ask_due_ns:
            self._ask_due_ns = now_ns + ASK_AGAIN_NS
            self._asked = [entry for entry in self._asked if now_ns < entry[1]]
            for asked, _ in self._asked:
                self._publish(asked)

    def layout(self) -> dict[str, Any]:
        return self.state.layout()

    def view(self, now_ns: int) -> dict[str, Any]:
        return self.state.view(now_ns)

    def shown(self) -> PageState:
        """Of which moment the views are."""
        return self.state

    def _show(self) -> None:
        if not self.clients:
            self.state.network(time.monotonic_ns())
            return
        view = msgspec.json.encode(self.view(time.monotonic_ns()))
        shown = self.shown()
        for client in self.clients:
            if client.cloud_version != shown.cloud_version:
                client.cloud_version = shown.cloud_version
                client.answer(shown.targets())
            client.offer(view)

    # --- who may ------------------------------------------------------------------------------------

    def allowed(self, connection: HTTPConnection, token: object) -> bool:
        """May this browser do more than look and stop: same origin, and off-host the token."""
        host = connection.headers.get("host", "")
        origin = connection.headers.get("origin")
        if origin is not None and origin.partition("://")[2] != host:
            return False
        if self._token:
            return isinstance(token, str) and secrets.compare_digest(token.encode(), self._token.encode())
        return is_loopback(host.rsplit(":", 1)[0].strip("[]"))


def is_loopback(host: str) -> bool:
    """A name or address of this machine only."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def application(page: Page) -> Starlette:
    """The routes: the page and its files, the socket, STOP by POST."""

    async def index(request: HttpRequest) -> Response:
        return FileResponse(WEB / "index.html", headers=HEADERS)

    async def stop(request: HttpRequest) -> Response:
        try:
            body = msgspec.json.decode(await request.body())
        except msgspec.DecodeError:
            body = {}
        body = body if isinstance(body, dict) else {}
        return JSONResponse({"stop_id": page.stop(body.get("id"), body.get("source"))})

    async def socket(websocket: WebSocket) -> None:
        await websocket.accept()
        client = Client()
        client.answer(page.layout())
        page.clients.add(client)
        sender = asyncio.create_task(_send(websocket, client))
        try:
            while True:
                _heard(page, websocket, client, await websocket.receive_text())
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass
        finally:
            page.clients.discard(client)
            sender.cancel()

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(page.run())
        yield
        task.cancel()

    routes = [
        Route("/", index),
        Route("/stop", stop, methods=["POST"]),
        WebSocketRoute("/ws", socket),
        Mount("/web", Files(directory=WEB)),
    ]
    return Starlette(routes=routes, lifespan=lifespan)


class Files(StaticFiles):
    """The page's own files, checked anew by the browser: an upgrade shows at once."""

    async def get_response(self, path: str, scope: MutableMapping[str, Any]) -> Response:
        response = await super().get_response(path, scope)
        response.headers.update(HEADERS)
        return response


def _heard(page: Page, websocket: WebSocket, client: Client, text: str) -> None:
    """One message of a browser; what cannot be read is answered, never fatal."""
    try:
        message = msgspec.json.decode(text)
    except msgspec.DecodeError:
        message = None
    if not isinstance(message, dict) or len(text) > MOST_TEXT:
        client.answer({"kind": "answer", "to": None, "text": "a JSON object is needed"})
    elif message.get("do") == "stop":
        page.stop(message.get("id"), message.get("source"))
    elif not page.allowed(websocket, message.get("token")):
        text = "not allowed from here: open the page by the address its server printed"
        client.answer({"kind": "answer", "to": message.get("to"), "text": text})
    else:
        client.answer({"kind": "answer", "to": message.get("to"), "text": page.act(message)})


async def _send(websocket: WebSocket, client: Client) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            for message in await client.next():
                await websocket.send_text(message.decode())


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
    path = args.arena or recall()
    if path is None:
        print("which arena? --arena FILE (no session was started on this machine)", file=sys.stderr)
        return 2
    if not 0 <= args.port <= 65535:
        print(f"--port {args.port}: 0 to 65535", file=sys.stderr)
        return 2
    arena = load(path)
    token = "" if is_loopback(args.host) else secrets.token_urlsafe(12)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    try:
        link = Intake(arena, "page")
        with link:
            link.listen(arena)
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
            live.listen(arena)
            link = live
        return asyncio.run(_serve(ReplayPage(arena, link, token, playback), args.host, args.port, token))


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
        print(f"READY page http://{shown}:{number}/{'#token=' + token if token else ''}", flush=True)
    try:
        await serving
    except SystemExit:
        print(f"cannot listen on {host}:{port}; choose another --port", file=sys.stderr)
        return 1
    return 0
