"""Settings of the whole machine that a measurement turns to and fro: what this one has, held for a moment, put back."""

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from onboard.computer import said, text

FAST = "performance"
SLOW = ("powersave", "schedutil", "ondemand", "conservative")
PINGS, PING_EVERY_S = 15, 0.2
"""Power saving lets an interface sleep between two of these."""


@contextlib.contextmanager
def held(files: Sequence[Path], value: str) -> Iterator[None]:
    """The files say ``value`` inside the block and what they said before after it, whatever ends it.

    :raises OSError: one may not be written; those before it are put back.
    """
    before: list[tuple[Path, str]] = []
    try:
        for file in files:
            was = file.read_text()
            file.write_text(value)
            before.append((file, was))
        yield
    finally:
        for file, was in before:
            file.write_text(was)


def governors(root: Path) -> tuple[list[Path], list[str]]:
    """Every core's governor file, and the two governors to compare: the fast one, and a slow one that there is."""
    files = sorted((root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    there = text(files[0].with_name("scaling_available_governors")).split() if files else []
    slow = next((name for name in SLOW if name in there), "")
    return files, [name for name in (slow, FAST) if name in there]


def wireless_gateway(ask: Callable[..., str] = said) -> tuple[str, str]:
    """A wireless interface and the address that it reaches the network by; empty where there is none."""
    for name in re.findall(r"^\s*Interface (\S+)", ask("iw", "dev"), re.MULTILINE):
        route = re.search(r"^default via (\S+)", ask("ip", "route", "show", "dev", name), re.MULTILINE)
        if route:
            return name, route[1]
    return "", ""


def round_trips_us(interface: str, address: str, save: str, ask: Callable[..., str] = said) -> list[float]:
    """Round trips to an address with the interface's power saving ``on`` or ``off``, microseconds; put back after."""
    before = "on" if "save: on" in ask("iw", "dev", interface, "get", "power_save") else "off"
    ask("iw", "dev", interface, "set", "power_save", save)
    try:
        heard = ask("ping", "-n", "-I", interface, f"-c{PINGS}", f"-i{PING_EVERY_S}", address)
    finally:
        ask("iw", "dev", interface, "set", "power_save", before)
    return [float(number) * 1e3 for number in re.findall(r"time=([0-9.]+) ms", heard)]


def without_lateness(root: Path) -> dict[str, str]:
    """The settings that ``doctor`` checks and that no loop's lateness can show, and where they do show."""
    adapters = [*(root / "sys/bus/usb-serial/devices").glob("*/latency_timer")]
    buses = [path for path in (root / "sys/class/net").glob("*/type") if text(path) == "280"]
    return {
        "FTDI latency timer": (
            "every answer of the controller is later by up to that many ms; the loop does not wait for it"
            if adapters
            else "no FTDI adapter is plugged in"
        ),
        "CAN transmit queue": (
            "a short one loses frames and delays none; the driver counts them" if buses else "there is no CAN interface"
        ),
        "chrony": "moves the clock of the day; the loop runs on the monotonic one",
    }
