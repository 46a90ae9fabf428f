"""Both families, driver against emulated device, in virtual time by the bytes of the wire."""

from typing import Any

import pytest
from benches import ROBOT, Bench, arena_of
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base import ControllerFault, LinkLost, Refused, WheelSpeeds
from drivers.mock.faults import FAULTS, FaultSettings

KINDS = ("odrive", "roboclaw", "ros_arduino", "dynamixel", "vesc", "vesc_uart", "cia402")
VOLTS = {"cia402": 24.0, "odrive": 24.0, "roboclaw": 12.0, "dynamixel": 5.0, "vesc": 24.0, "vesc_uart": 24.0}
SPEED_STEP = {"ros_arduino": 0.15, "dynamixel": 0.02, "vesc": 0.02, "vesc_uart": 0.02}
"""Resolution of the speed command and its feedback, rad/s."""
REFUSALS = {"garbage_line", "bad_crc", "foreign_byte", "unknown_command", "gap", "invalid_command", "garbage_byte"}
RADIUS_M = 0.03
COAST_MPS2 = 0.6


@pytest.fixture(params=KINDS)
def bench(request: pytest.FixtureRequest) -> Bench:
    return Bench(request.param)


def test_lifecycle_turns_the_right_wheels_the_right_way(bench: Bench) -> None:
    bench.start()
    feedback = bench.run(1.6, (10.0, -4.0))
    assert feedback is not None
    assert feedback.enabled
    assert not feedback.faults
    step = SPEED_STEP.get(bench.kind, 0.02)
    assert bench.speeds() == pytest.approx((10.0, -4.0), abs=step)
    assert (feedback.left_radps, feedback.right_radps) == pytest.approx((10.0, -4.0), abs=step)
    wheels = bench.device.wheels
    assert feedback.left_rad == pytest.approx(wheels.left.angle_rad, abs=0.15)
    assert feedback.right_rad == pytest.approx(wheels.right.angle_rad, abs=0.15)
    assert feedback.bus_v == VOLTS.get(bench.kind)
    bench.drive.stop(bench.now_ns)
    bench.run(1.5, (0.0, 0.0))
    bench.drive.deactivate(bench.now_ns)
    assert bench.speeds() == pytest.approx((0.0, 0.0), abs=0.01)
    assert bench.device.wheels.left.powered is (bench.kind == "ros_arduino"), "its only stop is m 0 0, which brakes"
    assert not bench.drive.counters
    assert not bench.device_counters


def test_every_family_rolls_the_body_equally_far() -> None:
    rolled = {}
    for kind in KINDS:
        bench = Bench(kind)
        bench.start()
        bench.run(2.0, (10.0, 10.0))
        bench.run(1.0, (0.0, 0.0))
        rolled[kind] = bench.x_m - 20.0
        assert bench.host.pose(ROBOT)[1:] == pytest.approx((20.0, 0.0), abs=0.01)
    expected_m = 10.0 * RADIUS_M * 2.0
    assert rolled == pytest.approx(dict.fromkeys(KINDS, expected_m), rel=0.02)


def test_nothing_turns_before_activation_or_after_a_stop(bench: Bench) -> None:
    bench.drive.configure()
    bench.run(0.3, (10.0, 10.0))
    assert bench.speeds() == (0.0, 0.0)
    assert bench.drive.counters["gate_disarmed"] > 0
    bench.drive.activate(bench.now_ns)
    bench.run(0.3, (10.0, 10.0))
    bench.drive.stop(bench.now_ns)
    bench.run(1.0, (10.0, 10.0))
    assert bench.speeds() == pytest.approx((0.0, 0.0), abs=0.1)
    assert bench.drive.counters["gate_stopped"] > 0
    bench.drive.activate(bench.now_ns)
    bench.run(0.5, (10.0, 10.0))
    assert bench.speeds().left_radps > 5.0


def test_each_command_becomes_one_sample_with_its_decode_time(bench: Bench) -> None:
    bench.start()
    bench.run(0.1, (1.0, 0.5))
    bench.samples.clear()
    bench.drive.write(WheelSpeeds(2.0, -0.5), bench.now_ns)
    sent_ns = bench.now_ns
    (sample,) = bench.host.samples(ROBOT)
    step = SPEED_STEP.get(bench.kind, 1e-3)
    assert (sample.left_radps, sample.right_radps) == pytest.approx((2.0, -0.5), abs=step)
    assert sample.stamp_ns == sent_ns
    assert sample.enabled
    assert not sample.released


@pytest.mark.parametrize("silence", ["process", "law"])
def test_silence_stops_the_wheels_by_watchdog_or_gate(bench: Bench, silence: str) -> None:
    bench.start()
    bench.run(1.0, (20.0, 20.0))
    start_m, speed = bench.x_m, 20.0 * RADIUS_M
    bench.samples.clear()
    watchdog_s, age_s, lag_s = 0.2, 0.1, 0.1
    if silence == "process":
        bench.run(2.0)
        rolled = speed * watchdog_s + speed**2 / (2 * COAST_MPS2)
        assert [sample.released for sample in bench.samples] == [True]
        assert bench.device_counters["watchdog_expired"] >= 1
        assert not bench.device.wheels.left.powered
    else:
        for _ in range(250):
            bench.clock.let_pass(0.008)
            bench.host.advance(bench.now_ns)
            bench.drive.poll(bench.now_ns)
            bench.drive.read(bench.now_ns)
        rolled = speed * (age_s + 0.008) + speed * lag_s + speed**2 / (2 * 2.0)
        assert bench.drive.counters["gate_stale"] == 1
        assert bench.device.wheels.left.powered, "held at zero in closed loop, the watchdog fed"
        assert "watchdog_expired" not in bench.device_counters
    assert bench.speeds() == pytest.approx((0.0, 0.0), abs=1e-3)
    assert 0.5 * rolled < bench.x_m - start_m <= rolled + 0.01


@settings(max_examples=20)
@given(cut_s=st.floats(0.01, 1.0), speed=st.floats(-25.0, 25.0), kind=st.sampled_from(KINDS))
def test_unplugged_at_any_time_the_wheels_stop_and_the_cause_is_named(cut_s: float, speed: float, kind: str) -> None:
    bench = Bench(kind)
    bench.start()
    bench.run(cut_s, (speed, speed))
    start_m = bench.x_m
    bench.host.fault(ROBOT, "unplugged")
    with pytest.raises(LinkLost, match=f"of {ROBOT} on memory: cannot .*hung up"):
        bench.run(0.1, (speed, speed))
    bench.run(2.5)
    assert bench.speeds() == (0.0, 0.0)
    assert abs(bench.x_m - start_m) <= 0.75 * 0.2 + 0.75**2 / (2 * COAST_MPS2) + 0.01
    bench.host.repair(ROBOT, "unplugged")
    bench.drive.close()
    bench.drive.configure()
    bench.run(0.3, (speed, speed))
    assert bench.speeds() == (0.0, 0.0), "no stale setpoint, no motion without activation"
    bench.drive.activate(bench.now_ns)
    bench.run(1.5, (speed, speed))
    assert bench.speeds() == pytest.approx((speed, speed), abs=SPEED_STEP.get(kind, 0.02))


def test_corrupted_commands_turn_nothing_and_are_counted(bench: Bench) -> None:
    bench.start()
    bench.host.fault(ROBOT, "corrupted", FaultSettings(directions=("commands",)))
    bench.run(0.5, (10.0, 10.0))
    assert bench.speeds() == (0.0, 0.0)
    counters = bench.device_counters
    assert set(counters) & REFUSALS
    assert counters["fault_corrupted"] > 10


def test_corrupted_telemetry_is_counted_and_never_believed(bench: Bench) -> None:
    bench.start()
    bench.run(1.0, (10.0, 10.0))
    bench.host.fault(ROBOT, "corrupted", FaultSettings(directions=("telemetry",), probability=0.4))
    for _ in range(40):
        feedback = bench.run(0.016, (10.0, 10.0))
        if feedback is not None:
            assert (feedback.left_radps, feedback.right_radps) == pytest.approx(
                (10.0, 10.0), abs=SPEED_STEP.get(bench.kind, 0.05)
            )
    assert {"slcan_garbage", "bad_crc", "bad_ack", "no_reply", "garbage_line"} & set(bench.drive.counters)
    bench.host.repair(ROBOT, "corrupted")
    bench.run(0.1, (10.0, 10.0))
    assert bench.run(0.05, (10.0, 10.0)) is not None, "telemetry comes back by itself"


def test_dropped_and_delayed_bytes_recover(bench: Bench) -> None:
    bench.start()
    bench.host.fault(ROBOT, "dropped", FaultSettings(probability=0.3))
    bench.host.fault(ROBOT, "delayed", FaultSettings(probability=0.2, delay_s=0.03))
    bench.run(1.0, (10.0, 10.0))
    for kind in ("dropped", "delayed"):
        bench.host.repair(ROBOT, kind)
    bench.run(1.0, (10.0, 10.0))
    if bench.kind == "odrive" and bench.device.device.axes[0].error:
        bench.drive.activate(bench.now_ns)
    feedback = bench.run(1.5, (10.0, 10.0))
    assert feedback is not None
    assert bench.speeds() == pytest.approx((10.0, 10.0), abs=0.05)


@pytest.mark.parametrize("kind", ["off", "stuck", "wrong", "hung"])
def test_faults_of_motor_and_firmware_show_in_feedback_or_silence(bench: Bench, kind: Any) -> None:
    bench.start()
    bench.run(1.5, (10.0, 10.0))
    bench.host.fault(ROBOT, kind)
    feedback = bench.run(1.5, (10.0, 10.0))
    if kind == "hung":
        bench.run(0.1, (10.0, 10.0))
        assert bench.run(0.3, (0.0, 0.0)) is None
        assert bench.speeds() == pytest.approx((10.0, 10.0), abs=0.01), "the worst device keeps its setpoint"
    else:
        expected = -10.0 if kind == "wrong" else 0.0
        assert feedback is not None
        assert (feedback.left_radps, feedback.right_radps) == pytest.approx((expected, expected), abs=0.01)
    bench.host.repair(ROBOT, kind)


def test_every_fault_verb_is_explained_and_repairable(bench: Bench) -> None:
    for kind in FAULTS:
        if kind == "bus-off" and not hasattr(bench.device, "bus_off"):
            with pytest.raises(ValueError, match="no CAN bus"):
                bench.host.fault(ROBOT, kind)
            continue
        bench.host.fault(ROBOT, kind)
        bench.host.repair(ROBOT, kind)
    bench.drive.configure()
    bench.drive.clear_errors(bench.now_ns)
    bench.start()
    bench.run(1.5, (5.0, 5.0))
    assert bench.speeds() == pytest.approx((5.0, 5.0), abs=0.01)


@settings(max_examples=20)
@given(junk=st.lists(st.binary(min_size=1, max_size=40), max_size=10), kind=st.sampled_from(KINDS))
def test_junk_on_the_wire_never_turns_a_wheel_or_raises(junk: list[bytes], kind: str) -> None:
    bench = Bench(kind)
    bench.start()
    for data in junk:
        bench.device.receive(data + b"\r", bench.now_ns)
        bench.run(0.016, (0.0, 0.0))
        assert all(sample.left_radps == sample.right_radps == 0.0 for sample in bench.samples)


def test_a_silent_device_is_refused_with_a_remedy(bench: Bench) -> None:
    bench.host.fault(ROBOT, "hung")
    with pytest.raises(LinkLost) as caught:
        bench.drive.configure()
    assert caught.value.remedy.startswith("Check")
    assert ROBOT in caught.value.device


# --- ODrive -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dialect", ["0.5", "0.6"])
def test_odrive_both_firmwares_drive(dialect: str) -> None:
    bench = Bench("odrive", dialect=dialect)
    bench.start()
    bench.run(1.5, (6.0, 8.0))
    assert bench.speeds() == pytest.approx((6.0, 8.0), abs=0.01)


@pytest.mark.parametrize("dialect", ["0.5", "0.6"])
def test_odrive_pitfall_watchdog_expiry_is_reported_with_the_firmwares_own_bit(dialect: str) -> None:
    bench = Bench("odrive", dialect=dialect)
    bench.start()
    bench.run(0.5, (6.0, 8.0))
    bench.run(0.5)
    feedback = bench.run(0.2, (6.0, 8.0))
    assert feedback is not None
    assert not feedback.enabled
    assert "left watchdog expired" in feedback.faults
    assert bench.device_counters["setpoint_while_idle"] > 0
    bench.drive.activate(bench.now_ns)
    bench.run(1.5, (6.0, 8.0))
    assert bench.speeds() == pytest.approx((6.0, 8.0), abs=0.01)


@pytest.mark.parametrize(("dialect", "kept_alive"), [("0.5", True), ("0.6", False)])
def test_odrive_pitfall_firmware_05_is_kept_alive_by_telemetry_polls(dialect: str, kept_alive: bool) -> None:
    bench = Bench("odrive", dialect=dialect)
    bench.start()
    bench.run(0.5, (6.0, 6.0))
    for _ in range(60):
        bench.device.receive(b"r0898\rr0A98\r", bench.now_ns)
        bench.run(0.008)
    assert ("watchdog_expired" not in bench.device_counters) is kept_alive


@pytest.mark.parametrize("dialect", ["0.5", "0.6"])
def test_odrive_pitfall_remote_and_empty_polls(dialect: str) -> None:
    bench = Bench("odrive", dialect=dialect)
    bench.drive.configure()
    assert b"t0978" in bench.device.receive(b"r0970\r", bench.now_ns)
    assert (b"t0978" in bench.device.receive(b"t0970\r", bench.now_ns)) is (dialect == "0.5")


def test_odrive_pitfall_bus_voltage_is_not_cyclic_and_must_be_asked_for() -> None:
    bench = Bench("odrive")
    bench.drive.configure()
    data = b"".join(bench.device.advance(bench.now_ns + step * 10_000_000) for step in range(200))
    assert b"t0898" in data
    assert b"t0978" not in data


def test_odrive_pitfall_moves_only_in_closed_loop_and_velocity_control() -> None:
    bench = Bench("odrive")
    bench.drive.configure()
    closed_loop, go = b"t08780800000000000000\r", b"t08D80000803F00000000\r"
    bench.device.receive(go, bench.now_ns)
    bench.device.receive(closed_loop + go, bench.now_ns)
    bench.run(0.1)
    assert bench.speeds() == (0.0, 0.0)
    assert bench.device_counters == {"setpoint_while_idle": 1, "wrong_control_mode": 1}
    bench.device.receive(b"t08B80200000001000000\r" + go, bench.now_ns)
    bench.run(0.1)
    assert bench.speeds().left_radps > 0.0


def test_odrive_with_a_latched_error_is_refused_by_name() -> None:
    bench = Bench("odrive")
    bench.drive.configure()
    bench.device.device.axes[1].shaft.drive = lambda turns: None
    bench.device.device.axes[1]._obey = None
    bench.device.device.take_frame(_estop_frame(), bench.now_ns)
    bench.device.device._request = lambda axis, state, now_ns: None
    with pytest.raises(ControllerFault, match="closed loop not reached"):
        bench.drive.activate(bench.now_ns)


def _estop_frame() -> Any:
    from drivers.can.frame import CanFrame

    return CanFrame(5 << 5 | 0x02, bytes(8))


def test_odrive_nodes_that_are_not_there_are_named() -> None:
    bench = Bench("odrive")
    bench.device.device.axes[1].node = 33
    with pytest.raises(LinkLost, match=r"no heartbeat from right \(node 5\)"):
        bench.drive.configure()
    assert bench.drive.counters["foreign_frame"] > 0


def test_odrive_watchdog_longer_than_the_safety_table_allows_is_refused() -> None:
    bench = Bench("odrive", watchdog_s=0.5)
    with pytest.raises(Refused, match=r"watchdog_s = 0.5 s exceeds safety.watchdog_s = 0.2 s"):
        bench.drive.configure()


@pytest.mark.parametrize(
    ("line", "counter"),
    [
        (b"t0898000080FF00000000\r", None),
        (b"t08980000C07F00000000\r", "bad_estimates"),
        (b"t0898000000000000C87F\r", "bad_estimates"),
        (b"t08980000000000007A47\r", "implausible_speed"),
        (b"t0894000080FF\r", "bad_estimates"),
        (b"t1014000080FF\r", "foreign_frame"),
        (b"t0814000080FF\r", "bad_heartbeat"),
        (b"t0814000080F\r", "slcan_garbage"),
        (b"T000000898000000000000000F\r", "foreign_frame"),
        (b"t0814\r", "slcan_garbage"),
        (b"t09740000C07F\r", "bad_bus"),
        (b"t09380000C07F00000000\r", "unused_frame"),
        (b"r0898\r", "remote_frame"),
    ],
)
def test_odrive_foreign_and_malformed_frames_are_counted_by_name(line: bytes, counter: str | None) -> None:
    bench = Bench("odrive")
    bench.start()
    bench.drive.read(bench.now_ns)
    bench.host.robots[ROBOT].wires[0].deliver(line)
    bench.drive.read(bench.now_ns)
    counters = dict(bench.drive.counters)
    assert counters == ({counter: 1} if counter else counters)


def test_odrive_bus_off_silences_telemetry_and_the_watchdog_releases() -> None:
    bench = Bench("odrive")
    bench.start()
    bench.run(1.0, (20.0, 20.0))
    bench.host.fault(ROBOT, "bus-off")
    bench.run(0.1, (20.0, 20.0))
    assert bench.run(2.0, (20.0, 20.0)) is None
    assert bench.speeds() == (0.0, 0.0)
    assert bench.device_counters["bus_off_frame"] > 0


# --- RoboClaw -----------------------------------------------------------------------------------------


def test_roboclaw_sets_the_device_watchdog_which_is_off_by_default() -> None:
    bench = Bench("roboclaw")
    assert bench.device.timeout_tenths == 0
    bench.drive.configure()
    assert bench.device.timeout_tenths == 2


def test_roboclaw_watchdog_that_does_not_read_back_is_refused() -> None:
    bench = Bench("roboclaw")
    bench.device._handlers[14] = lambda tenths: None
    with pytest.raises(Refused, match=r"serial time-out set to 0.2 s reads back 0 s"):
        bench.drive.configure()


def test_roboclaw_pitfall_38400_baud_is_refused_with_the_arithmetic() -> None:
    bench = Bench("roboclaw", baud=38400)
    with pytest.raises(Refused, match=r"37 bytes x 10 bits / 38400 baud = 9.6 ms"):
        bench.drive.configure()


def test_roboclaw_watchdog_finer_than_the_device_counts_is_refused() -> None:
    bench = Bench("roboclaw", safety={"watchdog_s": 0.05, "command_age_s": 0.04})
    with pytest.raises(Refused, match=r"counts in 0\.1 s"):
        bench.drive.configure()


@pytest.mark.parametrize("start", [2**32 - 3, 2**31 - 2, 5])
def test_roboclaw_encoders_wrap_without_a_jump(start: int) -> None:
    bench = Bench("roboclaw")
    for channel in bench.device.channels:
        channel.set_encoder(start)
    bench.start()
    for _ in range(20):
        feedback = bench.run(0.05, (3.0, -3.0))
        assert feedback is not None
        assert abs(feedback.left_rad) < 5.0
        assert abs(feedback.right_rad) < 5.0
    assert feedback.left_rad == pytest.approx(bench.device.wheels.left.angle_rad, abs=0.05)


def test_roboclaw_channels_may_be_swapped() -> None:
    bench = Bench("roboclaw", left=2, right=1)
    bench.start()
    feedback = bench.run(1.5, (5.0, 2.0))
    assert bench.speeds() == pytest.approx((5.0, 2.0), abs=0.01)
    assert feedback is not None
    assert feedback.left_radps == pytest.approx(5.0, abs=0.02)


def test_roboclaw_pitfall_a_gap_over_10_ms_discards_the_packet() -> None:
    bench = Bench("roboclaw")
    bench.start()
    packet = bytes.fromhex("80250000 03e80000 03e8")
    from drivers.mock.roboclaw_packets import crc16

    packet += crc16(packet).to_bytes(2, "big")
    assert bench.device.receive(packet[:5], bench.now_ns) == b""
    bench.run(0.008)
    assert bench.device.receive(packet[5:], bench.now_ns) == b"\xff", "8 ms is still one packet"
    assert bench.device.receive(packet[:5], bench.now_ns) == b""
    bench.run(0.016)
    assert bench.device.receive(packet[5:], bench.now_ns) == b""
    assert bench.device_counters["gap"] == 1


def test_roboclaw_estop_is_reported_and_clears_only_on_demand() -> None:
    bench = Bench("roboclaw")
    bench.start()
    bench.run(0.5, (5.0, 5.0))
    bench.device.status |= 1
    feedback = bench.run(1.0, (5.0, 5.0))
    assert feedback is not None
    assert feedback.faults == ("estop",)
    assert not feedback.enabled
    assert not bench.device.wheels.left.powered
    bench.drive.deactivate(bench.now_ns)
    with pytest.raises(ControllerFault, match="estop"):
        bench.drive.activate(bench.now_ns)
    bench.drive.clear_errors(bench.now_ns)
    bench.drive.activate(bench.now_ns)
    bench.run(1.5, (5.0, 5.0))
    assert bench.speeds() == pytest.approx((5.0, 5.0), abs=0.01)


def test_roboclaw_old_firmware_with_16_bit_status_is_refused() -> None:
    bench = Bench("roboclaw")
    answer = bench.device._answer
    bench.device._answer = lambda command: b"\0\0" if command == 90 else answer(command)
    with pytest.raises(Refused, match="not 32 bits"):
        bench.drive.configure()


def test_wheels_tables_that_contradict_themselves_name_the_key() -> None:
    for kind, wheels, text in (
        ("odrive", {"left": 1, "right": 1}, "wheels.right = 1: must differ"),
        ("odrive", {"watchdog_s": None}, "watchdog_s"),
        ("odrive", {"dialekt": "0.5"}, 'did you mean "dialect"'),
        ("odrive", {"left": 64}, "from 0 to 63"),
        ("roboclaw", {"left": 2}, "wheels.right = 2: must differ"),
        ("roboclaw", {"address": 0x88}, "from 128 to 135"),
        ("roboclaw", {"counts_per_revolution": 0}, "from 1 to"),
    ):
        with pytest.raises(ValueError, match=text.replace("(", r"\(")):
            arena_of(kind, **wheels)


@pytest.mark.parametrize("kind", ["odrive", "vesc"])
def test_configuring_again_does_not_believe_what_was_heard_before(kind: str) -> None:
    bench = Bench(kind)
    bench.start()
    bench.drive.close()
    bench.host.fault(ROBOT, "hung")
    with pytest.raises(LinkLost, match=r"no (heartbeat|status)"):
        bench.drive.configure()
