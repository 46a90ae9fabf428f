"""What the station does not let in, for every kind of message that it hears."""

import time
from collections.abc import Iterable

import msgspec
import pytest

from contract.arena import load
from contract.keys import Keys
from contract.messages import (
    BodyPose,
    LogEntry,
    Message,
    MocapFrame,
    MocapHealth,
    NeighbourState,
    OrderRequest,
    RobotReport,
    StationHeartbeat,
    StopRequest,
    Target,
    TargetCloud,
)
from groundstation import rig
from groundstation.conduct import Conductor, new_session
from groundstation.course import Plan
from groundstation.doorkeeper import Doorkeeper, Succession

ARENA = load(rig.find_arena("bench2"))
MS = 1_000_000
NOW_NS = 10**12


def report(stamp_ns: int, boot: int = 1, robot: str = "r06") -> RobotReport:
    return RobotReport(robot=robot, boot=boot, stamp_ns=stamp_ns, run="running")


def state(seq: int, stamp_ns: int, boot: int = 1) -> NeighbourState:
    rest = (1.0, 1.0)
    return NeighbourState(
        robot="r06", boot=boot, seq=seq, stamp_ns=stamp_ns, x_m=1.0, y_m=1.0, heading_rad=0.0, vx_mps=0.0, vy_mps=0.0,
        stop_long=rest, stop_short=rest,
    )  # fmt: skip


def frame(number: int, publish_ns: int, session: int = 1) -> MocapFrame:
    body = BodyPose(robot="r06", x_m=1.0, y_m=1.0, heading_rad=0.0)
    return MocapFrame(
        session=session, frame=number, exposure_ns=publish_ns, transmit_ns=publish_ns, publish_ns=publish_ns,
        rate_hz=100.0, bodies=(body,),
    )  # fmt: skip


def health(stamp_ns: int) -> MocapHealth:
    return MocapHealth(stamp_ns=stamp_ns, state="ok")


SEQUENCES = {
    "report": ([report(NOW_NS), report(NOW_NS + MS)], report(NOW_NS), "report replayed"),
    "report of an earlier boot": (
        [report(NOW_NS), report(NOW_NS + MS, boot=2)],
        report(NOW_NS + 2 * MS),
        "report replayed",
    ),
    "report of a boot never heard": ([report(NOW_NS)], report(NOW_NS - MS, boot=9), "report replayed"),
    "state": ([state(5, NOW_NS), state(6, NOW_NS + MS)], state(6, NOW_NS + MS), "state replayed"),
    "state overtaken": ([state(5, NOW_NS), state(7, NOW_NS + MS)], state(6, NOW_NS + 2 * MS), "state replayed"),
    "state of an earlier boot": (
        [state(5, NOW_NS), state(0, NOW_NS + MS, boot=2)],
        state(6, NOW_NS + MS),
        "state replayed",
    ),
    "frame": ([frame(5, NOW_NS), frame(6, NOW_NS + MS)], frame(5, NOW_NS), "frame replayed"),
    "frame of an earlier session": ([frame(5, NOW_NS), frame(0, NOW_NS, 2)], frame(6, NOW_NS + MS), "frame replayed"),
    "mocap health": ([health(NOW_NS), health(NOW_NS + MS)], health(NOW_NS), "mocap health replayed"),
    "targets": (
        [TargetCloud(mission=name, targets=()) for name in ("a", "b", "b")],
        TargetCloud(mission="a", targets=()),
        "targets of an earlier wish",
    ),
}


@pytest.mark.parametrize("what", SEQUENCES)
def test_replayed_overtaken_and_older_ones_are_refused_and_counted_by_name(what: str) -> None:
    good, bad, words = SEQUENCES[what]
    door = Doorkeeper()
    assert all(door.lets(message) for message in good)
    for times in (1, 2):
        assert not door.lets(bad)
        assert door.refused == {words: times}
    assert door.lets(msgspec.structs.replace(good[-1], **newer(good[-1])))


def newer(message: Message) -> dict[str, object]:
    """What the next honest message has more than this one."""
    match message:
        case NeighbourState():
            return {"seq": message.seq + 1}
        case MocapFrame():
            return {"frame": message.frame + 1}
        case TargetCloud():
            return {"targets": (Target(index=0, x_m=1.0, y_m=1.0),)}
        case RobotReport() | MocapHealth():
            return {"stamp_ns": message.stamp_ns + 10 * MS}
    raise AssertionError(message)


def test_one_robots_replay_shuts_no_other_out() -> None:
    door = Doorkeeper()
    assert door.lets(report(NOW_NS))
    assert door.lets(report(NOW_NS - MS, robot="r08"))


def test_an_order_is_for_the_session_that_was_heard() -> None:
    """Recorded with an earlier one, or before any was heard, it is obeyed by none; the session knows its number."""
    order = OrderRequest(stamp_ns=NOW_NS, source="x", number=7, order="arm", station=41)
    door = Doorkeeper()
    assert not door.lets(order)
    door.boot = 41
    assert door.lets(order)
    assert door.lets(order), "repeated until it is obeyed"
    door = Doorkeeper()
    door.boot = 42
    assert not door.lets(order)
    assert not door.lets(msgspec.structs.replace(order, station=0))
    assert door.refused == {"order for another session": 2}


@pytest.mark.parametrize("age_ns", [0, 10**9, NOW_NS])
def test_stop_is_let_in_whatever_its_age(age_ns: int) -> None:
    door = Doorkeeper()
    stop = StopRequest(stamp_ns=NOW_NS - age_ns, source="x", stop_id=1)
    assert all(door.lets(stop) for _ in range(3))
    assert not door.refused


def test_lives_succeed_each_other_once() -> None:
    lives = Succession()
    steps = ((1, 0, 5), (2, 0, 5), (1, 9, 9), (2, 0, 9), (3, 0, 9), (2, 5, 20), (3, 1, 9))
    assert [lives.next(*step) for step in steps] == [True, True, False, False, True, False, True]


class Wire:
    """A link's stand-in: hands over what was put in, keeps what is published."""

    def __init__(self) -> None:
        self.keys = Keys(ARENA.arena.name)
        self.arrived: list[Message] = []
        self.said: list[Message] = []

    epoch = 0
    behind_ns = 0

    def now_ns(self) -> int:
        return time.monotonic_ns() - self.behind_ns

    def subscribe(self, keys: Iterable[str]) -> None:
        assert all(map(self.keys.kind, keys))

    def drain(self) -> list[tuple[str, Message]]:
        taken, self.arrived = self.arrived, []
        return [("", message) for message in taken]

    def publish(self, key: str, message: Message, channel: str) -> None:
        self.said.append(message)


def test_a_station_lets_nothing_replayed_reach_its_session_and_says_so() -> None:
    """What a recording of an earlier session holds, handed in again: orders nobody, changes nothing, is in the log."""
    cloud, wire = TargetCloud(mission="m", targets=()), Wire()
    conductor = Conductor(ARENA, new_session(ARENA, cloud, Plan(), wire), cloud, wire)  # type: ignore[arg-type]
    conductor.turn()
    beat = next(message for message in wire.said if isinstance(message, StationHeartbeat))
    order = OrderRequest(stamp_ns=NOW_NS, source="x", number=7, order="repeat", station=beat.boot + 1)
    wire.arrived = [report(NOW_NS + MS), report(NOW_NS), order]
    conductor.turn()
    assert conductor.session.reports["r06"].stamp_ns == NOW_NS + MS
    assert conductor.session.cloud.mission == "m"
    wire.arrived = [msgspec.structs.replace(order, station=beat.boot)]
    logs: list[LogEntry] = []
    while not logs:
        conductor.turn()
        logs = [message for message in wire.said if isinstance(message, LogEntry)]
    assert conductor.session.cloud.mission == "m.2", "an order for the session itself is obeyed"
    assert logs[0].fields == {"report replayed": 1, "order for another session": 1}
    assert logs[0].text == "order for another session 1, report replayed 1"


def test_heartbeats_go_on_when_the_site_keeps_an_earlier_time_than_before() -> None:
    """The bridge's computer was started anew, or told the time only now: no beat may wait for the old time to come."""
    cloud, wire = TargetCloud(mission="m", targets=()), Wire()
    conductor = Conductor(ARENA, new_session(ARENA, cloud, Plan(), wire), cloud, wire)  # type: ignore[arg-type]
    conductor.turn()
    wire.behind_ns, wire.epoch = time.monotonic_ns() - 1, 1
    wire.said.clear()
    for _ in range(3):
        conductor.turn()
    beats = [message for message in wire.said if isinstance(message, StationHeartbeat)]
    assert beats
    assert all(beat.stamp_ns < 10**12 for beat in beats)
