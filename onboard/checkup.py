"""What of a robot's computer makes its loop late, each with the line that mends it. Pure."""

from collections.abc import Callable, Iterator

from contract.checks import CheckResult, Verdict
from onboard.computer import UNLIMITED, Snapshot

LATENCY_MS = 2
CAN_QUEUE = 64
CLOCK_OFFSET_S = 0.005
LOCK_KB = 256 * 1024
COLLECTION_MS = 1.0
"""A tenth of a control period."""
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies", "pit")


def checkup(now: Snapshot) -> list[CheckResult]:
    """Every check of one computer."""
    return [result for check in CHECKS for result in check(now)]


def findings(results: list[CheckResult]) -> list[str]:
    """A line for the journal of each check that is not passed, or one that all are."""
    bad = [result for result in results if result.verdict != "pass"]
    lines = [f"self-check: {f'{r.name} {r.subject}'.strip()}: {r.seen} -> {r.remedy}" for r in bad]
    return lines or [f"self-check: all {len(results)} checks of this computer passed"]


def _said(name: str, fine: bool, seen: str, remedy: str = "", subject: str = "", bad: Verdict = "warn") -> CheckResult:
    verdict: Verdict = "pass" if fine else bad
    return CheckResult(name=name, verdict=verdict, seen=seen, remedy="" if fine else remedy, subject=subject)


def _governor(now: Snapshot) -> Iterator[CheckResult]:
    slow = sorted(core for core, governor in now.governors.items() if governor != "performance")
    seen = ", ".join(sorted(set(now.governors.values()))) or "the kernel sets no frequency here"
    remedy = (
        "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor; for good: "
        "apt-get install cpufrequtils, GOVERNOR=performance in /etc/default/cpufrequtils"
    )
    yield _said("CPU governor", not slow, f"{seen} on {', '.join(slow)}" if slow else seen, remedy)


def _clock_source(now: Snapshot) -> Iterator[CheckResult]:
    slow = now.clock_source in SLOW_CLOCKS
    better = [name for name in now.clock_sources if name not in SLOW_CLOCKS]
    remedy = (
        f"echo {better[0]} | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource; for good: "
        f"clocksource={better[0]} on the kernel's command line"
        if better
        else "every reading of the clock costs microseconds: look for another kernel or firmware setting"
    )
    yield _said("clock source", not slow, now.clock_source or "unknown", remedy)


def _power_save(now: Snapshot) -> Iterator[CheckResult]:
    for name, on in now.power_save.items():
        remedy = (
            f"sudo iw dev {name} set power_save off; for good: the udev rule that `ahdc-groundstation deploy` brings"
        )
        yield _said("Wi-Fi power save", not on, "on: packets wait up to 100 ms" if on else "off", remedy, name)


def _latency_timer(now: Snapshot) -> Iterator[CheckResult]:
    for port, latency_ms in now.latency_ms.items():
        remedy = (
            f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{port}/latency_timer; for good: the udev rule that "
            "`ahdc-groundstation deploy` brings"
        )
        yield _said("FTDI latency timer", latency_ms <= LATENCY_MS, f"{latency_ms} ms", remedy, port)


def _can_queue(now: Snapshot) -> Iterator[CheckResult]:
    for name, length in now.can_queue.items():
        remedy = f"sudo ip link set {name} txqueuelen 128: a full queue refuses writes (ENOBUFS)"
        yield _said("CAN transmit queue", length >= CAN_QUEUE, f"{length} frames", remedy, name)


def _chrony(now: Snapshot) -> Iterator[CheckResult]:
    remedy = "apt-get install chrony; in /etc/chrony/chrony.conf: server STATION iburst minpoll 0 maxpoll 4"
    follows = now.chrony == "Normal"
    seen = now.chrony or "chrony does not run"
    if follows and now.chrony_offset_s is not None and abs(now.chrony_offset_s) > CLOCK_OFFSET_S:
        seen, follows = f"{now.chrony_offset_s * 1e3:+.1f} ms off", False
        remedy = "wait for chrony to settle (chronyc waitsync 10 0.005), or look at the network: chronyc sourcestats"
    yield _said("chrony", follows, seen, remedy)


def _memory(now: Snapshot) -> Iterator[CheckResult]:
    enough = now.locked_kb == UNLIMITED or now.locked_kb >= LOCK_KB
    seen = "all of it may be locked" if now.locked_kb == UNLIMITED else f"{now.locked_kb} kB may be locked"
    remedy = (
        "LimitMEMLOCK=infinity in the unit (deploy writes it), or `- memlock unlimited` in /etc/security/limits.conf"
    )
    yield _said("memory locking", enough, seen, remedy)
    yield _said(
        "swap", now.swap_kb == 0, f"{now.swap_kb} kB", "sudo swapoff -a; for good: take swap out of /etc/fstab, or "
        "apt-get remove dphys-swapfile"
    )  # fmt: skip


def _limits(now: Snapshot) -> Iterator[CheckResult]:
    remedy = "Nice=-10 in the unit (deploy writes it), or `- nice -10` in /etc/security/limits.conf"
    yield _said("priority", now.niceness <= -10, f"down to {now.niceness}", remedy)
    words = f"{now.allowed_cores} of {now.cores} cores"
    yield _said("cores", now.cores >= 2, words, "one core serves network, bus and law in turn: expect jitter")


def _power(now: Snapshot) -> Iterator[CheckResult]:
    if now.throttled:
        fine = now.throttled in ("0", "0x0")
        remedy = "the board is too hot or its supply too weak (vcgencmd get_throttled): a better supply or a heat sink"
        yield _said("throttling", fine, "never" if fine else f"flags {now.throttled}", remedy)


def _python(now: Snapshot) -> Iterator[CheckResult]:
    seen = f"{now.python}, {'optimised' if now.optimised else 'not optimised'}"
    remedy = "use a Python built with --enable-optimizations, such as Debian's: it is about a fifth faster"
    yield _said("Python build", now.optimised, seen, remedy)


def _garbage(now: Snapshot) -> Iterator[CheckResult]:
    every_ms, frozen_ms = now.collection_ms
    seen = f"a full collection takes {every_ms:g} ms, {frozen_ms:g} ms with the start's objects frozen, as `run` does"
    remedy = "the computer is too slow or too busy for a loop of 10 ms: see what else runs (top), then measure --jitter"
    yield _said("garbage collector", frozen_ms <= COLLECTION_MS, seen, remedy)


CHECKS: tuple[Callable[[Snapshot], Iterator[CheckResult]], ...] = (
    _governor,
    _clock_source,
    _power_save,
    _latency_timer,
    _can_queue,
    _chrony,
    _memory,
    _limits,
    _power,
    _python,
    _garbage,
)
