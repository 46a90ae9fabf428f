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
