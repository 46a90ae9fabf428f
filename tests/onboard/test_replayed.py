"""Commands, poses, states and targets that are replayed, delayed or out of order: refused by number and boot, counted,
named in the report. STOP alone is obeyed whatever its age."""

import msgspec
import pytest

from contract.messages import RobotReport, StationHeartbeat, StopRequest, Target, TargetCloud
from onboard.sensing import Sensing
from tests.onboard.samples import state
from tests.onboard.test_agent import MS, Stage


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
    assert stage.agent._frame == after


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


def test_a_state_stamped_ahead_of_its_time_is_refused_and_named() -> None:
    """It would make its sender's news look younger than they are."""
    stage = running(r02=(0.9, 0.5))
    tolerance_ns = round(stage.arena.safety.clock_tolerance_s * 1e9)
    for seq, ahead_ns in ((1, tolerance_ns), (2, tolerance_ns + 1)):
        stage.agent.receive(state("r02", 0.9, 0.5, boot=5, seq=seq, stamp_ns=stage.now_ns + ahead_ns), stage.now_ns)
    assert stage.agent.sensing._heard["r02"][0].seq == 1
    assert counters(stage)["state ahead of its time"] == 1
