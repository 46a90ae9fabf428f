"""What a robot's computer is, as its probe says, and whether a release fits it. Pure."""

from collections.abc import Iterator
from typing import NamedTuple

from contract.checks import CheckResult, Verdict

MACHINES = ("x86_64", "aarch64")
OLDEST_GLIBC = (2, 17)
OLDEST_SYSTEMD = 247
ROOM_MB = 600
"""An environment takes about 150 MB, and there are two at times."""
CLOCK_WARN_S, CLOCK_FAIL_S = 0.1, 60.0


class Facts(NamedTuple):
    """One computer."""

    root: bool
    machine: str
    glibc: tuple[int, ...]
    """Empty: not a glibc system."""
    python: str
    """Path of a fitting interpreter; empty: there is none."""
    version: str
    systemd: int
    booted: bool
    """systemd is the system's manager, not only installed."""
    rsync: bool
    disk_mb: int
    current: str
    """Release that is switched on; empty: none."""
    previous: str
    leap: str
    """chrony's word on the clock, empty where chrony does not run."""
    ahead_s: float
    """Clock of the robot minus clock of the station, nearest to zero that the probe's way allows."""
    doubt_s: float
    """Half of the time that the probe was on its way."""

    @property
    def minor(self) -> str:
        """``3.11`` of ``3.11.2``."""
        return ".".join(self.version.split(".")[:2])


def read(text: str, sent_s: float, back_s: float) -> Facts:
    """Facts from a probe's ``name=value`` lines; what is missing or not a number counts as absent.

    :param sent_s: station's clock before the probe.
    :param back_s: and after it.
    """
    said = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)

    def number(name: str) -> float:
        try:
            return float(said.get(name, ""))
        except ValueError:
            return 0.0

    clock_s = number("clock")
    parts = said.get("glibc", "").split(".")
    return Facts(
        root=said.get("user") == "0",
        machine=said.get("machine", ""),
        glibc=tuple(map(int, parts)) if all(part.isdigit() for part in parts) else (),
        python=said.get("python", ""),
        version=said.get("version", ""),
        systemd=int(number("systemd")),
        booted=said.get("booted") == "yes",
        rsync=bool(said.get("rsync")),
        disk_mb=int(number("disk_mb")),
        current=said.get("current", ""),
        previous=said.get("previous", ""),
        leap=said.get("leap", ""),
        ahead_s=max(0.0, clock_s - back_s) + min(0.0, clock_s - sent_s),
        doubt_s=max(0.0, back_s - sent_s) / 2,
    )


def preflight(facts: Facts, robot: str) -> list[CheckResult]:
    """Every check of one computer; one that fails forbids the deployment."""

    def check(name: str, verdict: Verdict, seen: str, remedy: str = "") -> CheckResult:
        return CheckResult(
            name=name, verdict=verdict, seen=seen, remedy="" if verdict == "pass" else remedy, subject=robot
        )

    def rows() -> Iterator[CheckResult]:
        yield check("root", *good(facts.root), "root" if facts.root else "an ordinary user", "log in as root, or allow "
                    "deploy.user to use sudo without a password")  # fmt: skip
        fits = facts.machine in MACHINES
        yield check(
            "machine", *good(fits), facts.machine or "unknown", f"there are wheels for {' and '.join(MACHINES)} alone"
        )
        glibc = ".".join(map(str, facts.glibc))
        yield check(
            "glibc", *good(facts.glibc >= OLDEST_GLIBC), glibc or "none", "use a system with glibc 2.17 or newer"
        )
        yield check("python", *good(bool(facts.python)), f"{facts.version} {facts.python}".strip() or "none that fits",
                    "install Python 3.11 to 3.13: apt-get install python3")  # fmt: skip
        managed = facts.booted and facts.systemd >= OLDEST_SYSTEMD
        seen = f"{facts.systemd}" if facts.booted else "not the system's manager"
        yield check("systemd", *good(managed), seen, f"use a system that boots systemd {OLDEST_SYSTEMD} or newer")
        yield check("rsync", *good(facts.rsync), "there" if facts.rsync else "missing", "apt-get install rsync")
        yield check(
            "disk", *good(facts.disk_mb >= ROOM_MB), f"{facts.disk_mb} MB free", f"make room: {ROOM_MB} MB are needed"
        )
        off_s = abs(facts.ahead_s)
        verdict: Verdict = "fail" if off_s > CLOCK_FAIL_S else "warn" if off_s > CLOCK_WARN_S else "pass"
        words = f"{facts.ahead_s:+.2f} s, known to {facts.doubt_s:.2f} s"
        yield check("clock", verdict, words, "install chrony and let it follow the station's clock")

    return list(rows())


def good(fine: bool) -> tuple[Verdict]:
    """``pass`` or ``fail``."""
    return ("pass" if fine else "fail",)
