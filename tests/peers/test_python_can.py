"""Plain python-can, in a process of its own, on our emulated bus; none of our code on its side."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import json, struct, sys, can
bus = can.Bus(interface="slcan", channel=sys.argv[1], bitrate=250000, sleep_after_open=0, timeout=0.05)
def send(can_id, data, **kind):
    bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **kind))
seen, volts, beats, speed = {}, None, set(), 0.0
send(0x0B, struct.pack("<II", 2, 1))
send(0x18, bytes(8))
send(0x07, struct.pack("<II", 8, 0))
send(0x17, b"", is_remote_frame=True, dlc=8)
for turn in range(4000):
    if turn % 4 == 0:
        send(0x0D, struct.pack("<ff", 1.5, 0.0))
    message = bus.recv(0.05)
    if message is None:
        continue
    name = hex(message.arbitration_id)
    seen[name] = seen.get(name, 0) + 1
    assert message.dlc == 8 and not message.is_extended_id and not message.is_error_frame
    if message.arbitration_id == 0x01:
        beats.add(message.data[4])
    if message.arbitration_id == 0x17 and not message.is_remote_frame:
        volts = struct.unpack("<ff", message.data)[0]
    if message.arbitration_id == 0x09:
        speed = struct.unpack("<ff", message.data)[1]
    if volts and abs(speed - 1.5) < 0.01 and 8 in beats:
        break
bus.shutdown()
print(json.dumps({"seen": seen, "volts": volts, "beats": sorted(beats), "speed": speed}))
"""


@pytest.mark.parametrize("dialect", ["0.5", "0.6"])
def test_a_foreign_program_sees_valid_frames_and_drives(tmp_path: Path, dialect: str) -> None:
    link = tmp_path / "can"
    command = [sys.executable, "-m", "drivers", "emulate", "odrive", "--dialect", dialect, "--port-link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        peer = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(link)], capture_output=True, text=True, timeout=60, cwd=tmp_path
        )
        process.terminate()
    assert peer.returncode == 0, peer.stderr
    result = json.loads(peer.stdout)
    assert set(result["seen"]) >= {"0x1", "0x9", "0x17", "0x21", "0x29"}, "both axes, all messages"
    assert result["volts"] == 24.0
    assert 8 in result["beats"]
    assert result["speed"] == pytest.approx(1.5, abs=0.01)
