"""Trials on robots wait for an operator: a release after a stop, a battery to charge; nothing is ordered till then."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contract.messages import RobotReport, StationHeartbeat
from groundstation import stage_robots
from groundstation.stage_robots import NotReady, RobotStage
from groundstation.trials import parse, trials

FILE = """
name = "lab"
backend = "robots"
arena = "bench2"
targets = [2]
pause_below_v = 11.1
"""


class Session:
    """The station's, as a stage sees it; notes every order."""

    def __init__(self) -> None:
        self.phase, self.detail = "ready", ""
        self.order_in_force = "disarm"
        self.orders: list[str] = []
        self.volts: dict[str, float | None] = {"r01": 12.0, "r02": 12.0}

    @property
    def reports(self) -> dict[str, RobotReport]:
        return {
            name: RobotReport(robot=name, boot=1, stamp_ns=0, run="disarmed", battery_v=v)
            for name, v in self.volts.items()
        }

    def heartbeat(self, now_ns: int) -> StationHeartbeat:
        return StationHeartbeat(boot=1, seq=1, stamp_ns=now_ns, order=self.order_in_force, order_id=1)  # type: ignore[arg-type]

    def order(self, order: str, now_ns: int) -> None:
        self.orders.append(order)
        if order == "disarm":
            self.phase, self.order_in_force = "waiting", "disarm"

    def misplaced(self) -> list[str]:
        raise NotReady("the trial goes on")


class Conductor:
    """Turns a script in place of a network: one act a turn."""

    def __init__(self, *_: object) -> None:
        self.acts: list[Callable[[], None]] = []

    def until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        while not done():
            if not self.acts:
                assert timeout_s != float("inf"), "waits for ever"
                return False
            self.acts.pop(0)()
        return True


class Link:
    def __init__(self, *_: object) -> None: ...

    def now_ns(self) -> int:
        return 1

    def __enter__(self) -> "Link":
        return self


@pytest.fixture
def session() -> Session:
    return Session()


@pytest.fixture
def stage(session: Session, monkeypatch: pytest.MonkeyPatch) -> RobotStage:
    monkeypatch.setattr(stage_robots, "Link", Link)
    monkeypatch.setattr(stage_robots, "Conductor", Conductor)
    monkeypatch.setattr(stage_robots, "new_session", lambda *_: session)
    monkeypatch.setattr(stage_robots.current, "remember", lambda _: None)
    return RobotStage(parse(FILE, "test"), Path("lab.toml"))


def play(stage: RobotStage, acts: list[Callable[[], None]], tmp_path: Path) -> Any:
    conductor: Any = stage._conductor
    conductor.acts = acts
    found = stage.play(trials(parse(FILE, "test"))[0], tmp_path)
    assert not conductor.acts, "it waited for all of it"
    return found


def test_it_waits_for_an_empty_battery_and_goes_on_when_it_is_charged(
    stage: RobotStage, session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session.volts = {"r01": 10.9, "r02": 11.0}

    def charge(name: str, volts: float | None) -> Callable[[], None]:
        return lambda: session.volts.update({name: volts})

    found = play(stage, [charge("r01", 12.6), charge("r02", 11.09), charge("r02", 11.1)], tmp_path)
    assert (found.ending, found.why) == ("error", "the trial goes on")
    assert session.orders == [], "no wheel gets power while it waits"
    said = capsys.readouterr().err
    assert "waiting. battery: r01 10.9 V, r02 11.0 V; charge above 11.1 V to go on" in said
    assert "waiting. battery: r02 11.0 V;" in said
    session.volts = {"r01": None, "r02": 11.1}
    assert play(stage, [], tmp_path).why == "the trial goes on", "a robot that measures none is not waited for"


def test_after_a_stop_only_the_operators_release_goes_on(
    stage: RobotStage, session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session.phase, session.detail, session.order_in_force = "stopped", "stop requested by page", "stop"

    def nothing() -> None: ...

    def release() -> None:
        session.order("disarm", 0)

    found = play(stage, [nothing, nothing, release], tmp_path)
    assert found.why == "the trial goes on"
    assert session.orders == ["disarm"], "the operator's own"
    assert capsys.readouterr().err.count("stopped: stop requested by page; release it to go on") == 1, "said once"


def test_after_a_mission_that_ended_by_itself_it_goes_on_by_itself(
    stage: RobotStage, session: Session, tmp_path: Path
) -> None:
    session.phase = "completed"
    assert play(stage, [], tmp_path).why == "the trial goes on"
    assert session.orders == ["disarm"]
