"""ROBOTIS' own SDK and ``rustypot``: they drive our emulated servos, and say the bytes our codec says."""

import contextlib
import os
import struct
import subprocess
import sys
import threading
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import dynamixel_sdk as sdk
import pytest
import rustypot

from drivers.mock.controller import Wheels
from drivers.mock.dynamixel import EmulatedDynamixel
from drivers.mock.motor import MotorLimits
from drivers.serial import dynamixel_codec as codec
from drivers.serial.dynamixel import Options


@pytest.fixture
def link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The SDK gives a reply some 30 ms; a busy machine needs more."""
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 2000)
    path = tmp_path / "servos"
    command = [sys.executable, "-m", "drivers", "emulate", "dynamixel", "--port-link", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield str(path)
        process.terminate()


def test_the_makers_sdk(link: str) -> None:
    port, peer = sdk.PortHandler(link), sdk.PacketHandler(2.0)
    assert port.openPort()
    assert port.setBaudRate(1_000_000)
    assert peer.ping(port, 1) == (1190, 0, 0)
    assert peer.write1ByteTxRx(port, 1, 11, 1) == (0, 0)
    assert peer.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
    assert peer.write1ByteTxRx(port, 1, 11, 3) == (0, 7), "EEPROM is locked while torque is on"
    assert peer.write4ByteTxRx(port, 1, 104, 200) == (0, 0)
    for _ in range(20000):
        speed = peer.read4ByteTxRx(port, 1, 128)
        if speed[0] >= 199:
            break
    assert speed[1:] == (0, 0)
    assert 199 <= speed[0] <= 201
    reader = sdk.GroupSyncRead(port, peer, 128, 8)
    assert reader.addParam(1)
    assert reader.addParam(2)
    assert reader.txRxPacket() == 0
    assert reader.getData(1, 128, 4) == pytest.approx(200, abs=1)
    assert reader.getData(1, 132, 4) > 0
    assert reader.getData(2, 128, 4) == 0
    assert reader.fastSyncRead() == 0
    assert reader.getData(1, 128, 4) == pytest.approx(200, abs=1)
    assert reader.getData(2, 128, 4) == 0
    fast = sdk.GroupBulkRead(port, peer)
    assert fast.addParam(1, 144, 2)
    assert fast.addParam(2, 146, 1)
    assert fast.fastBulkRead() == 0
    assert (fast.getData(1, 144, 2), fast.getData(2, 146, 1)) == (50, 30)
    assert peer.regWriteTxRx(port, 1, 65, 1, [1]) == (0, 0)
    assert (peer.read1ByteTxRx(port, 1, 65)[0], peer.read1ByteTxRx(port, 1, 69)[0]) == (0, 1)
    assert peer.action(port, 1) == 0
    port.setPacketTimeout(11)
    assert peer.rxPacket(port, False)[1] == 0, "the SDK leaves the answer to an action unread"
    assert peer.read1ByteTxRx(port, 1, 69) == (0, 0, 0)
    assert peer.read1ByteTxRx(port, 1, 65) == (1, 0, 0)
    assert peer.clearMultiTurn(port, 2) == (0, 0)
    bulk = sdk.GroupBulkRead(port, peer)
    assert bulk.addParam(1, 144, 2)
    assert bulk.addParam(2, 146, 1)
    assert bulk.txRxPacket() == 0
    assert (bulk.getData(1, 144, 2), bulk.getData(2, 146, 1)) == (50, 30)
    bulk_writer = sdk.GroupBulkWrite(port, peer)
    assert bulk_writer.addParam(1, 104, 4, list((100).to_bytes(4, "little")))
    assert bulk_writer.addParam(2, 64, 1, [1])
    assert bulk_writer.txPacket() == 0
    assert peer.read4ByteTxRx(port, 1, 104) == (100, 0, 0)
    assert peer.read1ByteTxRx(port, 2, 64) == (1, 0, 0)
    assert peer.write1ByteTxRx(port, 1, 64, 0) == (0, 0)
    assert peer.write1ByteTxRx(port, 1, 11, 4) == (0, 0)
    assert peer.factoryReset(port, 1, 0xFF) == (0, 0)
    assert peer.read1ByteTxRx(port, 1, 11) == (3, 0, 0), "position control, as new"
    assert peer.write1ByteTxRx(port, 1, 11, 1) == (0, 0)
    assert peer.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
    writer = sdk.GroupSyncWrite(port, peer, 104, 4)
    assert writer.addParam(1, list((-1 & 0xFFFFFFFF).to_bytes(4, "little")))
    assert writer.txPacket() == 0
    for _ in range(20000):
        speed = peer.read4ByteTxRx(port, 1, 128)[0]
        if speed == 0xFFFFFFFF:
            break
    assert speed == 0xFFFFFFFF
    replies = [peer.readTxRx(port, 1, 128, 8) for _ in range(300)]
    assert all(reply[1:] == (0, 0) and len(reply[0]) == 8 for reply in replies), "stuffed replies included"
    port.closePort()


def test_rustypot(link: str) -> None:
    peer = rustypot.Xl330PyController(link, 1_000_000, 0.5)
    assert peer.ping(1)
    for device in (1, 2):
        peer.write_operating_mode(device, 1)
        peer.write_torque_enable(device, True)
    peer.sync_write_goal_velocity([1, 2], [100, -50])
    for _ in range(20000):
        first, second = peer.sync_read_present_velocity([1, 2])
        if abs(first) > 99 and abs(second) > 49:
            break
    assert first == pytest.approx(100, abs=1)
    assert second == pytest.approx(-50, abs=1)
    assert len(peer.sync_read_present_position([1, 2])) == 2


class Memory:
    """A ``PortHandler`` of the SDK straight into emulated servos (or nowhere); no time passes."""

    def __init__(self, device: EmulatedDynamixel | None = None) -> None:
        self.is_using = False
        self.device = device
        self.sent = b""
        self.waiting = b""

    def clearPort(self) -> None:
        self.waiting = b""

    def writePort(self, packet: list[int]) -> int:
        self.sent = bytes(packet)
        if self.device is not None:
            self.waiting += self.device.receive(self.sent, 0)
        return len(packet)

    def readPort(self, length: int) -> list[int]:
        taken, self.waiting = self.waiting[:length], self.waiting[length:]
        return list(taken)

    def setPacketTimeout(self, length: int) -> None: ...

    def setPacketTimeoutMillis(self, milliseconds: float) -> None: ...

    def isPacketTimeout(self) -> bool:
        return not self.waiting


def test_the_makers_sdk_says_the_same_bytes() -> None:
    port, peer = Memory(), sdk.PacketHandler(2.0)
    peer.readTx(port, 7, 132, 4)
    assert port.sent == codec.read(7, 132, 4)
    port.is_using = False
    peer.write4ByteTxOnly(port, 1, 104, 0xFFFFFFFF)
    assert port.sent == codec.write(1, 104, b"\xff" * 4)
    port.is_using = False
    peer.syncReadTx(port, 128, 8, [1, 2], 2, False)
    assert port.sent == codec.sync_read((1, 2), 128, 8)
    port.is_using = False
    values = [(1, struct.pack("<i", -417)), (2, struct.pack("<i", 1000))]
    parameters = [byte for device, data in values for byte in (device, *data)]
    peer.syncWriteTxOnly(port, 104, 4, parameters, len(parameters))
    assert port.sent == codec.sync_write(104, 4, values)


@pytest.mark.parametrize("position", [0xFD, 0x1FD, -3, 0xFDFD])
def test_a_stuffed_reply_is_read_alike_by_the_makers_sdk_and_by_us(position: int) -> None:
    """Speed -1 in front of a position that ends in FD: FF FF FF FF FD on the wire gets one more FD."""
    options = Options(kind="dynamixel", port="x", left=1, right=2)
    device = EmulatedDynamixel(options, Wheels.of(MotorLimits()))
    first = device.servos[0]
    first.refresh = lambda: first.table.__setitem__(slice(128, 136), struct.pack("<ii", -1, position))  # type: ignore[method-assign]
    raw = device.receive(codec.read(1, 128, 8), 0)
    assert (b"\xff\xff\xfd\xfd" in raw[8:]) is (position & 0xFF == 0xFD)
    (status,) = codec.PacketReader().feed(raw)
    data, result, error = sdk.PacketHandler(2.0).readTxRx(Memory(device), 1, 128, 8)
    assert (result, error) == (0, 0)
    assert bytes(data) == status[2] == struct.pack("<ii", -1, position)


def said_by_rustypot(speak: Callable[[rustypot.Xl330PyController], object]) -> bytes:
    """The bytes it writes to a line on which nobody answers."""
    ours, theirs = os.openpty()
    try:
        tty.setraw(theirs)
        peer = rustypot.Xl330PyController(os.ttyname(theirs), 1_000_000, 0.02)

        def run() -> None:
            with contextlib.suppress(RuntimeError, OSError, ValueError):
                speak(peer)

        thread = threading.Thread(target=run)
        thread.start()
        data = os.read(ours, 256)
        thread.join()
        return data
    finally:
        os.close(ours)
        os.close(theirs)


def test_rustypot_says_the_same_bytes() -> None:
    assert said_by_rustypot(lambda peer: peer.sync_read_present_velocity([1, 2])) == codec.sync_read((1, 2), 128, 4)
    goals = [(1, struct.pack("<i", -1)), (2, struct.pack("<i", 253))]
    assert said_by_rustypot(lambda peer: peer.sync_write_goal_velocity([1, 2], [-1, 253])) == codec.sync_write(
        104, 4, goals
    )
