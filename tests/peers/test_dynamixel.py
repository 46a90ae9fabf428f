"""ROBOTIS' own SDK and ``rustypot`` drive our emulated servos through a pty."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import dynamixel_sdk as sdk
import pytest
import rustypot


@pytest.fixture
def link(tmp_path: Path) -> Iterator[str]:
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
