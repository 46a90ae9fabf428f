"""The robot computer's doctor against trees of files: each bad value is found and named, a good computer passes."""

import gc
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard import jitter, switches
from onboard.checkup import CHECKS, checkup, findings
from onboard.cli import main
from onboard.computer import UNLIMITED, Snapshot, snapshot
from onboard.doctor import lines, table
from onboard.jitter import AS_IT_IS, SETTINGS, compare, round_trips, share, summary

GOOD = {
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance\n",
    "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "performance\n",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc\n",
    "sys/devices/system/clocksource/clocksource0/available_clocksource": "tsc hpet acpi_pm\n",
    "sys/bus/usb-serial/devices/ttyUSB0/latency_timer": "1\n",
    "sys/class/net/can0/tx_queue_len": "128\n",
    "sys/class/net/can0/type": "280\n",
    "sys/class/net/eth0/tx_queue_len": "10\n",
    "sys/class/net/eth0/type": "1\n",
    "proc/swaps": "Filename Type Size Used Priority\n",
    "chronyc-tracking": "System time     : 0.000012345 seconds slow of NTP time\nLeap status     : Normal\n",
}
WELL = {
    "collection_ms": (5.0, 0.1),
    "locked_kb": UNLIMITED,
    "niceness": -10,
    "realtime": 50,
    "cores": 4,
    "allowed_cores": 4,
    "optimised": True,
}


@pytest.fixture(scope="module", autouse=True)
def little_to_collect() -> Iterator[None]:
    """Every snapshot times collections: of this module's garbage, not of all that the tests before have left."""
    gc.freeze()
    yield
    gc.unfreeze()


def tree(root: Path, changes: dict[str, str]) -> Snapshot:
    for name, text in (GOOD | changes).items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return snapshot(root)._replace(**WELL)  # type: ignore[arg-type]


def test_a_good_computer_passes(tmp_path: Path) -> None:
    results = checkup(tree(tmp_path, {}))
    assert {result.verdict for result in results} == {"pass"}
    assert all(not result.remedy for result in results)
    assert len(results) >= len(CHECKS) - 1


@pytest.mark.parametrize(
    ("file", "text", "name", "seen", "remedy"),
    [
        (
            "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
            "powersave",
            "CPU governor",
            "cpu1",
            "scaling_governor",
        ),
        ("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet", "clock source", "hpet", "echo tsc"),
        (
            "sys/bus/usb-serial/devices/ttyUSB0/latency_timer",
            "16",
            "FTDI latency timer",
            "16 ms",
            "ttyUSB0/latency_timer",
        ),
        ("sys/class/net/can0/tx_queue_len", "10", "CAN transmit queue", "10 frames", "can0 txqueuelen"),
        ("proc/swaps", "Filename Type Size Used Priority\n/var/swap file 1000 0 -2\n", "swap", "1000 kB", "swapoff"),
        ("chronyc-tracking", "", "chrony", "does not run", "apt-get install chrony"),
        ("chronyc-tracking", "Leap status : Not synchronised\n", "chrony", "Not sync", "chrony.conf"),
        (
            "chronyc-tracking",
            "System time : 0.020000000 seconds fast of NTP time\nLeap status : Normal\n",
            "chrony",
            "+20.0 ms",
            "waitsync",
        ),
        ("sys/devices/platform/soc/soc:firmware/get_throttled", "50005", "throttling", "50005", "supply"),
    ],
)
def test_each_finding_has_its_remedy(tmp_path: Path, file: str, text: str, name: str, seen: str, remedy: str) -> None:
    wrong = [result for result in checkup(tree(tmp_path, {file: text})) if result.verdict != "pass"]
    assert [result.name for result in wrong] == [name]
    assert seen in wrong[0].seen
    assert remedy in wrong[0].remedy


@pytest.mark.parametrize(
    ("change", "name", "remedy"),
    [
        ({"locked_kb": 64}, "memory locking", "LimitMEMLOCK"),
        ({"niceness": 0}, "priority", "Nice=-10"),
        ({"cores": 1, "allowed_cores": 1}, "cores", "jitter"),
        ({"optimised": False}, "Python build", "--enable-optimizations"),
        ({"collection_ms": (40.0, 3.0)}, "garbage collector", "--jitter"),
        ({"power_save": {"wlan0": True}}, "Wi-Fi power save", "wlan0 set power_save off"),
    ],
)
def test_limits_and_interpreter(tmp_path: Path, change: dict[str, object], name: str, remedy: str) -> None:
    wrong = [r for r in checkup(tree(tmp_path, {})._replace(**change)) if r.verdict != "pass"]  # type: ignore[arg-type]
    assert [result.name for result in wrong] == [name]
    assert remedy in wrong[0].remedy


def test_ethernet_is_no_can_bus(tmp_path: Path) -> None:
    assert tree(tmp_path, {}).can_queue == {"can0": 128}


@given(text=st.text(max_size=30))
def test_no_content_of_a_file_crashes_it(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    root = tmp_path_factory.mktemp("tree")
    assert checkup(tree(root, dict.fromkeys(GOOD, text)))


def test_an_empty_tree_has_nothing_to_say(tmp_path: Path) -> None:
    now = snapshot(tmp_path)
    assert (now.governors, now.latency_ms, now.can_queue, now.chrony) == ({}, {}, {}, "")
    assert lines(checkup(now))


def test_this_very_computer_can_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"CPU governor", "chrony", "Python build"} <= {entry["name"] for entry in found}


def test_lines_put_the_remedy_below(tmp_path: Path) -> None:
    text = "\n".join(lines(checkup(tree(tmp_path, {"sys/class/net/can0/tx_queue_len": "10"}))))
    assert re.search(r"^WARN  CAN transmit queue can0 +10 frames$", text, re.MULTILINE)
    assert "-> sudo ip link set can0 txqueuelen 128" in text


def test_the_journal_gets_what_is_wrong_or_that_nothing_is(tmp_path: Path) -> None:
    (line,) = findings(checkup(tree(tmp_path, {"sys/class/net/can0/tx_queue_len": "10"})))
    assert line == "self-check: CAN transmit queue can0: 10 frames -> " + line.partition(" -> ")[2]
    assert "txqueuelen 128" in line
    (line,) = findings(checkup(tree(tmp_path, {})))
    assert line.startswith("self-check: all ")


def test_share_is_the_value_not_exceeded() -> None:
    assert share([5.0, 1.0, 3.0, 2.0, 4.0], 0.5) == 3.0
    assert share([float(n) for n in range(1, 101)], 0.99) == 100.0
    assert share([0.0], 0.99) == 1.0, "ratios need something to divide by"


def test_ratios_are_within_a_turn_and_refusals_are_told() -> None:
    base = [[10.0] * 10, [100.0] * 10, [20.0] * 10]
    half = [[5.0] * 10, [50.0] * 10, [10.0] * 10]
    rows = summary({AS_IT_IS: base, "half": half, "not here": []}, {"not here": "Operation not permitted"})
    assert [row.ratio for row in rows] == [1.0, 0.5, 0.0]
    assert rows[0].max_us == 100.0
    assert table(rows)[-1].endswith("   Operation not permitted")


def test_every_setting_is_tried_in_a_process_of_its_own() -> None:
    before = os.getpriority(os.PRIO_PROCESS, 0), os.sched_getaffinity(0), os.sched_getscheduler(0)
    rows = compare(1, 0.05)
    assert [row.setting for row in rows][: len(SETTINGS)] == list(SETTINGS)
    assert {"FTDI latency timer", "CAN transmit queue", "chrony"} <= {row.setting for row in rows}
    assert all(row.refused or row.p50_us >= 0.0 < row.ratio for row in rows)
    assert not rows[0].refused
    assert (os.getpriority(os.PRIO_PROCESS, 0), os.sched_getaffinity(0), os.sched_getscheduler(0)) == before


def governed(root: Path) -> list[Path]:
    files = [root / f"sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor" for core in (0, 1)]
    for file, governor in zip(files, ("schedutil\n", "performance\n"), strict=True):
        file.parent.mkdir(parents=True)
        file.write_text(governor)
        file.with_name("scaling_available_governors").write_text("schedutil performance\n")
    return files


def test_governors_are_turned_to_and_fro_and_put_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = governed(tmp_path)
    seen: list[list[str]] = []

    def noting(setting: object, seconds: float) -> list[float]:
        seen.append([file.read_text() for file in files])
        return [10.0 * len(seen)]

    monkeypatch.setattr(jitter, "tried", noting)
    rows = {row.setting: row for row in compare(1, 0.05, True, tmp_path)}
    assert seen[len(SETTINGS) :] == [["schedutil"] * 2, ["performance"] * 2]
    assert (rows["governor schedutil"].ratio, rows["governor performance"].ratio) == (7.0, 8.0)
    assert [file.read_text() for file in files] == ["schedutil\n", "performance\n"]


def test_nothing_of_the_machine_is_switched_unless_asked(tmp_path: Path) -> None:
    files = governed(tmp_path)
    with pytest.raises(RuntimeError), switches.held(files, "performance"):
        raise RuntimeError("in the middle")
    assert [file.read_text() for file in files] == ["schedutil\n", "performance\n"]
    with pytest.raises(OSError, match="No such file"), switches.held([*files, tmp_path / "none"], "performance"):
        pytest.fail("not all could be set")
    assert [file.read_text() for file in files] == ["schedutil\n", "performance\n"]
    rows = {row.setting: row for row in compare(1, 0.05, False, tmp_path)}
    assert "--switch" in rows["governor performance"].refused
    assert [file.read_text() for file in files] == ["schedutil\n", "performance\n"]


class Wireless:
    """A machine with one wireless interface, as ``iw``, ``ip`` and ``ping`` tell of it."""

    def __init__(self, gateway: bool = True, answers: bool = True) -> None:
        self.save, self.gateway, self.answers = "on", gateway, answers

    def __call__(self, *words: str) -> str:
        match words:
            case ("iw", "dev"):
                return "phy#0\n\tInterface wlan0\n\t\ttype managed\n"
            case ("iw", "dev", "wlan0", "get", "power_save"):
                return f"Power save: {self.save}\n"
            case ("iw", "dev", "wlan0", "set", "power_save", save):
                self.save = save
            case ("ip", *_):
                return "default via 192.168.7.254 proto dhcp\n" if self.gateway else ""
            case ("ping", *_) if self.answers:
                return f"64 bytes: icmp_seq=1 ttl=64 time={80.0 if self.save == 'on' else 2.0} ms\n" * 3
        return ""


def test_wireless_round_trips_with_power_saving_on_and_off() -> None:
    ask = Wireless()
    on, off = round_trips(2, True, ask)
    assert (on.p99_us, off.p99_us, off.ratio) == (80000.0, 2000.0, 0.025)
    assert ask.save == "on", "as it was"


@pytest.mark.parametrize(
    ("ask", "may_switch", "why"),
    [
        (Wireless(), False, "--switch"),
        (Wireless(gateway=False), True, "no wireless interface"),
        (Wireless(answers=False), True, "does not answer a ping"),
    ],
)
def test_why_there_are_no_wireless_round_trips(ask: Wireless, may_switch: bool, why: str) -> None:
    (row,) = round_trips(1, may_switch, ask)
    assert why in row.refused
    assert ask.save == "on"


@pytest.mark.parametrize("words", [["--turns", "0"], ["--seconds", "0"]])
def test_a_measurement_that_cannot_be_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--jitter", *words]) == 2
    assert "--turns" in capsys.readouterr().err
