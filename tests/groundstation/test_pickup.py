"""A station that ends in a mission: the robots stop as the table says, and the next session goes on with it."""

from pathlib import Path

import pytest

from contract.messages import RobotReport, TargetCloud
from groundstation.course import Plan
from groundstation.pickup import AGAIN_NS, WITHIN_NS, Notebook
from groundstation.session import Session
from tests.groundstation.test_repeat_and_home import arena_of, at_start, cloud_of
from tests.groundstation.virtual import Virtual

S = 1_000_000_000


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


CLOUD = cloud_of((0.5, 1.2), (0.9, 2.0))


def test_what_is_noted_is_read_back_by_the_next() -> None:
    Notebook("abc").write(CLOUD, 5 * S, False, 7 * S)
    note = Notebook("abc").read(8 * S)
    assert note is not None
    assert (note.cloud, note.started_ns) == (CLOUD, 5 * S)
    assert Notebook("other").read(8 * S) is None, "another arena file"


def test_an_old_note_a_future_one_and_one_of_another_boot_are_nobodys(monkeypatch: pytest.MonkeyPatch) -> None:
    Notebook("abc").write(CLOUD, 5 * S, False, 7 * S)
    assert Notebook("abc").read(7 * S + WITHIN_NS) is not None
    assert Notebook("abc").read(7 * S + WITHIN_NS + 1) is None
    assert Notebook("abc").read(6 * S) is None
    monkeypatch.setattr("groundstation.pickup.boot_id", lambda: "another")
    assert Notebook("abc").read(8 * S) is None


def test_a_completed_mission_is_forgotten_and_a_change_is_noted_at_once() -> None:
    notebook = Notebook("abc")
    notebook.write(CLOUD, 0, False, 1 * S)
    notebook.write(CLOUD, 2 * S, False, 2 * S)
    note = Notebook("abc").read(2 * S)
    assert note is not None
    assert note.started_ns == 2 * S
    notebook.write(CLOUD, 2 * S, False, 2 * S + AGAIN_NS - 1)
    assert Notebook("abc").read(2 * S) is not None, "unchanged, and not due again"
    notebook.write(CLOUD, 2 * S, False, 2 * S + AGAIN_NS)
    assert Notebook("abc").read(2 * S) is None, "noted anew, later"
    notebook.write(CLOUD, 2 * S, True, 3 * S + AGAIN_NS)
    assert not notebook.path.exists()


@pytest.mark.parametrize("content", [b"", b"{}", b'{"boot_id":1}', b"\xff", b"[]"])
def test_a_note_that_cannot_be_read_is_none(content: bytes) -> None:
    notebook = Notebook("abc")
    notebook.path.parent.mkdir(parents=True)
    notebook.path.write_bytes(content)
    assert notebook.read(0) is None


def test_a_folder_that_cannot_be_written_is_no_reason_to_fail(state: Path) -> None:
    (state / "ahdc").write_text("in the way")
    notebook = Notebook("abc")
    notebook.write(CLOUD, 0, False, 1)
    notebook.write(CLOUD, 0, True, 2)
    assert notebook.read(2) is None


def states(swarm: Virtual) -> set[str]:
    return {message.run for message in swarm.said if isinstance(message, RobotReport)}


def running(plan_robots: int = 2) -> Virtual:
    """Two robots in the second run of a mission, one target occupied."""
    arena = arena_of(plan_robots)
    swarm = Virtual(arena, cloud_of((0.5, 1.2), (0.9, 1.9), (0.9, 2.7)), at_start(arena))
    swarm.phase("ready", 2.0)
    swarm.order("repeat")
    swarm.phase("ready", 2.0)
    swarm.order("arm")
    swarm.phase("armed", 2.0)
    swarm.order("run")
    swarm.until(lambda: len(swarm.session.occupied) == 1, 30.0)
    return swarm


def restarted(swarm: Virtual, cloud: TargetCloud, started_ns: int) -> Session:
    session = Session(swarm.arena, cloud, 2, Plan(), swarm.now_ns)
    session.go_on(cloud, started_ns)
    return session


@pytest.mark.parametrize("gap_s", [0.2, 3.0])
def test_a_restarted_station_goes_on_with_the_mission(gap_s: float) -> None:
    """A short gap leaves the robots running, a long one stopped; both are disarmed or released, then armed anew."""
    swarm = running()
    before = swarm.session
    assert before.cloud.mission == "lab.2"
    notebook = Notebook("abc")
    notebook.write(before.cloud, before.started_ns, False, swarm.now_ns)
    held, swarm.session = swarm.session, Session(swarm.arena, cloud_of((3.0, 3.0)), 2, Plan(), swarm.now_ns)
    swarm.silence = True
    end_ns = swarm.now_ns + int(gap_s * 1e9)
    swarm.until(lambda: swarm.now_ns >= end_ns, gap_s + 0.1)
    agents = swarm.agents.values()
    assert {agent.supervisor.state for agent in agents} == ({"stopped"} if gap_s > 1 else {"running"})
    swarm.silence = False
    note = notebook.read(swarm.now_ns)
    assert note is not None
    swarm.session = restarted(swarm, note.cloud, note.started_ns)
    swarm.until(lambda: {agent.supervisor.state for agent in agents} <= {"stopped", "disarmed"}, 1.0)
    if gap_s > 1:
        swarm.until(lambda: "release" in swarm.session.detail, 2.0)
        swarm.order("disarm")
    swarm.phase("ready", 3.0)
    assert set(held.occupied) <= set(swarm.session.occupied), "what was occupied stays so"
    if gap_s < 1:
        assert swarm.session.status(swarm.now_ns).elapsed_s == pytest.approx((swarm.now_ns - before.started_ns) / 1e9)
    swarm.order("arm")
    swarm.phase("armed", 2.0)
    swarm.order("run")
    swarm.phase("completed", 40.0)
    assert swarm.session.cloud.mission == "lab.2"
