"""The progress line: when it is shown, and what it says."""

import io

from groundstation.progress import Progress
from groundstation.result import Result


def result(completed: bool = True, split: int = 0) -> Result:
    return Result(
        seed=1, robots=2, targets=3, completed=completed, occupied=3, mission_s=9.0, disconnected_steps=split,
        collisions=0, min_distance_m=0.2, lower_bound_s=3.0, ratio_to_lower_bound=3.0, run_steps=900,
        ending="completed" if completed else "time up",
    )  # fmt: skip


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_elsewhere_a_line_every_two_seconds_and_one_at_the_end() -> None:
    stream = io.StringIO()
    progress = Progress(4, stream, 100.0)
    for k in range(4):
        progress.count(result(completed=k != 1))
        progress.show(100.0 + 0.9 * k)
    progress.show(103.0, last=True)
    lines = stream.getvalue().splitlines()
    assert len(lines) == 2
    assert lines[0] == "[########################] 4/4 runs, 1 failed, 3 s, 0 s left"
    assert lines[-1] == "[########################] 4/4 runs, 1 failed, 3 s, 0 s left"


def test_a_terminal_sees_one_line_that_changes() -> None:
    stream = Terminal()
    progress = Progress(2, stream, 0.0)
    progress.show(0.0)
    progress.show(0.1)
    progress.count(result(split=7))
    progress.show(0.5)
    progress.show(1.0, last=True)
    text = stream.getvalue()
    assert text.count("\r") == 3
    assert text.count("\n") == 1
    assert "0/2 runs, 0 s, ? left" in text
    assert "[############............] 1/2 runs, 1 split" in text
