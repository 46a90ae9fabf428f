"""``basicmicro`` (the maker's own library) drives our emulated RoboClaw through a pty."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from basicmicro import Basicmicro

ADDRESS = 0x80


@pytest.fixture(scope="module")
def peer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Basicmicro]:
    link: Path = tmp_path_factory.mktemp("peer") / "roboclaw"
    command = [sys.executable, "-m", "drivers", "emulate", "roboclaw", "--port-link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        peer = Basicmicro(str(link), 115200, timeout=0.5)
        assert peer.Open()
        yield peer
        peer.close()
        process.terminate()


def test_identity_and_health(peer: Basicmicro) -> None:
    assert peer.ReadVersion(ADDRESS) == (True, "USB Roboclaw 2x7a v4.2.8\n")
    assert tuple(peer.ReadMainBatteryVoltage(ADDRESS)) == (1, 120)
    assert tuple(peer.ReadError(ADDRESS)) == (1, 0)
    assert peer.ReadCurrents(ADDRESS)[0]
    assert tuple(peer.ReadTemp(ADDRESS)) == (1, 305)


def test_watchdog_is_off_until_set_and_reads_back(peer: Basicmicro) -> None:
    assert tuple(peer.GetTimeout(ADDRESS)) == (True, 0.0)
    assert peer.SetTimeout(ADDRESS, 0.5)
    assert tuple(peer.GetTimeout(ADDRESS)) == (True, 0.5)
    assert peer.SetTimeout(ADDRESS, 0)


def test_speed_commands_turn_the_motors_and_every_reading_agrees(peer: Basicmicro) -> None:
    assert peer.ResetEncoders(ADDRESS)
    assert peer.SpeedM1M2(ADDRESS, 3000, -2000)
    for _ in range(20000):
        first, second = peer.ReadSpeedM1(ADDRESS), peer.ReadSpeedM2(ADDRESS)
        if abs(first[1] - 3000) < 5 and abs(second[1] - 2000) < 5:
            break
    assert first[2] == 0
    assert second[2] == 1, "speed is a magnitude with a direction byte"
    counts = peer.GetEncoders(ADDRESS)
    assert 0 < counts[1] < 2**31 < counts[2]
    speeds = peer.GetISpeeds(ADDRESS)
    assert speeds[1] == pytest.approx(3000, abs=5)
    assert peer.ReadEncM2(ADDRESS)[2] & 2
    assert peer.SpeedAccelM1M2(ADDRESS, 100_000, 0, 0)
    for _ in range(20000):
        if max(peer.ReadSpeedM1(ADDRESS)[1], peer.ReadSpeedM2(ADDRESS)[1]) < 5:
            break
    assert peer.ReadSpeedM1(ADDRESS)[1] < 5
    assert peer.DutyM1M2(ADDRESS, 0, 0)


@pytest.mark.parametrize(
    ("verb", "arguments", "signs"),
    [
        ("SpeedAccelM1", (100_000, -2000), (-1, 0)),
        ("SpeedAccelM2", (100_000, 2000), (0, 1)),
        ("SpeedAccelM1M2_2", (100_000, 2000, 100_000, -2000), (1, -1)),
        ("DutyAccelM1", (1000, 8000), (1, 0)),
        ("DutyAccelM2", (1000, -8000), (0, -1)),
        ("DutyAccelM1M2", (1000, -8000, 1000, 8000), (-1, 1)),
    ],
)
def test_every_way_to_drive(peer: Basicmicro, verb: str, arguments: tuple[int, ...], signs: tuple[int, int]) -> None:
    def speeds() -> tuple[int, int]:
        """The library reads them as unsigned."""
        _, first, second = peer.GetISpeeds(ADDRESS)
        return (first + 2**31) % 2**32 - 2**31, (second + 2**31) % 2**32 - 2**31

    assert peer.SpeedM1M2(ADDRESS, 0, 0)
    assert any(max(map(abs, speeds())) < 5 for _ in range(20000))
    assert getattr(peer, verb)(ADDRESS, *arguments)
    seen = (0, 0)
    for _ in range(20000):
        seen = speeds()
        if all(speed * sign > 200 for speed, sign in zip(seen, signs, strict=True) if sign):
            break
    assert [(speed > 200) - (speed < -200) for speed in seen] == list(signs), (verb, seen)
    assert peer.DutyM1M2(ADDRESS, 0, 0)


def test_velocity_pid_survives_its_unusual_order(peer: Basicmicro) -> None:
    assert peer.SetM1VelocityPID(ADDRESS, 1.5, 0.5, 0.25, 44000)
    assert tuple(peer.ReadM1VelocityPID(ADDRESS)) == pytest.approx((1, 1.5, 0.5, 0.25, 44000))


def test_encoders_can_be_set(peer: Basicmicro) -> None:
    """The shaft may still run out of the test before and cross one count between the two commands."""
    assert peer.SetEncM1(ADDRESS, 123456)
    assert abs(peer.ReadEncM1(ADDRESS)[1] - 123456) <= 1
