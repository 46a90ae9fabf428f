"""Half an hour of missions with random faults in real time: no process grows, leaks, hangs or slows down.

In the first half processes are killed and started, too. In the second those that are there live on, and are judged: a
process that ends within minutes is still warming up.

``AHDC_SOAK_MINUTES`` sets another length, ``AHDC_SOAK_ROBOTS`` another swarm.
"""

import contextlib
import os
import random
import statistics
import time
from pathlib import Path
from typing import NamedTuple

import pytest

from groundstation import rig
from groundstation.faultreal import REAL_ROWS, play
from groundstation.faultrig import Stage, unreadable
from groundstation.link import Link
from groundstation.processes import kin

MINUTES = float(os.environ.get("AHDC_SOAK_MINUTES", "30"))
ROBOTS = int(os.environ.get("AHDC_SOAK_ROBOTS", "3"))
GROWTH = 1.02
SPARE_BYTES = 512 << 10
"""Of memory that an allocator takes at once."""
SLOWER = 2.0
SLOWER_MS = 5.0
ENOUGH = 8
"""Looks at one process, at the least, before it is judged."""
LONG = 0.4
"""Of the time: so long must every process have lived that is there at the end."""
SPARING = tuple(row for row in REAL_ROWS if "killed" not in row.name or row.where == "station")
"""Faults that no process dies of; the station is this one, and falls silent instead."""


class Look(NamedTuple):
    """One process at one moment."""

    at_s: float
    rss_bytes: int
    fds: int
    threads: int


def look(pid: int, at_s: float) -> Look:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    fds = len(os.listdir(f"/proc/{pid}/fd"))
    return Look(at_s, pages * os.sysconf("SC_PAGE_SIZE"), fds, len(os.listdir(f"/proc/{pid}/task")))


def grown(name: str, looks: list[Look]) -> list[str]:
    """What one process has too much of at the end, in words; its first third is warm-up."""
    settled = looks[len(looks) // 3 :]
    if len(settled) < ENOUGH:
        return []
    early, late = settled[: len(settled) // 3], settled[-(len(settled) // 3) :]
    found = []
    before, after = (statistics.median(entry.rss_bytes for entry in part) for part in (early, late))
    if after > max(GROWTH * before, before + SPARE_BYTES):
        found.append(f"{name}: {before / 1e6:.1f} MB grew to {after / 1e6:.1f} MB")
    for what in ("fds", "threads"):
        least, most = (pick(getattr(entry, what) for entry in part) for pick, part in ((max, early), (min, late)))
        if most > least:
            found.append(f"{name}: {least} {what} grew to {most}")
    return found


def left_behind(*marks: str) -> list[str]:
    """Command lines of processes, whosever children, that have one of these in it."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            found.append(file.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [words for words in found if any(mark in words for mark in marks)]


def ptys() -> int:
    return int(Path("/proc/sys/kernel/pty/nr").read_text())


def report(looks: dict[tuple[str, int], list[Look]]) -> None:
    for (name, _), entries in sorted(looks.items()):
        first, last = entries[len(entries) // 3], entries[-1]
        print(
            f"{name:<12} {len(entries):>4} looks  {first.rss_bytes / 1e6:6.1f} -> {last.rss_bytes / 1e6:6.1f} MB  "
            f"{first.fds:>3} -> {last.fds:>3} fds  {first.threads:>3} -> {last.threads:>3} threads",
            flush=True,
        )


@pytest.mark.timeout(0)
def test_missions_with_random_faults_one_after_another(tmp_path: Path) -> None:
    before, ptys_before = set(kin(os.getpid())), ptys()
    seed = random.SystemRandom().randrange(1 << 30)
    draw = random.Random(seed)
    print(f"\nseed {seed}, {MINUTES:g} minutes, {ROBOTS} robots", flush=True)
    out = tmp_path / "run"
    arena = rig.mock_arena(rig.find_arena("experiment2"), out, rig.Changes(ROBOTS, 60, seed))
    looks: dict[tuple[str, int], list[Look]] = {}
    late_ms: list[float] = []
    bad = []
    with rig.Rig(arena, out) as processes:
        processes.start()
        with Link(arena, "station") as link:
            stage = Stage(processes, link)
            began = time.monotonic()
            number = 0
            while time.monotonic() - began < 60 * MINUTES:
                rows = REAL_ROWS if time.monotonic() - began < 30 * MINUTES else SPARING
                outcome = play(stage, draw.choice(rows), number)
                number += 1
                if outcome.faults:
                    bad.append(f"{outcome.row} (repetition {outcome.seed}): {'; '.join(outcome.faults)}")
                    print(bad[-1], flush=True)
                at_s = time.monotonic() - began
                family = processes.family.children
                alive = {(child.name, child.pid) for child in family}
                alive |= {("router", pid) for child in family for pid in kin(child.pid)}
                for name, pid in alive:
                    looks.setdefault((name, pid), []).append(look(pid, at_s))
                timings = [entry.timing for entry in stage.reports.values() if entry.timing is not None]
                late_ms.append(max(timing.jitter_ms for timing in timings))
    report(looks)
    third = len(late_ms) // 3
    early, late = statistics.median(late_ms[:third]), statistics.median(late_ms[-third:])
    print(f"{number} missions; jitter of the slowest loop, median: {early:.1f} ms, then {late:.1f} ms", flush=True)
    bad += [words for one, entries in looks.items() if one in alive for words in grown(one[0], entries)]
    bad += [f"{name}: looked at {len(looks[name, pid])} times" for name, pid in alive if len(looks[name, pid]) < ENOUGH]
    for name, pid in alive:
        lived_s = looks[name, pid][-1].at_s - looks[name, pid][0].at_s
        if lived_s < 60 * MINUTES * LONG:
            bad.append(f"{name}: lived for {lived_s:.0f} s only, too short to be judged")
    bad += unreadable(out)
    if late > SLOWER * early + SLOWER_MS:
        bad.append(f"loops became late: {early:.1f} ms, then {late:.1f} ms")
    if left := set(kin(os.getpid())) - before:
        bad.append(f"processes left behind: {left}")
    bad += [f"left behind: {words}" for words in left_behind(arena.link.router, str(out))]
    if ptys() > ptys_before:
        bad.append(f"{ptys() - ptys_before} pty(s) left behind")
    assert not bad, "\n".join(bad)
