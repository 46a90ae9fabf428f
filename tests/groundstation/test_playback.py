"""Replay on the page: any moment of a recording, the same whichever way it is reached, and STOP that stays STOP."""

import json
from itertools import pairwise
from typing import Any

import pytest
from msgspec.structs import replace

from contract.arena import Arena
from contract.keys import Keys
from contract.messages import Message, MocapFrame, RobotReport, RunStatus, StopRequest
from groundstation.page_client import Client
from groundstation.page_replay import NoLink, ReplayPage
from groundstation.playback import STRIP_POINTS, Playback
from tests.groundstation.runs import MS, START_NS, arena_of, mission, northward

S = 1_000_000_000


def sent(arena: Arena) -> list[tuple[int, Message]]:
    keys = Keys(arena.arena.name)
    told = mission(arena, frames=400, every=100)
    for k in range(40):
        status = RunStatus(
            stamp_ns=START_NS, phase="running", elapsed_s=0.1 * k, lambda2=1.0 + k, components=1, targets=2,
            occupied=(0,) if k >= 10 else (),
        )  # fmt: skip
        told.append((keys.status, status, START_NS + k * 100 * MS + MS))
    return [(at_ns, message) for _, message, at_ns in sorted(told, key=lambda entry: entry[2])]


@pytest.fixture
def playback() -> Playback:
    arena = arena_of()
    return Playback(arena, sent(arena))


def shown(playback: Playback) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(playback.view(), default=str))
    return found


@pytest.mark.parametrize("at_s", [0.3, 1.0, 2.5])
def test_a_moment_is_the_same_from_before_and_from_after(playback: Playback, at_s: float) -> None:
    playback.seek(START_NS + int(at_s * S))
    before = shown(playback)
    playback.seek(playback.end_ns)
    assert shown(playback) != before
    playback.seek(START_NS + int(at_s * S))
    after = shown(playback)
    assert after == before
    k = int((at_s - 0.003) * 100)
    for i, row in enumerate(after["robots"]):
        assert (row["x"], row["y"]) == pytest.approx(northward(i, k), abs=1e-4)
    assert after["run"]["state"] == "REPLAY"
    assert not any(after["can"].values())
    history = playback.state.history
    assert history[-1][0] == pytest.approx(at_s, abs=0.31)
    assert all(value == pytest.approx(1.0 + 10 * when) for when, value in history)


def test_it_plays_to_the_end_and_goes_from_event_to_event(playback: Playback) -> None:
    assert playback.act({"do": "play", "on": True}) == ""
    playback.advance(S)
    assert playback.at_ns == playback.start_ns + S
    playback.advance(100 * S)
    assert (playback.at_ns, playback.playing) == (playback.end_ns, False)
    playback.act({"do": "seek", "at": 0})
    times = []
    while playback.at_ns < playback.end_ns:
        playback.act({"do": "event"})
        times.append(round((playback.at_ns - START_NS) / S, 1))
    assert times[:2] == [0.0, 1.0], "the start, then the first target"
    playback.act({"do": "seek", "at": 2})
    playback.act({"do": "seek", "by": -0.5})
    assert playback.at_ns == playback.start_ns + 1_500_000_000
    assert "a replay" in playback.act({"do": "order", "order": "arm"})
    assert playback.act({"do": "seek"})


def test_nothing_to_show_is_said() -> None:
    with pytest.raises(ValueError, match="nothing to show"):
        Playback(arena_of(), [])


def test_a_recorded_stop_that_was_released_is_over(playback: Playback) -> None:
    arena = arena_of()
    stop: list[tuple[int, Message]] = [(S, StopRequest(stamp_ns=S, source="terminal", stop_id=5))]
    for at_ns, run in ((2 * S, "stopped"), (3 * S, "disarmed")):
        for name in arena.robots:
            report = RobotReport(robot=name, boot=1, stamp_ns=at_ns, run=run, stop_id=5)  # type: ignore[arg-type]
            stop.append((at_ns, report))
    player = Playback(arena, stop)
    player.seek(2 * S)
    assert player.state.latch.pressed is not None
    assert not player.state.latch.silent
    player.seek(3 * S)
    assert player.state.latch.pressed is None


class Heard(NoLink):
    def __init__(self, arena: Arena) -> None:
        super().__init__(arena)
        self.published: list[Message] = []

    def publish(self, key: str, message: Message, channel: str) -> None:
        self.published.append(message)


def test_stop_in_a_replay_is_sent_and_leaves_the_replay(playback: Playback) -> None:
    link = Heard(playback.arena)
    page = ReplayPage(playback.arena, link, "", playback)
    client = Client()
    page.clients.add(client)
    assert page.layout()["replay"]["events"]
    assert page.view(1)["run"]["state"] == "REPLAY"
    assert page.act({"do": "order", "order": "arm"}) == "this is a replay; Esc for the live arena"
    page.stop(7, "Space")
    assert [m.stop_id for m in link.published if isinstance(m, StopRequest)] == [7]
    assert not page.replaying
    assert "replay" not in page.view(1)
    assert page.view(1)["stop"]["id"] == 7
    assert "replay" not in json.loads(client.answers[-1])


def test_escape_leaves_the_replay_and_nothing_is_sent(playback: Playback) -> None:
    link = Heard(playback.arena)
    page = ReplayPage(playback.arena, link, "", playback)
    assert page.act({"do": "live"}) == ""
    assert "replay" not in page.view(1)
    assert link.published == []


def test_the_strip_under_the_map_tells_connectivity_over_the_whole_recording(playback: Playback) -> None:
    strip = playback.layout()["replay"]["strip"]
    assert 40 <= len(strip) <= STRIP_POINTS + 1
    assert strip[0][0] < 0.1
    assert strip[-1][0] == pytest.approx((playback.end_ns - playback.start_ns) / S, abs=0.1)
    assert all(a[0] < b[0] for a, b in pairwise(strip))
    assert {value for _, value in strip} == {3.0}, "three robots 0.5 m apart are a triangle"
    apart = Playback(playback.arena, [(ns, _torn(m)) for ns, m in sent(playback.arena)])
    assert {value for _, value in apart.strip} == {0.0}


def _torn(message: Message) -> Message:
    if not isinstance(message, MocapFrame):
        return message
    bodies = tuple(replace(body, x_m=body.x_m + 100.0 * (k == 0)) for k, body in enumerate(message.bodies))
    return replace(message, bodies=bodies)


def test_it_plays_at_the_speed_that_is_chosen(playback: Playback) -> None:
    assert playback.view()["replay"]["speed"] == 1.0
    playback.act({"do": "play", "on": True})
    for by, speed in ((1, 2.0), (1, 4.0), (9, 8.0), (1, 8.0), (-4, 0.5), (-9, 0.25)):
        assert playback.act({"do": "speed", "by": by}) == ""
        assert playback.view()["replay"]["speed"] == speed
        before_ns = playback.at_ns
        playback.advance(100 * MS)
        assert playback.at_ns - before_ns == int(100 * MS * speed)
    assert "steps" in playback.act({"do": "speed", "by": "fast"})
