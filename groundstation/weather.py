"""What a bad radio does to frames: which are lost, which come late. Pure: times and dice come from outside."""

import heapq
import random

import msgspec


class Weather(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the radio does to frames."""

    loss: float = 0.0
    """Probability, each way."""
    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    overtaking: bool = False
    """Late frames are overtaken by later ones. A radio cell keeps the order of a station's frames."""
    cut: tuple[str, ...] = ()
    """Ports through which nothing passes."""


class Sky:
    """Which frames pass, and when."""

    def __init__(self, dice: random.Random) -> None:
        self.weather = Weather()
        self.passed = self.lost = 0
        self._dice = dice
        self._waiting: list[tuple[int, int, str, bytes]] = []
        self._last_ns: dict[tuple[str, str], int] = {}
        """When the last frame of a port and direction leaves."""
        self._number = 0

    def take(self, frame: bytes, port: str, to: str, now_ns: int) -> None:
        """One frame from or for ``port``, to leave by ``to`` when its time has come."""
        weather = self.weather
        if port in weather.cut or self._dice.random() < weather.loss:
            self.lost += 1
            return
        self.passed += 1
        late_ms = weather.delay_ms + weather.jitter_ms * self._dice.random()
        self._number += 1
        due_ns = now_ns + round(late_ms * 1e6)
        if not weather.overtaking:
            due_ns = max(due_ns, self._last_ns.get((port, to), 0))
        self._last_ns[port, to] = due_ns
        heapq.heappush(self._waiting, (due_ns, self._number, to, frame))

    def due(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Frames whose time has come, with the port they leave by."""
        out = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            _, _, to, frame = heapq.heappop(self._waiting)
            out.append((to, frame))
        return out

    @property
    def next_ns(self) -> int | None:
        return self._waiting[0][0] if self._waiting else None
