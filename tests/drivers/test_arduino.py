"""ros_arduino_bridge (README "Firmware commands" of hbrobotics/ros_arduino_bridge)."""

import pytest
from benches import ROBOT, Bench
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import LinkLost, Refused
from drivers.serial import arduino_codec as codec


def test_golden_commands() -> None:
    assert codec.motor_speeds(20, -20) == b"m 20 -20\r"
    assert codec.READ_ENCODERS == b"e\r"


@pytest.mark.parametrize("chunk", [1, 2, 5, 100])
def test_replies_in_any_chunks_with_junk(chunk: int) -> None:
    reader = codec.LineReader()
    data = b"OK\r\n12 -7\r\nInvalid Command\r\nx\r\n-2147483648 2147483647\r\n99999999999 1\r\n5"
    pairs = [pair for start in range(0, len(data), chunk) for pair in reader.feed(data[start : start + chunk])]
    assert pairs == [(12, -7), (-(2**31), 2**31 - 1)]
    assert reader.counters == {"refused_command": 1, "garbage_line": 2}


@given(st.lists(st.binary(max_size=60), max_size=8))
def test_any_bytes_are_survived(chunks: list[bytes]) -> None:
    reader, bench = codec.LineReader(), Bench("ros_arduino")
    for data in chunks:
        reader.feed(data)
        bench.device.receive(data, bench.now_ns)


def test_pitfall_the_published_auto_stop_of_2_s_is_refused_and_zero_names_the_risk() -> None:
    bench = Bench("ros_arduino", watchdog_s=2.0)
    with pytest.raises(Refused, match=r"2\.0 s exceeds safety\.watchdog_s = 0\.2 s"):
        bench.drive.configure()
    Bench("ros_arduino", watchdog_s=0.0).start()
    with pytest.raises(ValueError, match="AUTO_STOP_INTERVAL"):
        Bench("ros_arduino", watchdog_s=None)


def test_bandwidth_of_19200_baud_is_refused_with_the_arithmetic() -> None:
    with pytest.raises(Refused, match="43 bytes x 10 bits / 19200 baud"):
        Bench("ros_arduino", baud=19200).drive.configure()


def test_pitfall_a_board_that_boots_after_opening_is_waited_for() -> None:
    bench = Bench("ros_arduino")
    bench.host.fault(ROBOT, "hung")
    bench.clock.on_pass = lambda now_ns: bench.host.repair(ROBOT, "hung") if now_ns > 12_000_000_000 else None
    bench.drive.configure()
    assert bench.now_ns < 12_500_000_000
    silent = Bench("ros_arduino")
    silent.host.fault(ROBOT, "hung")
    with pytest.raises(LinkLost, match="no answer"):
        silent.drive.configure()


def test_pitfall_without_checksum_an_implausible_jump_is_not_believed() -> None:
    bench = Bench("ros_arduino")
    bench.start()
    before = bench.run(0.3, (5.0, 5.0))
    assert before is not None
    bench.host.robots[ROBOT].wires[0].deliver(b"99999999 5\r\n")
    after = bench.run(0.1, (5.0, 5.0))
    assert after is not None
    assert bench.drive.counters["implausible_jump"] == 1
    assert 0.0 < after.left_rad - before.left_rad < 1.0
