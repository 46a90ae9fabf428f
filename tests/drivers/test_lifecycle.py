"""The driver's lifecycle: what a driver is told in which order, and how it fails and comes back."""

import pytest
from msgspec.structs import replace

from contract.messages import WheelFeedback
from drivers.base import LinkLost, WheelSpeeds
from drivers.lifecycle import GARBLED_NS, LOOK_NS, REOPEN_NS, LineCheck, Wheels

MS = 1_000_000
FAST = WheelSpeeds(1.0, 2.0)
SAMPLE = WheelFeedback(robot="r06", stamp_ns=1, left_radps=0.0, right_radps=0.0, left_rad=0.0, right_rad=0.0)


class Driver:
    """Notes every call; fails where it is told to."""

    def __init__(self) -> None:
        self.calls: list[object] = []
        self.failing: set[str] = set()
        self.counters: dict[str, int] = {}
        self.sample: WheelFeedback | None = None

    def _do(self, name: str, *values: object) -> None:
        self.calls.append((name, *values) if values else name)
        if name in self.failing:
            raise LinkLost("emulated", "nowhere", f"{name} failed", "plug it in")

    def configure(self) -> None:
        self._do("configure")

    def activate(self, now_ns: int) -> None:
        self._do("activate")

    def write(self, speeds: WheelSpeeds, now_ns: int, stamp_ns: int | None = None) -> None:
        self._do("write", *speeds)

    def poll(self, now_ns: int) -> None:
        self._do("poll")

    def read(self, now_ns: int) -> WheelFeedback | None:
        self._do("read")
        return self.sample

    device = "emulated"
    port_name = "nowhere"

    def check(self, now_ns: int) -> None:
        if "check" in self.failing:
            self._do("check")

    def stop(self, now_ns: int) -> None:
        self._do("stop")

    def deactivate(self, now_ns: int) -> None:
        self._do("deactivate")

    def clear_errors(self, now_ns: int) -> None:
        self._do("clear_errors")

    def reported(self, sample: WheelFeedback) -> LinkLost:
        return LinkLost("emulated", "nowhere", ", ".join(sample.faults), "cool it")

    def close(self) -> None:
        self.calls.append("close")

    def fileno(self) -> int | None:
        return None


class Listener:
    def __init__(self) -> None:
        self.fault = ("", "")
        self.active: list[bool] = []
        self.samples: list[WheelFeedback] = []

    def feedback(self, sample: WheelFeedback, now_ns: int) -> None:
        self.samples.append(sample)

    def driver_fault(self, text: str, remedy: str, now_ns: int) -> None:
        self.fault = (text, remedy)

    def driver_active(self, active: bool, now_ns: int) -> None:
        self.active.append(active)


@pytest.fixture
def driver() -> Driver:
    return Driver()


@pytest.fixture
def listener() -> Listener:
    return Listener()


@pytest.fixture
def wheels(driver: Driver, listener: Listener) -> Wheels:
    return Wheels(driver, listener)


def test_enable_activates_then_writes_and_disable_stops_then_disables(
    wheels: Wheels, driver: Driver, listener: Listener
) -> None:
    assert wheels.open(1_000 * MS)
    driver.calls.clear()
    assert not wheels.drive(False, FAST, 0)
    assert driver.calls == []
    assert not wheels.drive(True, FAST, 0), "activation writes no speed"
    assert wheels.drive(True, FAST, 0)
    assert not wheels.drive(False, FAST, 0)
    assert not wheels.drive(False, FAST, 0)
    assert driver.calls == ["activate", ("write", 1.0, 2.0), "stop", "deactivate"]
    assert listener.active == [True, False]


def test_a_driver_that_does_not_open_is_tried_again_at_intervals(
    wheels: Wheels, driver: Driver, listener: Listener
) -> None:
    driver.failing = {"configure"}
    assert not wheels.open(1_000 * MS)
    assert "configure failed" in listener.fault[0]
    assert listener.fault[1] == "plug it in"
    driver.failing = set()
    assert not wheels.open(1_000 * MS + REOPEN_NS - 1)
    assert wheels.open(1_000 * MS + REOPEN_NS)
    assert listener.fault == ("", "")
    assert not wheels.drive(False, FAST, 0)


@pytest.mark.parametrize("call", ["activate", "write", "poll", "read", "stop", "deactivate"])
def test_a_failing_call_disables_and_tells_and_never_writes_again(
    wheels: Wheels, driver: Driver, listener: Listener, call: str
) -> None:
    wheels.open(1_000 * MS)
    wheels.drive(True, FAST, 0)
    if call == "activate":
        wheels.drive(False, FAST, 0)
    driver.failing = {call}
    wheels.drive(True, FAST, 0)
    wheels.ask(0)
    wheels.listen(0)
    wheels.drive(False, FAST, 0)
    assert f"{call} failed" in listener.fault[0]
    assert listener.active[-1] is False
    driver.failing = set()
    driver.calls.clear()
    assert not wheels.drive(True, FAST, 0)
    wheels.ask(0)
    wheels.listen(0)
    assert driver.calls == []


def test_a_fault_of_the_controller_is_cleared_by_opening_again(
    wheels: Wheels, driver: Driver, listener: Listener
) -> None:
    wheels.open(1_000 * MS)
    assert wheels.open(2_000 * MS, again=True)
    driver.sample = replace(SAMPLE, faults=("heat",))
    wheels.listen(0)
    assert "heat" in listener.fault[0]
    driver.calls.clear()
    assert wheels.open(3_000 * MS)
    assert driver.calls == [], "not before somebody has released the robot"
    assert wheels.open(3_000 * MS, again=True)
    assert driver.calls == ["close", "configure", "clear_errors"]
    assert listener.fault == ("", "")
    driver.calls.clear()
    assert wheels.open(4_000 * MS, again=True)
    assert driver.calls == []


def test_errors_that_could_not_be_cleared_are_cleared_later(wheels: Wheels, driver: Driver) -> None:
    wheels.open(1_000 * MS)
    driver.sample = replace(SAMPLE, faults=("heat",))
    wheels.listen(0)
    driver.failing = {"configure"}
    assert not wheels.open(2_000 * MS, again=True)
    driver.failing = set()
    driver.calls.clear()
    assert wheels.open(3_000 * MS)
    assert driver.calls == ["close", "configure", "clear_errors"]


def test_a_release_just_after_a_try_is_not_forgotten(wheels: Wheels, driver: Driver) -> None:
    wheels.open(1_000 * MS)
    driver.sample = replace(SAMPLE, faults=("heat",))
    wheels.listen(0)
    driver.calls.clear()
    wheels.open(1_000 * MS + 1, again=True)
    assert driver.calls == []
    wheels.open(2_000 * MS)
    assert "clear_errors" in driver.calls


def test_a_line_that_failed_comes_back_without_old_errors(wheels: Wheels, driver: Driver) -> None:
    wheels.open(1_000 * MS)
    wheels.drive(True, FAST, 0)
    driver.failing = {"read"}
    wheels.listen(0)
    driver.failing = set()
    driver.calls.clear()
    assert wheels.open(2_000 * MS)
    assert driver.calls == ["close", "configure", "clear_errors"]


def test_old_errors_told_once_more_after_they_were_cleared_do_not_stay(
    wheels: Wheels, driver: Driver, listener: Listener
) -> None:
    wheels.open(1_000 * MS)
    driver.sample = replace(SAMPLE, faults=("heat",))
    wheels.listen(0)
    wheels.open(2_000 * MS, again=True)
    assert listener.fault == ("", "")
    wheels.listen(0)
    assert "heat" in listener.fault[0]
    driver.sample = SAMPLE
    wheels.listen(0)
    assert listener.fault == ("", "")


def test_enabled_motors_whose_fault_comes_and_goes_stay_faulty(
    wheels: Wheels, driver: Driver, listener: Listener
) -> None:
    wheels.open(1_000 * MS)
    wheels.drive(True, FAST, 0)
    driver.sample = replace(SAMPLE, faults=("heat",))
    wheels.listen(0)
    driver.sample = SAMPLE
    wheels.listen(0)
    assert "heat" in listener.fault[0]


def test_enabled_motors_are_never_opened_anew(wheels: Wheels, driver: Driver) -> None:
    wheels.open(1_000 * MS)
    wheels.drive(True, FAST, 0)
    driver.sample = replace(SAMPLE, faults=("heat",))
    wheels.listen(0)
    driver.calls.clear()
    wheels.open(2_000 * MS, again=True)
    assert driver.calls == []
    wheels.drive(False, FAST, 0)
    wheels.open(2_000 * MS)
    assert "clear_errors" in driver.calls


@pytest.mark.parametrize("failing", [set(), {"stop"}, {"deactivate"}, {"stop", "deactivate"}])
def test_shut_does_all_it_can(wheels: Wheels, driver: Driver, failing: set[str]) -> None:
    wheels.open(1_000 * MS)
    driver.failing = failing
    driver.calls.clear()
    wheels.shut(0)
    assert driver.calls == ["stop", "deactivate", "close"]


def test_feedback_is_handed_on(wheels: Wheels, driver: Driver, listener: Listener) -> None:
    wheels.open(1_000 * MS)
    wheels.listen(0)
    assert listener.samples == []
    driver.sample = SAMPLE
    wheels.listen(0)
    assert listener.samples == [driver.sample]


def looks(check: LineCheck, errors_by_look: list[int], step_ns: int = LOOK_NS) -> list[int]:
    total, found = 0, []
    for number, errors in enumerate(errors_by_look, 1):
        total += errors
        found.append(check.garbled({"slcan_garbage": total, "foreign": 9 * number}, 1_000 * MS + number * step_ns))
    return found


def test_damage_in_every_look_is_a_fault_and_one_clean_look_starts_over() -> None:
    enough = GARBLED_NS // LOOK_NS + 2
    assert not any(looks(LineCheck(), [0] * 20))
    assert looks(LineCheck(), [1] * enough)[-1] == enough
    assert not any(looks(LineCheck(), [1] * (enough - 2)))
    assert not any(looks(LineCheck(), ([1] * (enough - 2) + [0]) * 4))


def test_a_loop_that_slept_does_not_mistake_one_error_for_many() -> None:
    assert not any(looks(LineCheck(), [1] * 20, step_ns=5 * LOOK_NS))


def test_a_garbled_line_stops_the_driver(wheels: Wheels, driver: Driver, listener: Listener) -> None:
    wheels.open(1_000 * MS)
    wheels.drive(True, FAST, 0)
    for look in range(12):
        driver.counters["bad_crc"] = look
        wheels.listen(1_000 * MS + look * LOOK_NS)
    assert "damages bytes" in listener.fault[0]
    assert listener.active == [True, False]
