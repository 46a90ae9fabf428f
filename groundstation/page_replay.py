"""The arena page over a recording. STOP stays what it is: it leaves the replay and goes to the live arena's robots."""

from typing import Any

from contract.arena import Arena
from contract.keys import Keys
from contract.messages import Message
from contract.site_clock import SiteClock
from groundstation.page_intake import Intake
from groundstation.page_live import Page
from groundstation.playback import Playback

TURN_MOST_NS = 500_000_000


class NoLink(Intake):
    """No router answers: a STOP finds nobody, and the page says NOT CONFIRMED."""

    def __init__(self, arena: Arena) -> None:
        self.keys = Keys(arena.arena.name)
        self.refused = 0
        self._clock = SiteClock()
        self.present = set()

    def publish(self, key: str, message: Message, channel: str) -> None:
        return

    def now_ns(self) -> int:
        return self.stamp_ns()

    def take(self) -> list[tuple[Message, int]]:
        return []


class ReplayPage(Page):
    """Shows the playback until STOP or Esc, then the live arena."""

    def __init__(self, arena: Arena, link: Intake, token: str, playback: Playback) -> None:
        super().__init__(arena, link, token)
        self.playback = playback
        self.replaying = True
        self._turned_ns = 0

    def layout(self) -> dict[str, Any]:
        return self.playback.layout() if self.replaying else super().layout()

    def view(self, now_ns: int) -> dict[str, Any]:
        if not self.replaying:
            return super().view(now_ns)
        return self.playback.view()

    def poses(self, now_ns: int) -> dict[str, Any] | None:
        return None if self.replaying else super().poses(now_ns)

    def shown(self) -> Any:
        return self.playback.state if self.replaying else super().shown()

    def stop(self, stop_id: object, source: object) -> int:
        number = super().stop(stop_id, source)
        self.leave()
        return number

    def act(self, message: dict[str, Any]) -> str:
        if not self.replaying:
            return super().act(message)
        if message.get("do") == "live":
            self.leave()
            return ""
        return self.playback.act(message)

    def turn(self, now_ns: int) -> None:
        super().turn(now_ns)
        if self._turned_ns:
            self.playback.advance(min(now_ns - self._turned_ns, TURN_MOST_NS))
        self._turned_ns = now_ns
        if self.state.latch.pressed is not None:
            self.leave()

    def leave(self) -> None:
        """To the live arena."""
        if self.replaying:
            self.replaying = False
            for client in self.clients:
                client.cloud_version = -1
                client.answer(self.layout())
