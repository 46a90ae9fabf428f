"""Which process of the station is missing: told on the page with what it means and what to do."""

import pytest

from contract.arena import Arena, load
from contract.messages import TOOK_OVER, LogEntry, MocapFrame, RunStatus
from groundstation import rig
from groundstation.page_missing import BRIDGE, PAGE, RECORDER, ROUTER, STATION
from groundstation.page_state import PageState
from tests.groundstation.test_page_state import report

MS = 1_000_000
ALL = {BRIDGE, STATION, RECORDER, PAGE, "r06", "r08"}


@pytest.fixture
def state() -> PageState:
    """In the middle of a mission, every process there."""
    arena = load(rig.find_arena("experiment2"))
    state = PageState(arena, 0)
    state.attend(ALL, 1 * MS)
    speak(state, arena, 2 * MS)
    return state


def speak(state: PageState, arena: Arena, now_ns: int, bridge: bool = True, station: bool = True) -> None:
    if bridge:
        frame = MocapFrame(session=1, frame=1, exposure_ns=0, transmit_ns=0, publish_ns=0, rate_hz=100.0, bodies=())
        state.receive(frame, now_ns)
    if station:
        state.receive(RunStatus(stamp_ns=now_ns, phase="running", elapsed_s=1.0, targets=3), now_ns)
    for name in arena.robots:
        state.receive(report(arena, name), now_ns)


def test_nothing_is_missing_while_all_are_there(state: PageState) -> None:
    assert state.missing(3 * MS) == []
    assert state.view(3 * MS)["missing"] == []


@pytest.mark.parametrize(
    ("gone", "part", "level", "words"),
    [
        (RECORDER, RECORDER, "caution", "record"),
        (STATION, STATION, "fault", "session"),
        (BRIDGE, BRIDGE, "fault", "ahdc-mocap-bridge"),
    ],
)
def test_one_that_ends_is_told_at_once_with_what_it_means(
    state: PageState, gone: str, part: str, level: str, words: str
) -> None:
    state.attend(ALL - {gone}, 10 * MS)
    (missing,) = state.missing(70 * MS)
    assert (missing.part, missing.level) == (part, level)
    assert missing.since_s == pytest.approx(0.06)
    assert missing.now
    assert words in missing.do
    assert any("gone" in event[2] for event in state.events)
    state.attend(ALL, 80 * MS)
    assert state.missing(90 * MS) == []


def test_all_at_once_is_the_router_and_stop_is_said_not_to_reach_anybody(state: PageState) -> None:
    state.attend({PAGE}, 10 * MS)
    (missing,) = state.missing(70 * MS)
    assert missing.part == ROUTER
    assert "STOP does not reach them" in missing.now
    assert state.view(70 * MS)["cell"]["big"] == "Router"


def test_a_station_that_hangs_is_told_by_its_silence(state: PageState) -> None:
    (missing,) = state.missing(2000 * MS)
    assert missing.part == STATION
    assert missing.title == "Station silent"


def test_who_is_heard_is_there_whatever_became_of_its_token(state: PageState) -> None:
    state.attend({PAGE}, 10 * MS)
    speak(state, state.arena, 60 * MS)
    state.attend({PAGE}, 61 * MS)
    assert [part.part for part in state.missing(70 * MS)] == [RECORDER]
    state.receive(LogEntry(stamp_ns=80 * MS, source="recorder", level="info", event="recording", text="1 MB"), 80 * MS)
    assert state.missing(90 * MS) == []


def test_a_recorder_that_never_was_is_not_missed(state: PageState) -> None:
    fresh = PageState(state.arena, 0)
    fresh.attend({BRIDGE, STATION}, 1 * MS)
    speak(fresh, state.arena, 2 * MS)
    assert fresh.missing(3 * MS) == []


def test_the_bar_tells_it_and_the_mission_goes_on(state: PageState) -> None:
    state.attend(ALL - {RECORDER}, 10 * MS)
    view = state.view(50 * MS)
    assert view["cell"]["tone"] == "amber"
    assert view["cell"]["big"] == "Recorder"
    assert view["run"]["state"] == "RUNNING"
    assert view["can"]["hold"]


def test_a_robot_disarmed_for_a_reason_of_old_can_be_cleared_from_the_page(state: PageState) -> None:
    arena = state.arena
    state.receive(RunStatus(stamp_ns=3 * MS, phase="waiting", detail="r06: arm refused: x", targets=3), 3 * MS)
    for name in arena.robots:
        state.receive(report(arena, name, run="disarmed"), 3 * MS)
    assert not state.view(4 * MS)["can"]["disarm"]
    state.receive(report(arena, "r06", run="disarmed", reason="arm refused: x"), 5 * MS)
    assert state.view(6 * MS)["can"]["disarm"]
    state.receive(report(arena, "r06", run="disarmed", reason=TOOK_OVER), 7 * MS)
    assert state.complaints(8 * MS).get("r06") is None
