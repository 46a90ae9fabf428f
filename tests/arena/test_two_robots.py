"""Two robots, one bit flipped in one hop after the other: motion stops, and that hop's counter rises."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from contract.codec import encode
from contract.messages import Message
from groundstation.mock_arena import FAULTS_FILE
from tests.arena.conftest import Running, open_files


def restart(two: Running) -> None:
    """Whatever a test left behind: release, arm, start, until both robots move."""
    (two.out / FAULTS_FILE).write_text("")
    two.session.order("disarm", time.monotonic_ns())
    disarmed = {"disarmed"}
    two.until(lambda: {report.run for report in two.reports.values()} == disarmed, "both disarmed")
    two.until(lambda: two.session.phase == "ready", "session ready")
    two.session.order("arm", time.monotonic_ns())
    two.until(lambda: two.session.phase == "armed", "both armed")
    two.session.order("run", time.monotonic_ns())
    two.until(lambda: two.moving("r06") and two.moving("r08"), "both move")


def count(two: Running, name: str, counter: str) -> int:
    return sum(value for key, value in two.reports[name].counters.items() if counter in key)


def stops_and_counts(two: Running, robots: tuple[str, ...], counter: Callable[[], int]) -> None:
    """The hop's counter rises, the named robots come to rest, and say that they do not run."""
    before = counter()
    two.until(lambda: counter() > before, "the hop's counter rises", 5.0)

    def halted(name: str) -> bool:
        idle = two.reports[name].run in ("holding", "fault", "stopped")
        return idle and abs(two.motors[name].true_speed_mps) < 0.005

    two.until(lambda: all(halted(name) for name in robots), "wheels at rest, not running", 5.0)


def test_different_processes_each_with_its_own_pty(two: Running) -> None:
    two.until(lambda: two.moving("r06") and two.moving("r08"), "both move")
    children = {child.name: child.pid for child in two.rig.family.children}
    ptys = {
        "r06": str(Path(two.arena.robots["r06"].wheels["channel"]).resolve()),
        "r08": str(Path(two.arena.robots["r08"].wheels["port"]).resolve()),
    }
    assert len(set(children.values())) == len(children)
    for name, other in (("r06", "r08"), ("r08", "r06")):
        held = open_files(children[name])
        assert ptys[name] in held
        assert ptys[other] not in held


def test_udp(two: Running) -> None:
    restart(two)
    (two.out / FAULTS_FILE).write_text("udp corrupted\n")
    stops_and_counts(two, ("r06", "r08"), lambda: two.health.malformed if two.health else 0)
    assert two.reports["r06"].run == "holding"
    (two.out / FAULTS_FILE).write_text("")
    two.until(lambda: two.moving("r06") or two.moving("r08"), "a HOLD ends by itself")


def test_zenoh(two: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    restart(two)

    def damaged(message: Message) -> bytes:
        payload = encode(message)
        return bytes([payload[0] ^ 1]) + payload[1:]

    monkeypatch.setattr("groundstation.link.encode", damaged)
    stops_and_counts(two, ("r06", "r08"), lambda: count(two, "r06", "refused_StationHeartbeat"))
    monkeypatch.undo()
    two.until(lambda: count(two, "r08", "refused_StationHeartbeat") > 0, "r08 counted, too", 3.0)


@pytest.mark.parametrize("robot", ["r06", "r08"], ids=["slcan", "serial pty"])
def test_wire_to_the_motors(two: Running, robot: str) -> None:
    restart(two)
    (two.out / FAULTS_FILE).write_text(f"{robot} corrupted\n")

    def refused() -> int:
        """By the emulated controller, and by the driver."""
        device = {k: v for k, v in two.motors[robot].counters.items() if not k.startswith("fault_")}
        return min(sum(device.values()), count(two, robot, "driver_") - count(two, robot, "driver_gate"))

    stops_and_counts(two, (robot,), refused)
    two.until(lambda: two.reports[robot].run in ("fault", "stopped"), "it latches", 5.0)
    assert two.reports[robot].reason
    restart(two)
