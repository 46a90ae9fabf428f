"""The arena page's server over real sockets, with the websockets package as the browser."""

import asyncio
import contextlib
import json
import socket
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from contract.arena import load
from contract.exposure import WARNING
from contract.keys import Keys
from contract.messages import Message, OrderRequest, RunStatus, StopRequest, TargetCloud
from groundstation import rig
from groundstation.page_client import Client
from groundstation.page_live import Page, is_loopback
from groundstation.page_server import told
from groundstation.page_web import MOST_TEXT, application, html

ARENA = load(rig.find_arena("experiment2"))


class Wire:
    """A router's stand-in: keeps what is published, hands over what is put in."""

    def __init__(self) -> None:
        self.keys = Keys(ARENA.arena.name)
        self.sent: list[tuple[str, Message]] = []
        self.arrived: list[tuple[Message, int]] = []
        self.present: set[str] = set()
        self.changed = threading.Condition()

    def now_ns(self) -> int:
        return time.monotonic_ns()

    stamp_ns = now_ns

    def publish(self, key: str, message: Message, channel: str) -> None:
        with self.changed:
            self.sent.append((key, message))
            self.changed.notify_all()

    def take(self) -> list[tuple[Message, int]]:
        taken, self.arrived = self.arrived, []
        return taken

    def wait_for(self, kind: type[Message]) -> Message:
        """The first published message of this kind."""
        with self.changed:
            assert self.changed.wait_for(lambda: any(isinstance(m, kind) for _, m in self.sent), 10.0)
            return next(m for _, m in self.sent if isinstance(m, kind))


class Served:
    def __init__(self, token: str = "") -> None:
        self.wire = Wire()
        self.page = Page(ARENA, self.wire, token)  # type: ignore[arg-type]
        config = uvicorn.Config(
            application(self.page), port=0, log_level="error", ws_per_message_deflate=False, ws_max_size=MOST_TEXT
        )
        self.server = uvicorn.Server(config)
        self.started = threading.Event()
        self.thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    async def _serve(self) -> None:
        serving = asyncio.create_task(self.server._serve())
        while not self.server.started:
            await asyncio.sleep(0.005)
        self.port = self.server.servers[0].sockets[0].getsockname()[1]
        self.started.set()
        await serving

    def __enter__(self) -> "Served":
        self.thread.start()
        assert self.started.wait(20.0)
        return self

    def __exit__(self, *exception: object) -> None:
        self.server.should_exit = self.server.force_exit = True
        self.thread.join(10.0)

    def socket(self, **options: Any) -> ClientConnection:
        """To be used in a ``with`` block."""
        return connect(f"ws://127.0.0.1:{self.port}/ws", compression=None, **options)

    def socket_by_name(self, name: str) -> ClientConnection:
        """As a browser comes that was told this name for 127.0.0.1."""
        return connect(f"ws://{name}/ws", sock=socket.create_connection(("127.0.0.1", self.port)), compression=None)

    def post(self, path: str, body: bytes, **headers: str) -> dict[str, Any]:
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", body, headers, method="POST")
        with urllib.request.urlopen(request, timeout=10) as response:
            answer: dict[str, Any] = json.load(response)
            return answer

    def get(self, path: str) -> tuple[bytes, str]:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=10) as response:
            return response.read(), response.headers["Content-Security-Policy"]


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as running:
        yield running


def kinds(browser: ClientConnection, wanted: str) -> dict[str, Any]:
    """The next message of a kind."""
    for _ in range(500):
        message: dict[str, Any] = json.loads(browser.recv(timeout=10))
        if message["kind"] == wanted:
            return message
    raise AssertionError(f"no {wanted} in 500 messages")


def ask(browser: ClientConnection, **message: object) -> str:
    browser.send(json.dumps({"to": 1, **message}))
    answer = kinds(browser, "answer")
    assert answer["to"] == 1
    text: str = answer["text"]
    return text


def test_page_and_every_file_it_names_come_from_here(served: Served) -> None:
    web = Path(rig.__file__).parent / "web"
    body, policy = served.get("/")
    assert b"STOP ALL" in body
    assert "default-src 'self'" in policy
    for file in sorted(p for p in web.rglob("*") if p.is_file()):
        assert served.get(f"/web/{file.relative_to(web).as_posix()}")[0] == file.read_bytes()
    code = "".join(p.read_text() for p in web.rglob("*") if p.suffix in (".js", ".css", ".html"))
    assert "http://" not in code
    assert "https://" not in code


def test_a_browser_gets_layout_then_views(served: Served) -> None:
    with served.socket() as browser:
        assert json.loads(browser.recv(timeout=10))["kind"] == "layout"
        view = kinds(browser, "view")
    assert view["run"]["state"] == "NO STATION"
    assert [row["id"] for row in view["robots"]] == list(ARENA.robots)


def test_stop_by_both_paths_is_one_press(served: Served) -> None:
    with served.socket() as browser:
        browser.send(json.dumps({"do": "stop", "id": 77, "source": "Space"}))
        assert served.post("/stop", b'{"id": 77, "source": "Space"}') == {"stop_id": 77}
        for _ in range(100):
            stop = kinds(browser, "view")["stop"]
            if stop and stop["known"]:
                break
    assert served.wire.wait_for(StopRequest).source == "Space"  # type: ignore[attr-defined]
    assert {m.stop_id for _, m in served.wire.sent if isinstance(m, StopRequest)} == {77}
    assert stop["silent"] == list(ARENA.robots)


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b'{"id": "x", "source": 5}', b'{"id": -1}', b'{"id": 1e99}'])
def test_stop_works_whatever_the_body_and_wherever_from(served: Served, body: bytes) -> None:
    assert served.post("/stop", body, Origin="http://elsewhere.example", Host="elsewhere.example")["stop_id"] > 0
    assert isinstance(served.wire.wait_for(StopRequest), StopRequest)


def test_only_this_page_gets_a_socket_and_may_order(served: Served) -> None:
    here = f"http://127.0.0.1:{served.port}"
    with pytest.raises(InvalidStatus), served.socket(origin="http://elsewhere.example"):
        pass
    with pytest.raises(InvalidStatus), served.socket_by_name("rebound.example"):
        pass
    assert not served.wire.sent
    with served.socket(origin=here) as browser:
        assert ask(browser, do="order", order="arm") == ""
    assert served.wire.wait_for(OrderRequest).order == "arm"  # type: ignore[attr-defined]


def test_an_oversized_stop_is_obeyed_and_its_body_is_not_read(served: Served) -> None:
    body = b'{"id": 5, "source": "' + b"x" * (1 << 20) + b'"}'
    with contextlib.suppress(OSError):
        served.post("/stop", body)
    stop = served.wire.wait_for(StopRequest)
    assert (stop.source, stop.stop_id != 5) == ("the page", True)  # type: ignore[attr-defined]


def test_an_oversized_message_ends_the_socket_and_orders_nothing(served: Served) -> None:
    with served.socket() as browser:
        browser.send(json.dumps({"do": "order", "order": "arm", "pad": "x" * (MOST_TEXT + 1)}))
        with contextlib.suppress(ConnectionClosed):
            while True:
                browser.recv(timeout=10)
        assert browser.close_code == 1009
    assert not served.wire.sent


def test_no_page_of_others_may_hold_this_one_in_a_frame(served: Served) -> None:
    _, policy = served.get("/")
    assert "frame-ancestors 'none'" in policy
    assert "script-src" not in policy, "scripts come from here alone, by default-src"
    assert "default-src 'self'" in policy


def test_an_open_link_is_said_on_the_page() -> None:
    assert 'role="alert"' not in html("")
    assert "INSECURE LINK: anybody" in html(WARNING)


def test_the_token_is_kept_out_of_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert told("") == ""
    for token in ("first-secret", "second-secret"):
        words = told(token)
        assert "secret" not in words
        path = tmp_path / "ahdc" / "page-token"
        assert str(path) in words
        assert (path.read_text(), path.stat().st_mode & 0o777) == (f"{token}\n", 0o600)


def test_off_host_the_token_is_needed_for_orders_never_for_stop() -> None:
    with Served(token="secret") as served, served.socket() as browser:
        assert "not allowed" in ask(browser, do="order", order="arm")
        assert "not allowed" in ask(browser, do="seed", points=[[1, 1]], token="wrong")
        assert ask(browser, do="order", order="arm", token="secret") == ""
        browser.send(json.dumps({"do": "stop"}))
        assert isinstance(served.wire.wait_for(StopRequest), StopRequest)


def test_while_stopped_nothing_but_the_word_is_heeded(served: Served) -> None:
    with served.socket() as browser:
        served.post("/stop", b"{}")
        for order in ("arm", "run", "hold", "disarm"):
            assert ask(browser, do="order", order=order) == "stopped: release first"
        assert ask(browser, do="release", typed="RELEASE").startswith("type RELEASE-NOT-6-8")
    assert not [m for _, m in served.wire.sent if isinstance(m, OrderRequest)]


def test_a_drop_names_robots_of_the_arena(served: Served) -> None:
    act, name = served.page.act, next(iter(ARENA.robots))
    for robots in (None, [], ["r99"], name, [name, 3]):
        assert "list of robots" in act({"do": "order", "order": "exclude", "robots": robots})
    assert act({"do": "order", "order": "exclude", "robots": [name]}) == ""
    request = served.wire.wait_for(OrderRequest)
    assert isinstance(request, OrderRequest)
    assert (request.order, request.robots) == ("exclude", (name,))


def test_targets_go_to_the_station_checked(served: Served) -> None:
    with served.socket() as browser:
        assert "beyond the fence" in ask(browser, do="seed", points=[[9, 1]])
        assert ask(browser, do="seed", points=[[1, 1]]) == "targets change only while disarmed"
        served.wire.arrived.append((RunStatus(stamp_ns=0, phase="ready"), 0))
        kinds(browser, "view")
        kinds(browser, "view")
        assert ask(browser, do="seed", points=[[1, 1], [1.5, 1.25]]) == ""
    wish = served.wire.wait_for(TargetCloud)
    assert [(t.x_m, t.y_m) for t in wish.targets] == [(1.0, 1.0), (1.5, 1.25)]  # type: ignore[attr-defined]


def test_what_a_browser_may_not_say_is_answered(served: Served) -> None:
    with served.socket() as browser:
        for text in ("", "{", "[]", "null", '"stop"'):
            browser.send(text)
            assert "JSON object" in kinds(browser, "answer")["text"]
        assert "no such request" in ask(browser, do="fly")
        assert "order 'jump'" in ask(browser, do="order", order="jump")
        assert kinds(browser, "view")["kind"] == "view"


def test_a_frozen_browser_delays_no_other(served: Served) -> None:
    """It takes nothing, its buffers fill, and the other still gets every new view."""
    with served.socket(max_queue=1, close_timeout=0.1) as frozen:
        kinds(frozen, "layout")
        (stuck,) = served.page.clients
        with served.socket() as live:
            kinds(live, "view")
            stuck.answer({"kind": "filler", "text": "x" * 40_000_000})
            stamps = [json.loads(live.recv(timeout=10))["t"] for _ in range(60)]
            assert stamps == sorted(set(stamps))
        frozen.socket.close()


def test_the_slots_keep_only_the_newest_and_never_poses_alone_of_what_was_not_taken() -> None:
    async def scene() -> list[list[bytes]]:
        client, taken = Client(), []
        for view in (b"1", b"2", b"3"):
            client.offer(view)
            client.move(view + b"a")
            client.move(view + b"b")
        client.answer({"kind": "answer"})
        taken.append(await client.next())
        client.move(b"3c")
        client.offer(b"4")
        taken.append(await client.next())
        client.move(b"4a")
        client.move(b"4b")
        taken.append(await client.next())
        return taken

    assert asyncio.run(scene()) == [[b'{"kind":"answer"}', b"3", b"3b"], [b"4"], [b"4b"]]


@pytest.mark.parametrize(
    ("host", "here"),
    [("localhost", True), ("127.0.0.1", True), ("127.9.9.9", True), ("::1", True), ("0.0.0.0", False), ("a.b", False)],
)
def test_loopback(host: str, here: bool) -> None:
    assert is_loopback(host) == here
