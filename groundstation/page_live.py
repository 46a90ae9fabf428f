"""The page of a running arena: its clients, its state, and what it asks of the station. The station decides."""

import asyncio
import ipaddress
import secrets
import time
from typing import Any, cast, get_args

import msgspec
from starlette.requests import HTTPConnection

from contract.arena import Arena
from contract.messages import OrderRequest, Request, StopRequest, TargetCloud
from groundstation.page_client import Client
from groundstation.page_intake import Intake
from groundstation.page_seed import SeedError, cloud, points_of
from groundstation.page_state import PageState

VIEW_S = 0.05
WHOLE_NS = 200_000_000
"""Between whole views; in between go poses, but at news a whole view goes at once."""
STOP_POLL_S = 0.01
ASK_NS = 1_000_000_000
ASK_AGAIN_NS = 200_000_000


class Page:
    """The page's clients, its state, and what it asks of the station.

    Ages and repetitions go by this computer's own clock, which never jumps; site time is for stamps alone.
    """

    def __init__(self, arena: Arena, link: Intake, token: str) -> None:
        self.arena = arena
        self.state = PageState(arena, time.monotonic_ns())
        link.now_ns()  # the first call waits: before anybody is served
        self.clients: set[Client] = set()
        self._link = link
        self._token = token
        self._robots = tuple(arena.robots)
        self._whole_ns = 0
        self._news = -1
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
        stamped = msgspec.structs.replace(request, stamp_ns=self._link.stamp_ns())
        self._link.publish(self._link.keys.stop, stamped, "stop")

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
                robots: tuple[str, ...] = ()
                if order in ("exclude", "readmit"):
                    named = message.get("robots")
                    if not isinstance(named, list) or not named or not all(name in self._robots for name in named):
                        return f"{order}: a list of robots of the arena is needed"
                    robots = tuple(named)
                request = OrderRequest(stamp_ns=now_ns, source="page", number=number, order=order, robots=robots)
                self._ask(request, now_ns)
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
                stamped = msgspec.structs.replace(request, stamp_ns=self._link.stamp_ns())
                self._link.publish(keys.order, stamped, "order")
            case TargetCloud():
                self._link.publish(keys.seed, request, "seed")

    # --- the beat -----------------------------------------------------------------------------------

    async def run(self) -> None:
        """20 times a second a whole view or poses; while a STOP waits for answers the network is read every 10 ms."""
        view_due = time.monotonic()
        while True:
            self.turn(time.monotonic_ns())
            now = time.monotonic()
            if now >= view_due:
                view_due = view_due + VIEW_S if now - view_due < VIEW_S else now + VIEW_S
                self._show(time.monotonic_ns())
            left = view_due - time.monotonic()
            await asyncio.sleep(max(0.0, min(STOP_POLL_S, left) if self._waiting() else left))

    def _waiting(self) -> bool:
        """For answers to a STOP."""
        return self.state.latch.pressed is not None and bool(self.state.latch.silent)

    def turn(self, now_ns: int) -> None:
        """Take what has arrived, send what is due."""
        self.state.site_ahead_ns = self._link.now_ns() - time.monotonic_ns()
        for message, arrival_ns in self._link.take():
            self.state.receive(message, arrival_ns)
        self.state.attend(self._link.present, now_ns)
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

    def poses(self, now_ns: int) -> dict[str, Any] | None:
        """What goes to browsers between whole views; None where only a whole view will do."""
        return self.state.poses(now_ns)

    def _show(self, now_ns: int) -> None:
        """To every browser, encoded once: poses, or where it is time or there is news the whole view."""
        if not self.clients:
            self.state.remember(now_ns)
            return
        shown = self.shown()
        due = shown.news != self._news or now_ns - self._whole_ns > WHOLE_NS - VIEW_S * 0.5e9
        poses = None if due or self._waiting() else self.poses(now_ns)
        if poses is not None:
            moved = msgspec.json.encode(poses)
            for client in self.clients:
                client.move(moved)
            return
        self._whole_ns, self._news = now_ns, shown.news
        view = msgspec.json.encode(self.view(now_ns))
        for client in self.clients:
            if client.cloud_version != shown.cloud_version:
                client.cloud_version = shown.cloud_version
                client.answer(shown.targets())
            client.offer(view)

    # --- who may ------------------------------------------------------------------------------------

    def native(self, connection: HTTPConnection) -> bool:
        """Whether this browser shows our own page: the same origin, and without a token a host of this machine."""
        host = connection.headers.get("host", "")
        origin = connection.headers.get("origin")
        if origin is not None and origin.partition("://")[2] != host:
            return False
        return bool(self._token) or is_loopback(host.rsplit(":", 1)[0].strip("[]"))

    def allowed(self, token: object) -> bool:
        """May this browser do more than look and stop: off-host it needs the token."""
        if not self._token:
            return True
        return isinstance(token, str) and secrets.compare_digest(token.encode(), self._token.encode())


def is_loopback(host: str) -> bool:
    """A name or address of this machine only."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
