"""Commands, poses, states and targets that are replayed, delayed or out of order: refused by number and boot, counted,
named in the report. STOP alone is obeyed whatever its age."""

import msgspec
import pytest

from contract.arena import load
from contract.keys import Keys
from contract.messages import (
    Message,
    MocapFrame,
    NeighbourState,
    RobotReport,
    StationHeartbeat,
    StopRequest,
    Target,
    TargetCloud,
)
from groundstation import rig
from onboard.reception import STATE_AGE_NS
from onboard.runtime import subscriptions
from onboard.sensing import Sensing
from tests.onboard.samples import state
from tests.onboard.test_agent import MS, Stage

ARENA = load(rig.find_arena("bench2"))
KEYS = Keys(ARENA.arena.name)


def running(**others: tuple[float, float]) -> Stage:
    stage = Stage(others)
    stage.run(10)
    for order in ("arm", "run"):
        stage.give(order)  # type: ignore[arg-type]
        stage.run(20)
    assert stage.agent.run_state == "running"
    return stage


def counters(stage: Stage) -> dict[str, int]:
    stage.run(20)
    reports = [message for _, message in stage.said if isinstance(message, RobotReport)]
    return reports[-1].counters


@pytest.mark.parametrize("order", ["arm", "run", "hold", "disarm"])
@pytest.mark.parametrize("delay_ms", [0, 40, 400, 5_000])
def test_a_replayed_heartbeat_commands_nothing(order: str, delay_ms: int) -> None:
    """Byte for byte, at once or held back: its number has been used."""
    stage = running()
    old = msgspec.structs.replace(stage.heartbeat(), order=order, order_id=stage.order_id + 5)
    stage.run(1)
    stage.now_ns += delay_ms * MS if delay_ms < 200 else 0
    before = stage.agent.supervisor.order_id
    taken = stage.agent.supervisor.ignored_heartbeats
    stage.agent.receive(old, stage.now_ns + delay_ms * MS)
    assert stage.agent.run_state == "running"
    assert (stage.agent.supervisor.order_id, stage.agent.supervisor.ignored_heartbeats) == (before, taken + 1)
    assert counters(stage)["heartbeat replayed"] == taken + 1


@pytest.mark.parametrize("age_ms", [600, 60_000, -100])
def test_another_stations_old_or_early_heartbeat_takes_nothing_over(age_ms: int) -> None:
    stage = running()
    beat = stage.heartbeat()
    strange = msgspec.structs.replace(
        beat, boot=beat.boot + 1, seq=0, order="run", order_id=99, stamp_ns=stage.now_ns - age_ms * MS
    )
    stage.agent.receive(strange, stage.now_ns)
    assert stage.agent.run_state == "running"
    assert counters(stage)["heartbeat replayed"] == 1


def test_the_last_heartbeat_of_a_station_taken_over_from_takes_nothing_back() -> None:
    """It is young enough, but came by a slower way than the new station's first."""
    stage = running()
    late = msgspec.structs.replace(stage.heartbeat(), seq=10**6, order_id=99)
    stage.now_ns += 1 * MS
    new = msgspec.structs.replace(late, boot=late.boot + 1, seq=1, order="disarm", order_id=1, stamp_ns=stage.now_ns)
    stage.agent.receive(new, stage.now_ns)
    assert stage.agent.run_state == "disarmed"
    stage.agent.receive(late, stage.now_ns + 40 * MS)
    again = msgspec.structs.replace(new, seq=2, order="arm", order_id=2, stamp_ns=stage.now_ns + 50 * MS)
    stage.agent.receive(again, stage.now_ns + 50 * MS)
    assert stage.agent.supervisor.order_id == 2, "the new station is still the one that is obeyed"
    assert stage.agent.supervisor.ignored_heartbeats == 1


@pytest.mark.parametrize("age_s", [0, 10, 86_400])
@pytest.mark.parametrize("by", ["request", "heartbeat"])
def test_stop_is_obeyed_whatever_its_age_and_number(age_s: int, by: str) -> None:
    stage = running()
    stage.now_ns += 1
    stamp_ns = max(0, stage.now_ns - age_s * 10**9)
    if by == "request":
        stage.agent.receive(StopRequest(stamp_ns=stamp_ns, source="an old one", stop_id=1), stage.now_ns)
    else:
        old = msgspec.structs.replace(stage.heartbeat(), order="stop", seq=0, stamp_ns=stamp_ns)
        assert isinstance(old, StationHeartbeat)
        stage.agent.receive(old, stage.now_ns)
    assert stage.agent.run_state == "stopped"


def test_frames_of_an_earlier_session_are_refused_and_the_new_one_goes_on() -> None:
    stage = running()
    old = stage.mocap(True)
    stage.run(1)
    new = msgspec.structs.replace(stage.mocap(True), session=old.session + 1, frame=1)
    stage.agent.receive(new, stage.now_ns)
    for number in range(3):
        late = msgspec.structs.replace(old, frame=old.frame + 100 + number)
        assert not stage.agent.receive(late, stage.now_ns)
    assert stage.agent.counters["frame of an earlier session"] == 3
    after = msgspec.structs.replace(new, frame=2)
    stage.agent.receive(after, stage.now_ns)
    assert stage.agent.reception.frame == after


def test_a_frame_of_a_session_never_heard_is_refused_if_it_was_published_before_the_last() -> None:
    stage = running()
    old = msgspec.structs.replace(stage.mocap(True), session=77, frame=10**6, publish_ns=stage.now_ns - 10_000 * MS)
    assert not stage.agent.receive(old, stage.now_ns)
    assert stage.agent.counters["frame of an earlier session"] == 1
    stage.run(3)
    assert stage.agent.counters == {"frame of an earlier session": 1}, "the session that goes on is not shut out by it"


def test_targets_that_nobody_has_named_wait_and_those_of_the_mission_stay() -> None:
    """Recorded before this robot was started, or sent ahead of the heartbeat that names their mission."""
    stage = running()
    target = (Target(index=0, x_m=1.2, y_m=0.5),)
    stage.agent.receive(msgspec.structs.replace(stage.heartbeat(), seq=10**6, mission="m"), stage.now_ns)
    stage.agent.receive(TargetCloud(mission="m", targets=target), stage.now_ns)
    for unknown in ("of-yesterday", "m.2"):
        stage.agent.receive(TargetCloud(mission=unknown, targets=target), stage.now_ns)
        assert stage.agent.sensing.mission == "m"
    assert stage.agent.counters["targets ahead of their mission"] == 2
    stage.agent.receive(msgspec.structs.replace(stage.heartbeat(), seq=10**6 + 1, mission="m.2"), stage.now_ns)
    assert stage.agent.sensing.mission == "m.2"


def test_an_earlier_missions_targets_are_refused_unless_the_station_is_back_at_it() -> None:
    stage = running()
    first = TargetCloud(mission="m", targets=(Target(index=0, x_m=1.2, y_m=0.5),))
    second = TargetCloud(mission="m.2", targets=(Target(index=0, x_m=1.0, y_m=0.9),))
    stage.agent.receive(second, stage.now_ns)
    stage.agent.receive(first, stage.now_ns)
    assert stage.agent.sensing.mission == "m.2"
    assert stage.agent.counters["targets of an earlier mission"] == 1
    stage.run(1)
    stage.agent.receive(msgspec.structs.replace(stage.heartbeat(), seq=10**6, mission="m"), stage.now_ns)
    stage.agent.receive(first, stage.now_ns)
    assert stage.agent.sensing.mission == "m"


def test_states_repeated_overtaken_or_of_an_earlier_boot_are_refused() -> None:
    sensing = Sensing("r01", 1.0, 0.5)
    stage = Stage({"r02": (0.9, 0.5)})
    stage.run(5)
    sensing.frame(stage.mocap(True))
    news = [(1, 5, True), (1, 5, False), (1, 4, False), (1, 6, True), (2, 0, True), (1, 7, False), (1, 99, False),
            (2, 0, False), (2, 1, True), (3, 0, True), (2, 2, False), (1, 100, False)]  # fmt: skip
    for boot, seq, taken in news:
        assert sensing.state(state("r02", boot=boot, seq=seq), 0) == taken, (boot, seq)
    assert sensing.replayed == sum(not taken for _, _, taken in news)


def test_a_state_of_a_boot_never_heard_is_refused_if_it_is_older_than_the_last() -> None:
    stage = running(r02=(0.9, 0.5))
    now_ns = stage.now_ns
    for boot, seq, age_ms, taken in ((5, 1, 10, True), (4, 999, 400, False), (5, 2, 5, True), (6, 0, 1, True)):
        stage.agent.receive(state("r02", 0.9, 0.5, boot=boot, seq=seq, stamp_ns=now_ns - age_ms * MS), now_ns)
        known = stage.agent.sensing._heard["r02"][0]
        assert ((known.boot, known.seq) == (boot, seq)) == taken
    assert counters(stage)["state replayed"] == 1


def test_a_state_held_back_too_long_counts_as_lost() -> None:
    stage = running(r02=(0.9, 0.5))
    now_ns = stage.now_ns + 10**10
    for seq, age_ns in ((1, STATE_AGE_NS), (2, STATE_AGE_NS + 1)):
        stage.agent.receive(state("r02", 0.9, 0.5, boot=5, seq=seq, stamp_ns=now_ns - age_ns), now_ns)
    assert stage.agent.sensing._heard["r02"][0].seq == 1
    assert stage.agent.counters["state too old"] == 1


@pytest.mark.parametrize("message", [StopRequest, StationHeartbeat, MocapFrame, NeighbourState, TargetCloud])
def test_no_kind_of_message_that_a_robot_hears_is_left_out_above(message: type[Message]) -> None:
    """What a robot subscribes to is what its replay is tested of."""
    heard = {KEYS.kind(key) for key in (*subscriptions(ARENA), KEYS.state("r06"))}
    assert message in heard
    assert len(heard) == 5


def test_a_state_stamped_ahead_of_its_time_is_refused_and_named() -> None:
    """It would make its sender's news look younger than they are."""
    stage = running(r02=(0.9, 0.5))
    tolerance_ns = round(stage.arena.safety.clock_tolerance_s * 1e9)
    for seq, ahead_ns in ((1, tolerance_ns), (2, tolerance_ns + 1)):
        stage.agent.receive(state("r02", 0.9, 0.5, boot=5, seq=seq, stamp_ns=stage.now_ns + ahead_ns), stage.now_ns)
    assert stage.agent.sensing._heard["r02"][0].seq == 1
    assert counters(stage)["state ahead of its time"] == 1
