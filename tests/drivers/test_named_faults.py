"""Every family against every fault: a typed error that names device, port, what is wrong and what to do."""

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from benches import ROBOT, Bench

from contract.messages import WheelFeedback
from drivers.base import ControllerFault, DriverError, LinkLost, Refused
from drivers.lifecycle import Wheels

CAN = ("odrive", "vesc", "cia402")
SERIAL = ("roboclaw", "ros_arduino", "dynamixel", "vesc_uart")
KINDS = (*CAN, *SERIAL)
STANDS = r"the (left|right) encoder stands still at a commanded (10\.0|-10\.0) rad/s"
NO_TELEMETRY = r"no telemetry for 0\.5\d s although the motors are enabled"
UNDER_VOLTAGE = {
    "odrive": "left bus under voltage, .*right bus under voltage",
    "cia402": "left bus under-voltage, .*right bus under-voltage",
    "roboclaw": "main battery low",
    "dynamixel": "left input voltage, right input voltage",
    "vesc_uart": "left under-voltage, right under-voltage",
    "vesc": r"under-voltage: 7\.0 V, below safety\.battery_critical_v = 10 V",
    "ros_arduino": STANDS,
}


class Expected(NamedTuple):
    """What the agent is told."""

    text: str
    remedy: str
    still_powered: bool = False
    """The order to let go cannot reach the device; its watchdog does it."""


FAULTS: dict[str, Callable[[str], Expected]] = {
    "unplugged": lambda kind: Expected("cannot (send|receive): the device hung up", "Check"),
    "jammed": lambda kind: Expected(r"no room for 10 writes in a row \(ENOBUFS\)", "txqueuelen"),
    "hung": lambda kind: Expected(NO_TELEMETRY, "Check power", still_powered=True),
    "stuck": lambda kind: Expected(STANDS, "Turn the wheel by hand"),
    "off": lambda kind: Expected(STANDS, "supply"),
    "frozen": lambda kind: Expected(STANDS, "encoder cable"),
    "wrong": lambda kind: Expected("the left wheel turns the other way at a commanded 10.0 rad/s", "left_inverted"),
    "brown-out": lambda kind: Expected(UNDER_VOLTAGE[kind], "Charge|cause|supply"),
    "bus-off": lambda kind: Expected(NO_TELEMETRY + r"; the adapter reports bus errors \(bus-off\)", "Check"),
    "corrupted": lambda kind: Expected(
        f"{NO_TELEMETRY}|the line damages bytes" if kind in SERIAL else "the line damages bytes", "Check"
    ),
}


class Listener:
    def __init__(self) -> None:
        self.faults: list[tuple[str, str]] = []
        self.samples: list[WheelFeedback] = []
        self.active = False

    def feedback(self, sample: WheelFeedback, now_ns: int) -> None:
        self.samples.append(sample)

    def driver_fault(self, text: str, remedy: str, now_ns: int) -> None:
        if text:
            self.faults.append((text, remedy))

    def driver_active(self, active: bool, now_ns: int) -> None:
        self.active = active


class Rig(Bench):
    """A bench whose driver is led by its lifecycle, as on a robot."""

    def __init__(self, kind: str) -> None:
        super().__init__(kind, safety={"battery_critical_v": 10.0, "battery_low_v": 11.0} if kind == "vesc" else None)
        self.listener = Listener()
        self.wheels = Wheels(self.drive, self.listener)

    def steps(self, seconds: float, left: float = 10.0, right: float = 10.0) -> None:
        for _ in range(round(seconds / 0.01)):
            if self.listener.faults and not self.listener.active:
                return
            self.wheels.drive(True, type(self.speeds())(left, right), self.now_ns)
            self._pass(0.0025)
            self.wheels.listen(self.now_ns)
            self.wheels.ask(self.now_ns)
            self._pass(0.0075)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", KINDS)
def test_every_fault_of_every_family_is_named_and_ends_the_motion(kind: str, fault: Any) -> None:
    rig = Rig(kind)
    if fault == "bus-off" and kind in SERIAL:
        with pytest.raises(ValueError, match="no CAN bus"):
            rig.host.fault(ROBOT, fault)
        return
    assert rig.wheels.open(rig.now_ns)
    rig.steps(1.2)
    assert not rig.listener.faults
    assert rig.listener.samples
    rig.host.fault(ROBOT, fault)
    rig.steps(1.5)
    expected = FAULTS[fault](kind)
    assert rig.listener.faults, "not noticed"
    text, remedy = next((told for told in rig.listener.faults if re.search(expected.text, told[0])), ("", ""))
    assert text, rig.listener.faults
    assert text.startswith(f"{rig.drive.device} on {rig.drive.port_name}: ")
    assert ROBOT in rig.drive.device
    assert re.search(expected.remedy, remedy), remedy
    rig._pass(2.5)
    if not expected.still_powered and not (fault == "brown-out" and kind != "ros_arduino"):
        assert not rig.listener.active
    if fault == "hung":
        return
    assert rig.speeds() == pytest.approx((0.0, 0.0), abs=0.01), "and the wheels rest"


WRONG_ID: dict[str, tuple[Callable[[Any], None], str]] = {
    "odrive": (lambda d: setattr(d.device.axes[1], "node", 33), r"no heartbeat from right \(node 5\)"),
    "vesc": (lambda d: setattr(d.device.controllers[1], "device", 99), r"from right \(id 11\)"),
    "cia402": (lambda d: setattr(d.device.slaves[1], "node", 99), r"no SDO answer from right \(node 5\)"),
    "roboclaw": (lambda d: setattr(d, "_address", 0x83), "no answer at address 0x80 and 115200 baud"),
    "vesc_uart": (lambda d: setattr(d.pair.controllers[1], "device", 99), r"no values from right \(id 11\) at 115200"),
    "dynamixel": (lambda d: setattr(d.servos[1], "device", 9), "no answer from the right servo, id 2, at 1000000 baud"),
}


@pytest.mark.parametrize("kind", WRONG_ID)
def test_an_id_that_is_not_there_is_named(kind: str) -> None:
    bench = Bench(kind)
    readdress, text = WRONG_ID[kind]
    readdress(bench.device)
    with pytest.raises(LinkLost, match=text) as caught:
        bench.drive.configure()
    assert "id" in caught.value.remedy


@pytest.mark.parametrize(
    ("kind", "rate", "arithmetic"),
    [
        (
            "odrive",
            {"bitrate": 50_000},
            r"5 frames of 675 bits \(stuffed\) / 50000 bit/s = 13\.5 ms a cycle, more than",
        ),
        ("vesc", {"bitrate": 50_000}, r"6 frames of 880 bits \(stuffed\) / 50000 bit/s = 17\.6 ms a cycle"),
        ("cia402", {"bitrate": 50_000}, r"7 frames of 715 bits \(stuffed\) / 50000 bit/s = 14\.3 ms a cycle"),
        (
            "roboclaw",
            {"baud": 38400},
            r"37 bytes x 10 bits / 38400 baud = 9\.6 ms a cycle, more than 80% of the 10\.0 ms",
        ),
        ("vesc_uart", {"baud": 57600}, r"88 bytes x 10 bits / 57600 baud = 15\.3 ms a cycle, more than 80%"),
        ("dynamixel", {"baud": 57600}, r"78 bytes x 10 bits / 57600 baud = 13\.5 ms a cycle, more than 80%"),
        ("ros_arduino", {"baud": 38400}, r"43 bytes x 10 bits / 38400 baud = 11\.2 ms a cycle, more than 80%"),
    ],
)
def test_a_wire_too_slow_for_100_hz_is_refused_with_the_arithmetic(
    kind: str, rate: dict[str, int], arithmetic: str
) -> None:
    with pytest.raises(Refused, match=arithmetic) as caught:
        Bench(kind, **rate).drive.configure()
    assert caught.value.remedy == "Raise the bit rate, or control.control_period_s"


def test_a_typed_error_has_its_parts() -> None:
    error: DriverError = ControllerFault("Thing of r1", "/dev/x", "it is hot", "Cool it")
    assert str(error) == "Thing of r1 on /dev/x: it is hot. Cool it"
