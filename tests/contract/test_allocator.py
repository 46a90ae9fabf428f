"""However many threads allocate, a process that shares its arenas has two heaps."""

import subprocess
import sys

import pytest

HEAPS = """
import sys, threading
from pathlib import Path
from contract.allocator import share_arenas

if sys.argv[1] == "shared":
    share_arenas()
kept, together = [], threading.Barrier(6)

def allocate() -> None:
    together.wait()
    kept.append([bytes(5000) for _ in range(400)])
    together.wait()

threads = [threading.Thread(target=allocate) for _ in range(6)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
starts = [int(line.split("-")[0], 16) for line in Path("/proc/self/maps").read_text().splitlines() if "rw-p" in line]
print(sum(start % (64 << 20) == 0 for start in starts))
"""


@pytest.mark.parametrize(("how", "heaps"), [("shared", {1}), ("apart", {4, 5, 6})])
def test_threads_share_one_heap_beside_the_main_threads(how: str, heaps: set[int]) -> None:
    done = subprocess.run([sys.executable, "-c", HEAPS, how], capture_output=True, text=True, check=True, timeout=60)
    assert int(done.stdout) in heaps


BURST = """
import sys
from pathlib import Path
from contract.allocator import give_back

def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

before = resident_mb()
burst, kept = [], []
for number in range(20_000):
    burst.append(bytes(1_000))
    if number % 100 == 99:
        kept.append(bytes(1_000))
del burst
if sys.argv[1] == "given":
    give_back()
print(resident_mb() - before)
"""


def test_after_a_burst_memory_is_given_back_though_something_stays() -> None:
    left = {}
    for how in ("given", "kept"):
        done = subprocess.run(
            [sys.executable, "-c", BURST, how], capture_output=True, text=True, check=True, timeout=60
        )
        left[how] = float(done.stdout)
    assert left["given"] < 3.0
    assert left["kept"] > 10.0, "glibc alone keeps it: else this test says nothing"
