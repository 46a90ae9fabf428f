"""Page, recorder, station and router killed in the middle of a mission: robots, page, recording, restart."""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from contract.messages import Message, MotorBatch, OrderRequest, Request, RobotReport, RunStatus
from groundstation import rig
from groundstation.link import Link
from groundstation.processes import Child
from groundstation.recording import Recording

PATIENCE_S = 60.0


class Mission:
    """A mock arena whose recorder, session and page are processes of their own; this one listens and orders."""

    def __init__(self, out: Path) -> None:
        changes = rig.Changes(robots=3, targets=14, seed=3)
        self.arena = rig.mock_arena(rig.find_arena("experiment2"), out, changes)
        self.out = out
        self.rig = rig.Rig(self.arena, out, record=True)
        self.reports: dict[str, RobotReport] = {}
        self.motors: dict[str, MotorBatch] = {}
        self.status: RunStatus | None = None
        self.status_at = 0.0

    def __enter__(self) -> "Mission":
        self.rig.__enter__()
        try:
            self.rig.start()
            self.station = self.start("session", "--out", str(self.out))
            self.page = self.start("page", "--port", "0")
            self.rig.family.wait_ready(PATIENCE_S)
            self.link = Link(self.arena, "proof").__enter__()
        except BaseException:
            self.rig.end()
            raise
        keys = self.link.keys
        self.link.subscribe([keys.status])
        self.link.subscribe(key for name in self.arena.robots for key in (keys.report(name), keys.motor(name)))
        return self

    def __exit__(self, *exception: object) -> None:
        self.link.__exit__()
        self.rig.end()

    def start(self, verb: str, *words: str) -> Child:
        log = self.out / "logs" / f"{verb}-{time.monotonic_ns()}.log"
        return self.rig.family.start(verb, "groundstation", [verb, "--arena", str(self.rig.config), *words], log)

    def kill(self, child: Child) -> None:
        child.signal(signal.SIGKILL)
        assert child.wait(5.0)
        self.rig.family.children.remove(child)
        child.close()

    def child(self, name: str) -> Child:
        return next(child for child in self.rig.family.children if child.name == name)

    def hear(self, wait_s: float = 0.05) -> None:
        self.link.wait(wait_s)
        for _, message in self.link.drain():
            self._note(message)

    def _note(self, message: Message) -> None:
        if isinstance(message, RobotReport):
            self.reports[message.robot] = message
        elif isinstance(message, MotorBatch):
            self.motors[message.robot] = message
        elif isinstance(message, RunStatus):
            self.status, self.status_at = message, time.monotonic()

    def until(self, done: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not done():
            assert time.monotonic() < deadline, f"{what}: {self.status} {self.reports}"
            self.hear()

    def states(self) -> set[str]:
        return {report.run for report in self.reports.values()}

    def still(self) -> bool:
        return len(self.motors) == 3 and all(abs(batch.true_speed_mps) < 0.005 for batch in self.motors.values())

    def order(self, order: Request, done: Callable[[], bool]) -> None:
        """Ask until it is done, as an operator presses again: a request is obeyed once."""
        due = 0.0

        def obeyed() -> bool:
            nonlocal due
            if time.monotonic() >= due:
                number = time.time_ns() // 1_000_000
                request = OrderRequest(stamp_ns=time.monotonic_ns(), source="proof", number=number, order=order)
                self.link.publish(self.link.keys.order, request, "order")
                due = time.monotonic() + 2.0
            return done()

        self.until(obeyed, order)

    def phase(self, phase: str) -> bool:
        return self.status is not None and self.status.phase == phase and time.monotonic() - self.status_at < 1.0

    def run(self) -> None:
        self.until(lambda: self.phase("ready"), "ready")
        self.order("arm", lambda: self.phase("armed"))
        self.order("run", lambda: self.phase("running"))

    def view(self, good: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first view of the page that is as it should be."""
        host = self.page._text.rpartition(b"READY page http://")[2].split()[0].decode()
        deadline = time.monotonic() + PATIENCE_S
        with connect(f"ws://{host}ws", compression=None) as socket:
            while time.monotonic() < deadline:
                message: dict[str, Any] = json.loads(socket.recv(timeout=PATIENCE_S))
                if message["kind"] == "view" and good(message):
                    return message
        raise AssertionError(f"never on the page: {message}")


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mission]:
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    with Mission(tmp_path_factory.mktemp("killed") / "run") as running:
        running.run()
        yield running
    del os.environ["XDG_STATE_HOME"]


def missing(view: dict[str, Any]) -> list[str]:
    return [part["part"] for part in view["missing"]]


def test_without_page_and_recorder_the_mission_goes_on_and_both_come_back(mission: Mission) -> None:
    mission.kill(mission.child("recorder"))
    view = mission.view(lambda view: "recorder" in missing(view))
    assert view["run"]["state"] == "RUNNING"
    cut = Recording(mission.out / "run.mcap")
    assert not cut.whole
    assert any(isinstance(entry.message, RobotReport) for entry in cut.messages())
    mission.start("record", "--out", str(mission.out))
    mission.rig.family.wait_ready(PATIENCE_S)
    assert list(mission.out.glob("run-until-*.mcap")), "the earlier recording is kept"
    mission.view(lambda view: not missing(view))
    mission.kill(mission.page)
    seen = {name: report.stamp_ns for name, report in mission.reports.items()}
    mission.until(lambda: all(r.stamp_ns > seen[n] + 500_000_000 for n, r in mission.reports.items()), "reports")
    assert mission.states() <= {"running"}
    mission.page = mission.start("page", "--port", "0")
    mission.rig.family.wait_ready(PATIENCE_S)
    assert mission.view(lambda view: view["run"]["state"] == "RUNNING")["elapsed"] > 0


def test_without_its_station_the_swarm_stops_and_the_next_one_goes_on_with_the_mission(mission: Mission) -> None:
    before = mission.status
    assert before is not None
    mission.kill(mission.station)
    mission.until(lambda: mission.states() == {"stopped"}, "all stop")
    mission.until(mission.still, "all at rest")
    view = mission.view(lambda view: "station" in missing(view))
    assert view["run"]["state"] in ("NO STATION", "STOPPED")
    mission.station = mission.start("session", "--out", str(mission.out))
    mission.rig.family.wait_ready(PATIENCE_S)
    mission.order("disarm", lambda: mission.states() == {"disarmed"})
    mission.until(lambda: mission.phase("ready"), "ready again")
    after = mission.status
    assert after is not None
    assert (after.mission, after.targets) == (before.mission, before.targets)
    assert set(before.occupied) <= set(after.occupied)
    mission.run()


def test_without_the_router_all_stop_and_come_back_with_it(mission: Mission) -> None:
    mission.kill(mission.child("bridge"))
    view = mission.view(lambda view: bool(missing(view)))
    assert missing(view)[0] in ("router", "mocap_bridge")
    bridge = mission.rig._child("bridge", "mocap_bridge", "run")
    mission.rig.family.wait_ready(PATIENCE_S)
    assert bridge.ready
    mission.until(lambda: mission.states() <= {"stopped", "holding", "running", "disarmed"}, "reports come again")
    if "stopped" in mission.states() or mission.phase("stopped") or mission.phase("failed"):
        mission.order("disarm", lambda: mission.states() == {"disarmed"})
        mission.run()
    mission.until(lambda: mission.phase("completed"), "completed")
    assert mission.status is not None
    assert len(mission.status.occupied) == mission.status.targets
