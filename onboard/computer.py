"""What a robot's computer is set to, read from the kernel's files: one snapshot, nothing changed."""

import gc
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path
from typing import NamedTuple

UNLIMITED = -1


class Snapshot(NamedTuple):
    """Values as found; None or empty where the machine has no such thing."""

    governors: dict[str, str]
    """Core to frequency governor."""
    clock_source: str
    clock_sources: tuple[str, ...]
    power_save: dict[str, bool]
    """Wireless interface to whether it sleeps between packets."""
    latency_ms: dict[str, int]
    """FTDI port to its latency timer."""
    can_queue: dict[str, int]
    """CAN interface to its transmit queue length."""
    chrony: str
    """chrony's leap status; empty: it does not run."""
    chrony_offset_s: float | None
    locked_kb: int
    """Memory this process may lock, ``UNLIMITED`` for all."""
    niceness: int
    """Lowest that this process may take."""
    realtime: int
    """Highest real-time priority that this process may take."""
    cores: int
    allowed_cores: int
    swap_kb: int
    throttled: str
    """A Raspberry Pi's word on under-voltage and heat, as hexadecimal; empty on other machines."""
    python: str
    optimised: bool
    """The interpreter was built with profile-guided optimisation."""
    collection_ms: tuple[float, float]
    """What a full garbage collection takes here, and what it takes once the objects of the start are frozen."""


def snapshot(root: Path = Path("/")) -> Snapshot:
    """This computer, or a tree of files that looks like one.

    Limits, cores and interpreter are always this process's own.
    """
    import resource

    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    nice = resource.getrlimit(resource.RLIMIT_NICE)[0]
    sources = root / "sys/devices/system/clocksource/clocksource0"
    leap, offset_s = chrony(root)
    return Snapshot(
        governors={
            path.parents[1].name: text(path)
            for path in sorted((root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
        },
        clock_source=text(sources / "current_clocksource"),
        clock_sources=tuple(text(sources / "available_clocksource").split()),
        power_save=wireless(root),
        latency_ms={
            path.parent.name: number(path)
            for path in sorted((root / "sys/bus/usb-serial/devices").glob("*/latency_timer"))
        },
        can_queue={
            path.parent.name: number(path)
            for path in sorted((root / "sys/class/net").glob("*/tx_queue_len"))
            if number(path.parent / "type") == 280
        },
        chrony=leap,
        chrony_offset_s=offset_s,
        locked_kb=UNLIMITED if locked == resource.RLIM_INFINITY else locked // 1024,
        niceness=-20 if os.geteuid() == 0 or nice == resource.RLIM_INFINITY else 20 - max(nice, 20),
        realtime=99 if os.geteuid() == 0 else resource.getrlimit(resource.RLIMIT_RTPRIO)[0],
        cores=os.cpu_count() or 1,
        allowed_cores=len(os.sched_getaffinity(0)),
        swap_kb=sum(
            int(size) for size in re.findall(r"^/\S+\s+\w+\s+(\d+)\s", text(root / "proc/swaps"), re.MULTILINE)
        ),
        throttled=text(root / "sys/devices/platform/soc/soc:firmware/get_throttled"),
        python=platform.python_version(),
        optimised="--enable-optimizations" in (sysconfig.get_config_var("CONFIG_ARGS") or "")
        or sys.platform != "linux",
        collection_ms=collections_ms(),
    )


def collections_ms() -> tuple[float, float]:
    """A full collection of this process's objects, as they are and frozen as `onboard.service.quiet` does."""
    gc.collect()
    began_ns = time.perf_counter_ns()
    gc.collect()
    all_ns = time.perf_counter_ns() - began_ns
    gc.freeze()
    began_ns = time.perf_counter_ns()
    gc.collect()
    frozen_ns = time.perf_counter_ns() - began_ns
    gc.unfreeze()
    return round(all_ns * 1e-6, 3), round(frozen_ns * 1e-6, 3)


def text(path: Path) -> str:
    """Content of a file of one line or a few, empty where it cannot be read."""
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""


def number(path: Path) -> int:
    """Content of a file as a number, 0 where it is none."""
    words = text(path)
    return int(words) if words.isdecimal() else 0


def wireless(root: Path) -> dict[str, bool]:
    """Wireless interfaces and whether power saving is on, as ``iw`` says; on this computer only."""
    names = sorted(path.parent.name for path in (root / "sys/class/net").glob("*/wireless"))
    return {name: "Power save: on" in said("iw", "dev", name, "get", "power_save") for name in names}


def chrony(root: Path) -> tuple[str, float | None]:
    """chrony's leap status and the system clock's offset; a saved ``chronyc -n tracking`` in a tree of files."""
    saved = root / "chronyc-tracking"
    words = text(saved) if root != Path("/") else said("chronyc", "-n", "tracking")
    leap = re.search(r"^Leap status\s*: (.+)$", words, re.MULTILINE)
    offset = re.search(r"^System time\s*: ([0-9.]+) seconds (slow|fast)", words, re.MULTILINE)
    off_s = float(offset[1]) * (-1 if offset[2] == "slow" else 1) if offset else None
    return (leap[1].strip() if leap else ""), off_s


def said(*command: str) -> str:
    """What a command prints; empty where it is missing, slow or fails."""
    if not shutil.which(command[0]):
        return ""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=5, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""
