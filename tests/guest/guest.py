"""Runs a command in a throw-away Linux guest that has a real SocketCAN kernel; needs root."""

import subprocess
from pathlib import Path

from tests.house.checkout import ROOT

SCRIPT = Path(__file__).with_name("run-in-guest.sh")
GUEST_FAILED = 125


def run_in_guest(*command: str, limit_s: int = 120) -> str:
    """Output (both streams) of a command run as root in the checkout inside the guest.

    The quick user-mode guest first; the emulated PC where that one cannot boot. AssertionError with the output when
    the command fails or takes longer than ``limit_s`` (boot included).
    """
    for backend in ("uml", "qemu"):
        done = subprocess.run(
            [str(SCRIPT), "-b", backend, "-t", str(limit_s), str(ROOT), *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            timeout=limit_s + 600,
            check=False,
        )
        if done.returncode != GUEST_FAILED:
            break
        print(f"the {backend} guest did not boot:\n{done.stdout}")
    what = f"{' '.join(command)} ended with {done.returncode} in the {backend} guest"
    assert done.returncode == 0, f"{what}:\n{done.stdout}"
    return done.stdout
