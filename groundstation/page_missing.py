"""Which process of the station is missing, what that means and what to do, in words for the arena page. Pure.

Presence is a liveliness token: it ends with its process at once, long before silence would tell. A network in trouble
may lose the token of a process that lives: who is heard is there. It is no safety signal: robots go by heartbeat and
poses.
"""

from collections.abc import Collection
from typing import NamedTuple

from contract.arena import Arena
from groundstation.page_reasons import Level, seconds

ROUTER, BRIDGE, STATION, RECORDER, PAGE = "router", "mocap_bridge", "station", "recorder", "page"


class Missing(NamedTuple):
    """One process that was here and is not."""

    part: str
    level: Level
    short: str
    """What it means, in the bar."""
    title: str
    since_s: float
    value: str
    why: str
    now: str
    do: str


class Roll:
    """Who has been here, and since when each is gone."""

    def __init__(self) -> None:
        self.present: frozenset[str] = frozenset()
        self.gone_ns: dict[str, int] = {}
        """Source -> when its token ended."""

    def call(self, present: Collection[str], now_ns: int) -> tuple[list[str], list[str]]:
        """Take who is here now; (come, gone) since the last call."""
        here = frozenset(present)
        come, gone = sorted(here - self.present), sorted(self.present - here)
        self.present = here
        self.gone_ns.update((source, now_ns) for source in gone)
        for source in come:
            self.gone_ns.pop(source, None)
        return come, gone

    def heard(self, source: str) -> None:
        """It speaks, so it is there, whatever became of its token."""
        self.gone_ns.pop(source, None)

    def since_s(self, source: str, now_ns: int) -> float | None:
        """Since when it is gone; None while it is here or was never seen."""
        gone_ns = self.gone_ns.get(source)
        return None if gone_ns is None else (now_ns - gone_ns) / 1e9


def missing(arena: Arena, roll: Roll, station_silent_s: float | None, now_ns: int) -> list[Missing]:
    """What is missing, the gravest first.

    :param station_silent_s: since its last status; None while it is heard or has never been.
    """
    safety = arena.safety
    bridge_s = roll.since_s(BRIDGE, now_ns)
    if bridge_s is not None and not roll.present - {PAGE}:
        return [
            Missing(
                ROUTER, "fault", "robots hold, then stop", "Router gone", bridge_s, seconds(bridge_s),
                "Every process has left the network at once: the router ended, or this computer's network is down",
                f"Robots hold after {safety.pose_silence_s:g} s without poses and stop after "
                f"{4 * safety.heartbeat_timeout_s:g} s without the station. STOP does not reach them",
                "Start it: ahdc-mocap-bridge run. All others come back by themselves; then release, arm, start",
            )
        ]  # fmt: skip
    found = []
    if bridge_s is not None:
        found.append(
            Missing(
                BRIDGE, "fault", "no poses, robots hold", "Mocap bridge gone", bridge_s, seconds(bridge_s),
                "Its process has ended",
                f"No poses: robots hold after {safety.pose_silence_s:g} s, and go on by themselves with the next pose",
                "Start it: ahdc-mocap-bridge run",
            )
        )  # fmt: skip
    station_s = roll.since_s(STATION, now_ns)
    if station_s is not None or station_silent_s is not None:
        since_s = max(station_s or 0.0, station_silent_s or 0.0)
        title = "Station gone" if station_s is not None else "Station silent"
        why = "Its process has ended" if station_s is not None else "It hangs, or its network is down"
        found.append(
            Missing(
                STATION, "fault", "robots hold, then stop", title, since_s, seconds(since_s), why,
                f"Robots hold after {safety.heartbeat_timeout_s:g} s and stop after "
                f"{4 * safety.heartbeat_timeout_s:g} s without it. STOP works",
                "Start it: ahdc-groundstation session. It goes on with this mission; then release, arm, start",
            )
        )  # fmt: skip
    recorder_s = roll.since_s(RECORDER, now_ns)
    if recorder_s is not None:
        found.append(
            Missing(
                RECORDER, "caution", "robots go on, unrecorded", "Recorder gone", recorder_s, seconds(recorder_s),
                "Its process has ended",
                "The mission goes on, unrecorded. What was written is kept, but for the last second",
                "Start it: ahdc-groundstation record. The earlier file: ahdc-groundstation recover",
            )
        )  # fmt: skip
    return found
