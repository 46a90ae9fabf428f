"""The CAN drivers on a real SocketCAN kernel: one boot of the guest, or this machine where it has vcan."""

import os
import re
import subprocess
import sys

import pytest

from tests.guest.guest import run_in_guest
from tests.house.checkout import ROOT

SUITE = "tests/guest/socketcan_suite.py"
ALONE = ["unshare", "--net"]
"""Interfaces of a network namespace that ends with its process."""


def has_vcan() -> bool:
    probe = "ip link add vcan0 type vcan && ip link add slcan9 type vcan"
    return subprocess.run([*ALONE, "sh", "-c", probe], capture_output=True, check=False).returncode == 0


@pytest.mark.timeout(900)
def test_the_can_drivers_on_a_real_kernel_bus() -> None:
    pytest_command = [sys.executable, "-B", "-m", "pytest", "-p", "no:cacheprovider", "-rs", "--timeout=60", SUITE]
    if has_vcan():
        done = subprocess.run(
            [*ALONE, *pytest_command],
            cwd=ROOT,
            env=os.environ,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        output = done.stdout + done.stderr
        assert done.returncode == 0, output
    else:
        output = run_in_guest(*pytest_command)
    summary = re.search(r"(\d+) passed(.*) in ", output)
    assert summary, output
    assert int(summary[1]) >= 24, output
    assert not summary[2], f"every test of {SUITE} runs and passes: {output}"
