"""The arena page's routes: the page and its files, the socket, STOP by POST."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, MutableMapping
from pathlib import Path
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from groundstation.page_client import Client
from groundstation.page_live import Page

WEB = Path(__file__).parent / "web"
MOST_TEXT = 256 << 10
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'",
    "Cache-Control": "no-cache",
    "X-Content-Type-Options": "nosniff",
}


def application(page: Page) -> Starlette:
    """The routes: the page and its files, the socket, STOP by POST."""

    async def index(request: Request) -> Response:
        return FileResponse(WEB / "index.html", headers=HEADERS)

    async def stop(request: Request) -> Response:
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
