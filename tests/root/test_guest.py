"""The guest boots and its SocketCAN is real: frames cross vcan between two sockets of python-can."""

import sys

import pytest

from tests.guest.guest import run_in_guest

TALK = """
import can
with can.Bus("vcan0", interface="socketcan") as a, can.Bus("vcan0", interface="socketcan") as b:
    a.send(can.Message(arbitration_id=0x0C7, data=bytes.fromhex("0000803f"), is_extended_id=False))
    print("heard", b.recv(timeout=10.0))
"""


@pytest.mark.timeout(900)
def test_frames_cross_a_real_can_interface() -> None:
    script = 'ip link add vcan0 type vcan && ip link set vcan0 up && ip -br link show vcan0 && exec "$@"'
    output = run_in_guest("bash", "-ec", script, "bash", sys.executable, "-c", TALK)
    assert "UP" in output
    assert "heard" in output
    assert "0c7" in output
    assert "00 00 80 3f" in output
