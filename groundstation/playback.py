"""A recording played through the arena page's state: any moment of it, forwards and backwards. Pure."""

from bisect import bisect_right
from collections.abc import Iterable
from typing import Any

from contract.arena import Arena
from contract.messages import (
    LogEntry,
    Message,
    MocapFrame,
    MocapHealth,
    RobotReport,
    RunStatus,
    StationHeartbeat,
    StopRequest,
    TargetCloud,
)
from groundstation.connectivity import summary
from groundstation.page_state import HISTORY_S, PageState

KINDS = (MocapFrame, MocapHealth, RobotReport, RunStatus, StationHeartbeat, StopRequest, TargetCloud)
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Of playing, times real time."""
STRIP_POINTS = 400
RECENT_NS = 1_000_000_000
"""Poses older than this leave no trace in a view."""
SAME_EVENT_NS = 200_000_000


class Playback:
    """``messages``: (time of arrival in ns of site time, message), in order.

    :raises ValueError: there is nothing to show.
    """

    def __init__(self, arena: Arena, messages: Iterable[tuple[int, Message]]) -> None:
        self.arena = arena
        self._messages = [(ns, m) for ns, m in messages if isinstance(m, KINDS) or _is_warning(m)]
        if not self._messages:
            raise ValueError("nothing to show: no poses, reports or status in the recording")
        self._times = [ns for ns, _ in self._messages]
        self.start_ns, self.end_ns = self._times[0], self._times[-1]
        self.at_ns = self.start_ns
        self.playing = False
        self.speed = 1.0
        self.strip = self._strip()
        """Algebraic connectivity over the whole recording: (s from the beginning, lambda_2)."""
        self.events = self._events()
        """When something happened: a phase, an occupied target, a stop, a change of a robot's state; ns."""
        self._next = 0
        self.state = PageState(arena, self.start_ns)
        self.seek(self.start_ns)

    def seek(self, at_ns: int) -> None:
        """The state of that moment."""
        at_ns = min(max(at_ns, self.start_ns), self.end_ns)
        if at_ns < self.at_ns:
            self.state, self._next = PageState(self.arena, self.start_ns), 0
        end = bisect_right(self._times, at_ns)
        for ns, message in self._messages[self._next : end]:
            if not isinstance(message, MocapFrame) or at_ns - ns <= RECENT_NS:
                self.state.receive(message, ns)
            if isinstance(message, RunStatus) and message.phase == "running":
                history = self.state.history
                if not history or message.elapsed_s - history[-1][0] >= HISTORY_S:
                    lambda2 = message.lambda2 if message.components else self.state.network(ns).lambda2
                    history.append((round(message.elapsed_s, 2), round(lambda2, 4)))
        self._next, self.at_ns = end, at_ns

    def advance(self, duration_ns: int) -> None:
        """Play on, until the end."""
        if self.playing:
            self.seek(self.at_ns + int(duration_ns * self.speed))
            self.playing = self.at_ns < self.end_ns

    def act(self, message: dict[str, Any]) -> str:
        """``seek`` with ``at`` (s from the beginning) or ``by`` (s), ``play`` with ``on``, ``event``, ``speed`` with
        ``by`` (steps of :data:`SPEEDS`); '' or why not."""
        match message.get("do"):
            case "seek":
                at, by = message.get("at"), message.get("by")
                if isinstance(at, int | float):
                    self.seek(self.start_ns + int(max(0.0, min(at, 1e6)) * 1e9))
                elif isinstance(by, int | float):
                    self.seek(self.at_ns + int(max(-1e6, min(by, 1e6)) * 1e9))
                else:
                    return "seek: at or by, seconds"
            case "play":
                self.playing = bool(message.get("on")) and self.at_ns < self.end_ns
            case "speed":
                by = message.get("by")
                if not isinstance(by, int):
                    return "speed: by, steps"
                self.speed = SPEEDS[max(0, min(len(SPEEDS) - 1, SPEEDS.index(self.speed) + by))]
            case "event":
                k = bisect_right(self.events, self.at_ns)
                self.seek(self.events[k] if k < len(self.events) else self.end_ns)
            case _:
                return "this is a replay; Esc for the live arena"
        return ""

    def view(self) -> dict[str, Any]:
        """The page's view of this moment; nothing in it can be pressed."""
        view = self.state.view(self.at_ns)
        run = view["run"]
        view["run"] = {"state": "REPLAY", "icon": "rewind", "tone": "violet", "sub": f"{run['state']} then, recorded"}
        view |= {"stop": None, "can": dict.fromkeys(view["can"], False), "checks": []}
        view["replay"] = {
            "at": round((self.at_ns - self.start_ns) / 1e9, 2),
            "to": round((self.end_ns - self.start_ns) / 1e9, 2),
            "playing": self.playing,
            "speed": self.speed,
        }
        return view

    def layout(self) -> dict[str, Any]:
        """The page's layout, with the times of the events, s from the beginning."""
        times = [round((ns - self.start_ns) / 1e9, 2) for ns in self.events]
        return self.state.layout() | {
            "replay": {"events": times, "strip": self.strip},
            "history": [],
            "marks": [],
            "events": [],
        }

    def _strip(self) -> list[tuple[float, float]]:
        """From the poses, of robots that are seen; so many points at most."""
        every_ns = max(1, (self.end_ns - self.start_ns) // STRIP_POINTS)
        due_ns, found = self.start_ns, []
        for ns, message in self._messages:
            if not isinstance(message, MocapFrame) or ns < due_ns:
                continue
            due_ns = ns + every_ns
            places = [(b.x_m, b.y_m) for b in message.bodies if b.valid and b.robot in self.arena.robots]
            lambda2, _ = summary(places, self.arena.control.sensing_radius_m)
            found.append((round((ns - self.start_ns) / 1e9, 2), round(lambda2, 4)))
        return found

    def _events(self) -> list[int]:
        found: list[int] = []
        known: dict[object, object] = {}
        for ns, message in self._messages:
            key: str
            value: tuple[str, int]
            match message:
                case RunStatus():
                    key, value = "status", (message.phase, len(message.occupied))
                case RobotReport():
                    key, value = message.robot, (message.run, 0)
                case StopRequest():
                    key, value = "stop", (str(message.stop_id), 0)
                case _:
                    continue
            new = known.get(key) not in (None, value) or (key == "stop" and key not in known)
            known[key] = value
            if new and (not found or ns - found[-1] > SAME_EVENT_NS):
                found.append(ns)
        return found


def _is_warning(message: Message) -> bool:
    return isinstance(message, LogEntry) and (message.level in ("warning", "error") or message.source == "recorder")
