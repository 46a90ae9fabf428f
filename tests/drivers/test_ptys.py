"""The same drivers through python-can and pyserial on real ptys, both ends served by readiness."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from benches import ROBOT, PtyBench

from drivers.base import LinkLost, WheelSpeeds
from drivers.mock.faults import FaultSettings
from drivers.mock.ports import PtyPort

REFUSALS = {"garbage_line", "bad_crc", "foreign_byte", "unknown_command", "garbage_byte", "invalid_command"}


@pytest.fixture(params=["odrive", "roboclaw", "vesc", "vesc_uart", "ros_arduino", "dynamixel", "cia402"])
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[PtyBench]:
    bench = PtyBench(request.param, tmp_path)
    yield bench
    bench.close()


def start(bench: PtyBench) -> None:
    bench.drive.configure()
    bench.drive.activate(time.monotonic_ns())


def test_wheels_turn_and_answer(bench: PtyBench) -> None:
    start(bench)
    sample = None
    for _ in range(2000):
        feedback = bench.step(8.0, -3.0)
        assert feedback is not None
        samples = bench.host.samples(ROBOT)
        sample = samples[-1] if samples else sample
        speeds = bench.host.speeds(ROBOT)
        if sample is not None and sample.left_radps > 7.9 and speeds.left_radps > 0.0 > speeds.right_radps:
            break
    assert feedback.enabled
    assert sample is not None
    assert (sample.left_radps, sample.right_radps) == pytest.approx((8.0, -3.0), abs=0.1)
    assert bench.host.speeds(ROBOT).left_radps > 0.0 > bench.host.speeds(ROBOT).right_radps
    assert not bench.counters()
    assert set(bench.drive.counters) <= {"gate_slew"}


def test_both_wheels_leave_in_one_write(bench: PtyBench) -> None:
    start(bench)
    bench.host.on_readable(bench.host.fds()[0], time.monotonic_ns())
    bench.drive.write(WheelSpeeds(1.0, 2.0), time.monotonic_ns())
    (fd,) = bench.host.fds()
    data = os.read(fd, 4096)
    size = {"odrive": 44, "roboclaw": 12, "vesc": 38, "cia402": 44, "dynamixel": 24, "vesc_uart": 22}
    assert len(data) == size.get(bench.host.robots[ROBOT].family.kind, data.find(b"\r") + 1)


def test_one_flipped_bit_raises_the_counter_and_turns_nothing(bench: PtyBench) -> None:
    start(bench)
    bench.step(0.0, 0.0)
    bench.host.samples(ROBOT)
    bench.host.fault(ROBOT, "corrupted", FaultSettings(directions=("commands",)))
    for _ in range(8):
        bench.drive.write(WheelSpeeds(9.0, 9.0), time.monotonic_ns())
        (fd,) = bench.host.fds()
        bench.host.on_readable(fd, time.monotonic_ns())
    assert REFUSALS & set(bench.counters())
    assert bench.host.speeds(ROBOT) == (0.0, 0.0)
    assert not any(sample.left_radps or sample.right_radps for sample in bench.host.samples(ROBOT))


def test_unplugging_is_a_named_error_and_the_stable_name_works_again(bench: PtyBench) -> None:
    start(bench)
    bench.step(5.0, 5.0)
    bench.host.fault(ROBOT, "unplugged")
    with pytest.raises(LinkLost, match="wheels: cannot"):
        bench.step(5.0, 5.0)
    with pytest.raises(LinkLost, match="cannot open"):
        bench.drive.configure()
    bench.host.repair(ROBOT, "unplugged")
    start(bench)
    assert bench.step(5.0, 5.0) is not None


def test_a_second_program_cannot_take_the_port(bench: PtyBench) -> None:
    start(bench)
    other = type(bench.port)(bench.port.name, 250_000)
    other.host = bench.host
    with pytest.raises(OSError, match=r"(?i)lock|busy"):
        other.open()
    assert bench.step(1.0, 1.0) is not None


def test_a_reader_that_does_not_drain_loses_bytes_but_blocks_nobody(bench: PtyBench) -> None:
    start(bench)
    port = bench.host.robots[ROBOT].port
    for _ in range(200):
        port.write(b"z\r" * 1000)
    assert port.counters["overrun_bytes"] > 0
    assert bench.step(0.0, 0.0) is not None


def test_a_device_that_does_not_drain_costs_setpoints_never_time(bench: PtyBench) -> None:
    start(bench)
    for _ in range(30000):
        bench.drive.write(WheelSpeeds(0.0, 0.0), time.monotonic_ns())
        if "send_dropped" in bench.drive.counters:
            break
    assert bench.drive.counters["send_dropped"] > 0


@pytest.mark.parametrize("junk", [b"\x00", b"\xff\xff\xff", b"\a", b"t08D8\r", bytes(range(256)), b"z" * 100])
def test_garbled_bytes_towards_the_computer_are_survived(bench: PtyBench, junk: bytes) -> None:
    start(bench)
    for _ in range(3):
        bench.host.robots[ROBOT].port.write(junk + b"\r")
        assert bench.step(0.0, 0.0) is not None
    assert bench.host.speeds(ROBOT) == (0.0, 0.0)


def test_a_real_file_or_device_is_never_replaced(tmp_path: Path) -> None:
    for name in ("file", "link"):
        path = tmp_path / name
        path.write_text("x") if name == "file" else path.symlink_to(tmp_path / "file")
        with pytest.raises(FileExistsError, match="not a link to a pty"):
            PtyPort(path).plug()
        assert path.exists()


def test_closing_leaves_no_link_and_no_descriptor(tmp_path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))
    bench = PtyBench("odrive", tmp_path)
    start(bench)
    bench.close()
    bench.close()
    assert len(os.listdir("/proc/self/fd")) == before
    assert not (tmp_path / "wheels").is_symlink()
