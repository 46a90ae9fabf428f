"""The CAN drivers on a real kernel bus: vcan, and the kernel's slcan driver on a pty.

Needs root and a kernel with vcan and slcan; tests/root/test_socketcan.py runs it, in a network
namespace of its own or in the guest.
"""

import errno
import fcntl
import os
import select
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from drivers.base import LinkLost, WheelSpeeds
from drivers.can.bus import BusPort
from drivers.can.frame import CanFrame
from drivers.can.slcan_text import SlcanReader
from drivers.mock.host import EmulatedWheels
from drivers.registry import open_robot
from tests.drivers.benches import ROBOT, arena_of
from tests.house.checkout import ROOT

KINDS = ("odrive", "vesc", "cia402")
N_SLCAN = 17
SIOCGIFNAME = 0x8910
"""On the tty of an slcan line discipline: the name of its interface."""
BIT_RATE = "ip link set can0 up type can bitrate 500000"
"""As the page on drivers has it."""


def ip(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True, capture_output=True, timeout=20)


class ServedPort(BusPort):
    """The product's port, whose waits let the emulated end run."""

    serve: Callable[[int | None, float], None]

    def wait(self, timeout_s: float) -> None:
        self.serve(self.fileno(), timeout_s)


class KernelBench:
    """A driver and its emulated controllers, two sockets on one kernel interface."""

    def __init__(self, kind: str, channel: str) -> None:
        arena = arena_of(kind, interface="socketcan", channel=channel)
        self.host = EmulatedWheels(arena)
        self.device: Any = self.host.robots[ROBOT].controller.device
        self.far = BusPort("socketcan", channel)
        self.port = ServedPort("socketcan", channel)
        self.port.serve = self.serve
        self.drive = open_robot(arena, ROBOT, port=self.port)
        self.far.open()

    def turn_far(self) -> None:
        """What the controllers on the bus do now."""
        now_ns = time.monotonic_ns()
        try:
            frames = self.far.receive()
            sent = [answer for frame in frames for answer in self.device.take_frame(frame, now_ns)]
            self.far.send(sent + self.device.advance(now_ns))
        except OSError:
            self.device.advance(now_ns)

    def serve(self, fd: int | None, timeout_s: float) -> None:
        end_ns = time.monotonic_ns() + int(timeout_s * 1e9)
        while True:
            self.turn_far()
            now_ns = time.monotonic_ns()
            due_ns = min(self.device.next_due_ns() or end_ns, end_ns)
            mine, theirs = fd, self.far.fileno()
            watched = [entry for entry in (mine, theirs) if entry is not None]
            ready, _, _ = select.select(watched, [], [], max(0, due_ns - now_ns) * 1e-9)
            if mine in ready or now_ns >= end_ns:
                return

    def start(self) -> None:
        self.drive.configure()
        self.drive.activate(time.monotonic_ns())

    def step(self, left: float, right: float) -> Any:
        """Control steps until telemetry arrived; None after 40."""
        for _ in range(40):
            self.drive.write(WheelSpeeds(left, right), time.monotonic_ns())
            self.drive.poll(time.monotonic_ns())
            for _ in range(4):
                self.port.wait(0.005)
                sample = self.drive.read(time.monotonic_ns())
                if sample is not None:
                    return sample
        return None

    def until(self, done: Callable[[], bool]) -> None:
        """Only the controllers run."""
        end_ns = time.monotonic_ns() + 20_000_000_000
        while not done():
            assert time.monotonic_ns() < end_ns
            self.serve(None, 0.01)

    def standing(self) -> bool:
        return self.host.speeds(ROBOT) == (0.0, 0.0)

    def close(self) -> None:
        self.drive.close()
        self.far.close()


@pytest.fixture
def vcan() -> Iterator[str]:
    ip("add", "vcan0", "type", "vcan")
    ip("set", "vcan0", "up")
    yield "vcan0"
    subprocess.run(["ip", "link", "del", "vcan0"], check=False, capture_output=True)


@pytest.fixture(params=KINDS)
def bench(request: pytest.FixtureRequest, vcan: str) -> Iterator[KernelBench]:
    bench = KernelBench(request.param, vcan)
    yield bench
    bench.close()


def moving(bench: KernelBench) -> None:
    bench.start()
    for _ in range(3000):
        feedback = bench.step(8.0, -3.0)
        if feedback is not None and feedback.left_radps > 7.0:
            return
    raise AssertionError("the wheels never got up to speed")


def test_wheels_turn_and_answer(bench: KernelBench) -> None:
    moving(bench)
    left, right = bench.host.speeds(ROBOT)
    assert left > 6.5
    assert right < -2.0
    feedback = bench.step(8.0, -3.0)
    assert feedback.enabled
    assert set(bench.drive.counters) <= {"gate_slew"}
    assert not bench.device.counters


STANDSTILL = {
    "odrive": {(0x08D, "0000000000000000"), (0x0AD, "0000008000000000")},
    "vesc": {(0x20A, "00001388"), (0x20B, "00001388")},
    "cia402": {(0x204, "0f0000000000"), (0x205, "0f0000000000"), (0x77F, "05")},
}
"""Velocity 0 (and -0, the inverted motor); a brake current of 5 A; enabled at velocity 0, with the heartbeat."""


@pytest.mark.parametrize("kind", KINDS)
def test_a_third_program_on_the_bus_hears_the_bytes_of_the_manual(kind: str, vcan: str) -> None:
    bench = KernelBench(kind, vcan)
    bench.start()
    with can.Bus(interface="socketcan", channel=vcan) as listener:
        bench.drive.write(WheelSpeeds(0.0, 0.0), time.monotonic_ns())
        heard = set()
        while (message := listener.recv(0)) is not None:
            heard.add((message.arbitration_id, message.data.hex()))
    bench.close()
    assert heard == STANDSTILL[kind]


def test_interface_down_is_named_and_the_wheels_stop_by_the_device_watchdog(bench: KernelBench, vcan: str) -> None:
    moving(bench)
    ip("set", vcan, "down")
    with pytest.raises(LinkLost, match=rf"of {ROBOT} on {vcan}: cannot (send|receive): .*[Nn]etwork is down") as caught:
        bench.step(8.0, -3.0)
    assert f"ip link set {vcan} up" in caught.value.remedy
    bench.until(bench.standing)
    assert bench.device.counters["watchdog_expired"] >= 1


def test_pitfall_opening_a_down_interface_succeeds_but_configure_does_not(bench: KernelBench, vcan: str) -> None:
    moving(bench)
    ip("set", vcan, "down")
    for _ in range(2):
        bench.drive.close()
        with pytest.raises(LinkLost, match=rf"on {vcan}: cannot (send|receive): .*Network is down") as caught:
            bench.drive.configure()
        assert f"ip link set {vcan} up" in caught.value.remedy
    bench.until(bench.standing)
    ip("set", vcan, "up")
    bench.far.close()
    bench.far.open()
    bench.drive.configure()
    assert bench.step(8.0, -3.0) is not None
    assert bench.standing(), "no stale setpoint, no motion without activation"
    moving(bench)


def test_interface_gone_is_named_and_comes_back_under_its_name(bench: KernelBench, vcan: str) -> None:
    moving(bench)
    ip("del", vcan)
    with pytest.raises(LinkLost, match=rf"on {vcan}: cannot (send|receive): ") as caught:
        bench.step(8.0, -3.0)
    assert caught.value.remedy.startswith(("Plug the adapter in", "Bring the interface up"))
    with pytest.raises(LinkLost, match=rf"on {vcan}: cannot open: .*No such device") as caught:
        bench.drive.configure()
    assert caught.value.remedy.startswith("Plug the adapter in")
    bench.until(bench.standing)
    ip("add", vcan, "type", "vcan")
    ip("set", vcan, "up")
    bench.far.close()
    bench.far.open()
    moving(bench)


def test_foreign_traffic_is_counted_and_turns_nothing(bench: KernelBench, vcan: str) -> None:
    bench.start()
    with can.Bus(interface="socketcan", channel=vcan) as stranger:
        for number in (0x7FF, 0x1FFFFFFF, 0x060):
            stranger.send(can.Message(arbitration_id=number, data=b"\xff" * 8, is_extended_id=number > 0x7FF))
    assert bench.step(0.0, 0.0) is not None
    assert bench.drive.counters["foreign_frame"] == 3
    assert bench.host.speeds(ROBOT) == (0.0, 0.0)


# --- the kernel's slcan driver ------------------------------------------------------------------------


class KernelAdapter:
    """A pty whose slave carries the kernel's slcan line discipline; the test is the adapter."""

    def __init__(self, up: bool = True) -> None:
        self.master, self.slave = os.openpty()
        settings = termios.tcgetattr(self.slave)
        settings[0] = settings[1] = settings[3] = 0
        termios.tcsetattr(self.slave, termios.TCSANOW, settings)
        os.set_blocking(self.master, False)
        fcntl.ioctl(self.slave, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        self.name = fcntl.ioctl(self.slave, SIOCGIFNAME, bytes(40)).split(b"\0")[0].decode()
        if up:
            ip("set", self.name, "up")

    def says(self, line: bytes) -> None:
        os.write(self.master, line)

    def hears(self) -> list[CanFrame]:
        """Everything sent so far, as frames; waits for the first bytes."""
        select.select([self.master], [], [], 5.0)
        reader = SlcanReader()
        try:
            return reader.feed(os.read(self.master, 65536))
        except BlockingIOError:
            return []

    def close(self) -> None:
        os.close(self.slave)
        os.close(self.master)


@pytest.fixture
def adapter() -> Iterator[KernelAdapter]:
    adapter = KernelAdapter()
    yield adapter
    adapter.close()


@pytest.fixture
def port(adapter: KernelAdapter) -> Iterator[BusPort]:
    port = BusPort("socketcan", adapter.name)
    port.open()
    yield port
    port.close()


def received(port: BusPort) -> list[CanFrame]:
    port.wait(5.0)
    return port.receive()


def test_an_interface_gets_its_bit_rate_as_the_page_has_it() -> None:
    """S6 is 500 kbit/s, O opens the channel (LAWICEL CAN232 manual)."""
    adapter = KernelAdapter(up=False)
    command = BIT_RATE.replace("can0", adapter.name).split()
    assert BIT_RATE in (ROOT / "docs/drivers.md").read_text()
    with subprocess.Popen(command, stderr=subprocess.PIPE) as setting:
        said = b""
        while b"O\r" not in said:
            assert select.select([adapter.master], [], [], 10.0)[0], said
            said += os.read(adapter.master, 64)
        assert setting.wait(10.0) == 0, setting.communicate()[1]
    assert said.split(b"\r")[-3:] == [b"S6", b"O", b""]
    adapter.close()


def test_frames_cross_the_kernels_slcan_both_ways(adapter: KernelAdapter, port: BusPort) -> None:
    frames = [
        CanFrame(0x08D, b"\0\0\x80\x3f\0\0\0\0"),
        CanFrame(0x30A, bytes(4), True),
        CanFrame(0x89, b"", False, True, 8),
    ]
    for frame in frames:
        assert port.send([frame])
        assert adapter.hears() == [frame]
    for line, frame in zip((b"t08D80000803F00000000\r", b"T0000030A400000000\r", b"r0898\r"), frames, strict=True):
        adapter.says(line)
        assert received(port) == [frame]


@pytest.mark.parametrize(("line", "counter"), [(b"sw128096\r", "error_warning"), (b"sp096128\r", "error_passive")])
def test_error_states_of_the_controller_are_counted_by_name(
    adapter: KernelAdapter, port: BusPort, line: bytes, counter: str
) -> None:
    adapter.says(line)
    adapter.says(b"t0011FF\r")
    frames: list[CanFrame] = []
    while not frames:
        frames += received(port)
    assert frames == [CanFrame(1, b"\xff")]
    assert port.take_counters() == {"error_frame": 1, counter: 1}


@pytest.mark.parametrize("kind", KINDS)
def test_bus_off_is_a_lost_link_with_a_remedy(adapter: KernelAdapter, kind: str) -> None:
    bench = KernelBench(kind, adapter.name)
    bench.drive.inner.line.open_port()
    adapter.says(b"sb255255\r")
    select.select([bench.port.fileno()], [], [], 5.0)
    with pytest.raises(LinkLost, match=f"of {ROBOT} on {adapter.name}: cannot receive: bus-off") as caught:
        bench.drive.read(time.monotonic_ns())
    assert f"ip link set {adapter.name} down" in caught.value.remedy
    bench.close()


def test_a_queue_nobody_empties_drops_setpoints_and_never_waits(adapter: KernelAdapter, port: BusPort) -> None:
    sent = 0
    while port.send([CanFrame(0x08D, struct.pack("<ff", sent, 0.0))]):
        sent += 1
        assert sent < 100_000
    bus = port._bus
    assert bus is not None
    with pytest.raises(can.CanOperationError) as caught:
        bus.send(can.Message(arbitration_id=1), timeout=0.01)
    assert caught.value.error_code in (errno.ENOBUFS, None)
    assert not port.send([CanFrame(0x08D, bytes(8))])
