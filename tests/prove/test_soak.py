"""Half an hour of missions with random faults in real time: no process grows, leaks, hangs or slows down.

In the first quarter processes are killed and started, too. Then those that are there live on, and are judged once each
of the other faults has happened three times, and the network has stood still as often as its router's heap takes to
settle: what the first freezes and full disks take, a process may keep for more.

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
KILLING, WARM = 0.25, 0.5
"""Of the time: processes are killed until then; what is not warm by then is judged all the same."""
ROUNDS = 3
"""Times that each fault happens before processes are judged."""
FREEZES = 20
"""Times more that the whole network stands still before. A router that was frozen ninety times, all clients coming anew
after each, grew from 39.9 to 41.1 MB in the first twenty, and no more in the others.
"""
PARTS = 8
"""Of a process's life, whose ends are shown."""
LONG = 0.4
"""Of the time: so long must every process have lived that is there at the end."""
SPARING = tuple(row for row in REAL_ROWS if "killed" not in row.name or row.where == "station")
"""Faults that no process dies of; the station is this one, and falls silent instead."""
(FROZEN,) = (row for row in SPARING if row.name == "radio: router and bridge frozen")


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


def grown(name: str, looks: list[Look], warm_s: float) -> list[str]:
    """What one process has too much of at the end, in words; what was before ``warm_s`` is warm-up."""
    settled = [entry for entry in looks if entry.at_s >= warm_s]
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
        shown = [entries[round(part * (len(entries) - 1) / PARTS)] for part in range(PARTS + 1)]
        memory = " ".join(f"{entry.rss_bytes / 1e6:5.1f}" for entry in shown)
        first, last = shown[0], shown[-1]
        print(
            f"{name:<12} {len(entries):>4} looks from {first.at_s:5.0f} s to {last.at_s:5.0f} s  {memory} MB  "
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
            number, warm_s = 0, 0.0
            warming = [row for _ in range(ROUNDS) for row in draw.sample(SPARING, len(SPARING))]
            warming += FREEZES * [FROZEN]
            while (share := (time.monotonic() - began) / (60 * MINUTES)) < 1.0:
                if share >= WARM:
                    warming.clear()
                sparing = share >= KILLING
                row = warming.pop() if sparing and warming else draw.choice(SPARING if sparing else REAL_ROWS)
                outcome = play(stage, row, number)
                number += 1
                if outcome.faults:
                    bad.append(f"{outcome.row} (repetition {outcome.seed}): {'; '.join(outcome.faults)}")
                    print(bad[-1], flush=True)
                at_s = time.monotonic() - began
                warm_s = at_s if warming else warm_s
                family = processes.family.children
                alive = {(child.name, child.pid) for child in family}
                alive |= {("router", pid) for child in family for pid in kin(child.pid)}
                for name, pid in alive:
                    looks.setdefault((name, pid), []).append(look(pid, at_s))
                timings = [entry.timing for entry in stage.reports.values() if entry.timing is not None]
                late_ms.append(max(timing.jitter_ms for timing in timings))
    report(looks)
    print(f"judged from {warm_s:.0f} s on", flush=True)
    third = len(late_ms) // 3
    early, late = statistics.median(late_ms[:third]), statistics.median(late_ms[-third:])
    print(f"{number} missions; jitter of the slowest loop, median: {early:.1f} ms, then {late:.1f} ms", flush=True)
    bad += [words for one, entries in looks.items() if one in alive for words in grown(one[0], entries, warm_s)]
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
