"""The arena page's routes: the page and its files, the socket, STOP by POST.

A page of another origin gets no socket. A STOP is obeyed from anywhere and whatever its body: the safe way to err.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator, MutableMapping
from html import escape
from pathlib import Path
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from contract.exposure import exposure
from groundstation.page_client import Client
from groundstation.page_live import Page

WEB = Path(__file__).parent / "web"
MOST_TEXT = 256 << 10
MOST_STOP = 4 << 10
BANNER = (
    "position:fixed;z-index:9;top:0;left:50%;transform:translateX(-50%);padding:1px 14px;border-radius:0 0 8px 8px;"
    "background:var(--amber);color:var(--on-amber);font-size:14px;font-weight:700;pointer-events:none"
)
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
    "X-Content-Type-Options": "nosniff",
}


def application(page: Page) -> Starlette:
    """The routes: the page and its files, the socket, STOP by POST."""

    async def index(request: Request) -> Response:
        return HTMLResponse(html(exposure((page.arena.link.router,), page.arena.link.keys)), headers=HEADERS)

    async def stop(request: Request) -> Response:
        content, whole = await _read(request)
        try:
            body = msgspec.json.decode(content)
        except msgspec.DecodeError:
            body = {}
        body = body if isinstance(body, dict) else {}
        answer = {"stop_id": page.stop(body.get("id"), body.get("source"))}
        return JSONResponse(answer, 200 if whole else 413, headers=HEADERS)

    async def socket(websocket: WebSocket) -> None:
        if not page.native(websocket):
            await websocket.close()
            return
        await websocket.accept()
        client = Client()
        client.answer(page.layout())
        page.clients.add(client)
        sender = asyncio.create_task(_send(websocket, client))
        try:
            while True:
                _heard(page, client, await websocket.receive_text())
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


async def _read(request: Request) -> tuple[bytes, bool]:
    """The body, or as much of it as a STOP may have; and whether that is all."""
    content = b""
    async for chunk in request.stream():
        content += chunk
        if len(content) > MOST_STOP:
            return b"", False
    return content, True


def html(warning: str) -> str:
    """The page, with a warning on top where there is one."""
    text = (WEB / "index.html").read_text(encoding="utf-8")
    banner = f'<p role="alert" style="{BANNER}">{escape(warning)}</p>' if warning else ""
    return text.replace("</body>", f"{banner}</body>")


def _heard(page: Page, client: Client, text: str) -> None:
    """One message of a browser; what cannot be read is answered, never fatal."""
    try:
        message = msgspec.json.decode(text)
    except msgspec.DecodeError:
        message = None
    if not isinstance(message, dict) or len(text) > MOST_TEXT:
        client.answer({"kind": "answer", "to": None, "text": "a JSON object is needed"})
    elif message.get("do") == "stop":
        page.stop(message.get("id"), message.get("source"))
    elif not page.allowed(message.get("token")):
        text = "not allowed from here: open the page by the address its server printed"
        client.answer({"kind": "answer", "to": message.get("to"), "text": text})
    else:
        client.answer({"kind": "answer", "to": message.get("to"), "text": page.act(message)})


async def _send(websocket: WebSocket, client: Client) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            for message in await client.next():
                await websocket.send_text(message.decode())
