"""On the bench: ``doctor``, ``jog`` and ``identify`` against emulated controllers whose state is known."""

import itertools
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from benches import ROBOT, Bench
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import load
from contract.overlay import folder_of, save
from drivers.base import LinkLost, WheelSpeeds
from drivers.cli import main
from drivers.diagnosis import Evidence, diagnose
from drivers.jog import DEAD_MAN_NS, FIRST_NS, KEYS, Jog, Seen, conclude
from drivers.verbs import identify
from drivers.verbs.doctor import link_facts
from drivers.verbs.jog import turn

ARENA = """
[arena]
name = "bench"
size_m = [4.0, 4.0]
[robots.r06]
body = "a"
start = [1.0, 1.0]
wheels = {{ {wheels} }}
"""
ODRIVE = {"kind": "odrive", "interface": "slcan", "left": 0, "right": 1, "watchdog_s": 0.2}
MS = 1_000_000


def arena(folder: Path, wheels: dict[str, Any]) -> Path:
    path = folder / "bench.toml"
    words = ", ".join(
        f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value}" for key, value in wheels.items()
    )
    path.write_text(ARENA.format(wheels=words))
    return path


@pytest.fixture(scope="module")
def odrive(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """An emulated ODrive, firmware 0.6, 250 kbit/s, nodes 0 and 1."""
    link = tmp_path_factory.mktemp("doctor") / "can"
    command = [sys.executable, "-m", "drivers", "emulate", "odrive", "--port-link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield str(link)
        process.terminate()


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({}, 0, ["ok   r06 ids: heard: 0, 1", "ok   r06 dialect: firmware 0.6", "ok   r06 controller"]),
        ({"right": 7}, 1, ["FAIL r06 ids: id 7 is silent; heard on the bus: 0, 1", "Write the ids heard"]),
        (
            {"bitrate": 500000},
            1,
            ["FAIL r06 bitrate: the controllers answer at 250000 bit/s", "Write bitrate = 250000"],
        ),
        ({"dialect": "0.5"}, 1, ["FAIL r06 dialect: the device speaks firmware 0.6", 'Write dialect = "0.6"']),
        ({"watchdog_s": 0.0}, 0, ["WARN r06 watchdog: the device watchdog is off", "watchdog_s = 0.2"]),
        ({"watchdog_s": 0.5}, 1, ["exceeds safety.watchdog_s = 0.2 s"]),
        (
            {"kind": "vesc", "pole_pairs": 7, "channel": "/dev/nowhere"},
            1,
            ["WARN r06 creep: commands below 0.404 m/s turn no wheel, 50% of control.max_speed_mps", "s_pid_min_erpm"],
        ),
        ({"channel": "/dev/nowhere"}, 1, ["FAIL r06 port: /dev/nowhere is not there; found:", "Plug the adapter in"]),
    ],
)
def test_doctor_names_what_is_wrong_and_the_remedy(
    odrive: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    code: int,
    words: list[str],
) -> None:
    path = arena(tmp_path, {**ODRIVE, "channel": odrive, **changes})
    assert main(["doctor", str(path)]) == code
    text = capsys.readouterr().out
    for word in words:
        assert word in text


GOOD = Evidence("/dev/ttyUSB0", True)
UP = {"up": True, "bitrate": 250000, "state": "ERROR-ACTIVE", "restart_ms": 100}


@pytest.mark.parametrize(
    ("seen", "name", "verdict", "remedy"),
    [
        (GOOD._replace(usable=False), "permission", "fail", "usermod -aG dialout"),
        (GOOD._replace(latency_ms=16), "latency", "warn", "ttyUSB0/latency_timer"),
        (GOOD._replace(latency_ms=1), "latency", "pass", ""),
        (GOOD._replace(link={**UP, "up": False}), "interface", "fail", "ip link set /dev/ttyUSB0 up"),
        (GOOD._replace(link={**UP, "bitrate": 500000}), "bitrate", "fail", "type can bitrate 250000"),
        (GOOD._replace(link={**UP, "state": "BUS-OFF"}), "interface", "fail", "termination"),
        (GOOD._replace(link={**UP, "state": "ERROR-PASSIVE"}), "interface", "warn", "termination"),
        (GOOD._replace(link=UP), "interface", "pass", ""),
        (GOOD._replace(error=LinkLost("d", "p", "no heartbeat", "Check power")), "controller", "fail", "Check power"),
    ],
)
def test_every_finding_has_its_remedy(seen: Evidence, name: str, verdict: str, remedy: str) -> None:
    results = {result.name: result for result in diagnose("r06", {"channel": "can0", "bitrate": 250000}, seen)}
    assert results[name].verdict == verdict
    assert remedy in results[name].remedy


@pytest.mark.parametrize(
    ("kind", "creep_mps", "verdict", "remedy"),
    [
        ("ros_arduino", 0.08, "pass", ""),
        ("vesc", 0.081, "warn", "s_pid_min_erpm"),
        ("vesc_uart", 0.081, "warn", "s_pid_min_erpm"),
        ("ros_arduino", 0.799, "warn", "PID_RATE"),
        ("ros_arduino", 0.8, "fail", "PID_RATE"),
        ("of your own", 0.9, "fail", "Gear the motor down"),
    ],
)
def test_wheels_that_cannot_creep_are_a_finding(kind: str, creep_mps: float, verdict: str, remedy: str) -> None:
    (found,) = [
        result
        for result in diagnose("r06", {"kind": kind}, GOOD._replace(creep_mps=creep_mps, max_speed_mps=0.8))
        if result.name == "creep"
    ]
    assert found.verdict == verdict
    assert remedy in found.remedy
    assert bool(found.remedy) == (verdict != "pass")


@pytest.mark.parametrize(
    ("kind", "changes", "rim_mps"),
    [
        ("vesc", {"min_erpm": 900.0}, 900 / 60 / 7 * 2 * 3.14159 * 0.03 / 7),
        ("vesc_uart", {"min_erpm": 900.0}, 900 / 60 / 7 * 2 * 3.14159 * 0.03 / 7),
        ("ros_arduino", {"counts_per_revolution": 20}, 0.5 * 30 / 20 * 2 * 3.14159 * 0.03 / 7),
        ("odrive", {}, 0.0),
    ],
)
def test_the_arena_file_tells_how_slowly_wheels_turn(kind: str, changes: dict[str, Any], rim_mps: float) -> None:
    bench = Bench(kind, **changes)
    assert bench.drive.dead_zone_radps * 0.03 == pytest.approx(rim_mps, rel=1e-4)
    if rim_mps:
        bench.start()
        for share, turns in ((0.95, False), (1.05, True)):
            bench.run(1.0, (share * rim_mps / 0.03, share * rim_mps / 0.03))
            assert (bench.speeds().left_radps > 0.01) == turns


def test_what_ip_says_of_a_can_interface() -> None:
    info = {"state": "ERROR-ACTIVE", "restart_ms": 100, "bittiming": {"bitrate": 250000}}
    assert link_facts({"flags": ["NOARP", "UP"], "linkinfo": {"info_data": info}}) == UP
    assert link_facts({"flags": []}) == {"up": False, "bitrate": None, "state": None, "restart_ms": None}


def test_jog_turns_while_the_key_is_held_and_stops_when_let_go() -> None:
    bench = Bench("odrive")
    bench.drive.configure()
    bench.drive.activate(bench.now_ns)
    jog = Jog(0.03)
    for _ in range(40):
        turn(bench.drive, jog, "w", bench.now_ns)
        bench._pass(0.03)
    assert bench.speeds() == pytest.approx((0.1 / 0.03, 0.1 / 0.03), abs=0.05)
    for _ in range(60):
        turn(bench.drive, jog, "", bench.now_ns)
        bench._pass(0.02)
    assert bench.speeds() == pytest.approx((0.0, 0.0), abs=0.01)


@given(st.lists(st.tuples(st.sampled_from([*KEYS, "+", "-", " ", "z", "\x1b", "x"]), st.integers(0, 900)), max_size=30))
def test_no_keys_exceed_the_limit_or_outlive_the_dead_man(keys: list[tuple[str, int]]) -> None:
    jog, now_ns = Jog(0.03, 0.2), 10**9
    for key, wait_ms in keys:
        jog.press(key, now_ns)
        assert max(map(abs, jog.speeds(now_ns))) * 0.03 <= 0.2 + 1e-9
        now_ns += wait_ms * MS
    assert jog.speeds(now_ns + FIRST_NS) == (0.0, 0.0)
    assert FIRST_NS > DEAD_MAN_NS


def test_the_end_key_and_an_unknown_key_stop_at_once() -> None:
    jog = Jog(0.03)
    for key in (" ", "z", "x"):
        jog.press("w", 10**9)
        jog.press(key, 10**9 + MS)
        assert jog.speeds(10**9 + 2 * MS) == (0.0, 0.0)
    assert jog.ended


def seen_on(bench: Bench, truth: dict[str, Any], told: str) -> Seen:
    """What a person sees of a robot wired as ``truth`` says when its driver turns one wheel."""
    bench.drive.activate(bench.now_ns)
    before = bench.device.wheels.left.angle_rad, bench.device.wheels.right.angle_rad
    bench.run(0.5, (3.0, 0.0) if told == "left" else (0.0, 3.0))
    after = bench.device.wheels.left.angle_rad, bench.device.wheels.right.angle_rad
    moved = [new - old for new, old in zip(after, before, strict=True)]
    bench.run(1.0, (0.0, 0.0))
    if max(map(abs, moved)) < 0.2:
        return "n"
    side = 0 if abs(moved[0]) > abs(moved[1]) else 1
    return ("lf", "lb", "rf", "rb")[2 * side + (moved[side] < 0)]  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("swapped", "left_inverted", "right_inverted"), list(itertools.product((False, True), repeat=3))
)
def test_identify_finds_every_wiring(swapped: bool, left_inverted: bool, right_inverted: bool) -> None:
    """The file says ids 4, 5 and nothing inverted; the robot is wired otherwise."""
    truth = {"left_inverted": left_inverted, "right_inverted": right_inverted}
    if swapped:
        truth |= {"left": 5, "right": 4}  # type: ignore[dict-item]
    stated = {"kind": "odrive", "left": 4, "right": 5, "right_inverted": False}
    results = []
    wheels: dict[str, Any] = dict(stated)
    for _ in range(2):
        bench = Bench("odrive", **truth, **({} if swapped else {"left": 4, "right": 5}))
        driver = Bench("odrive", **{k: v for k, v in wheels.items() if k != "kind"})
        bench.drive.inner.motors = driver.drive.inner.motors
        bench.drive.inner._by_device = driver.drive.inner._by_device
        bench.drive.configure()
        results = [seen_on(bench, truth, told) for told in ("left", "right")]
        conclusion = conclude(wheels, results[0], results[1])
        assert not conclusion.fault
        wheels |= conclusion.changes
    assert results == ["lf", "rf"], "after one correction all is right"
    assert not conclusion.changes


def test_identify_says_what_settings_cannot_mend() -> None:
    assert "left wheel" in conclude({"left": 0, "right": 1}, "n", "rf").fault
    assert "one motor" in conclude({"left": 0, "right": 1}, "lf", "lb").fault
    assert "swap the plugs" in conclude({"kind": "ros_arduino"}, "rf", "lf").fault
    assert conclude({"kind": "roboclaw"}, "rf", "lf").changes == {"left": 2, "right": 1}


def test_identify_shows_the_difference_and_writes_only_what_was_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = arena(tmp_path, {**ODRIVE, "channel": "/dev/x"})
    save(folder_of(path) / "r06.toml", {"robots": {"r06": {"heading_offset_rad": 0.2}}})
    wheels = load(path).robots["r06"].wheels
    assert identify.settle(path, "r06", wheels, "rf", "lb", lambda question: "n") == 1
    assert load(path).robots["r06"].wheels == wheels
    assert identify.settle(path, "r06", wheels, "rf", "lb", lambda question: "y") == 0
    out = capsys.readouterr().out
    assert "robots.r06.wheels.left: 0 -> 1" in out
    robot = load(path).robots["r06"]
    assert (robot.wheels["left"], robot.wheels["right"], robot.heading_offset_rad) == (1, 0, 0.2)
    assert identify.settle(path, "r06", robot.wheels, "n", "lf", None) == 1
    assert identify.answer(_answers("", "xx", "RB")) == "rb"
    assert set(get_args(Seen)) == {"lf", "lb", "rf", "rb", "n"}


def _answers(*words: str) -> identify.Ask:
    left = list(words)
    return lambda question: left.pop(0)


def test_identify_turns_one_wheel_at_a_time() -> None:
    bench = Bench("odrive")
    bench.drive.configure()
    assert seen_on(bench, {}, "left") == "lf"
    assert seen_on(bench, {}, "right") == "rf"
    bench.drive.write(WheelSpeeds(0.0, 0.0), bench.now_ns)
    assert bench.host.robots[ROBOT].name == ROBOT
