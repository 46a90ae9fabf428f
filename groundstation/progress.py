"""One line about a sweep in progress: a bar on a terminal, a line now and then elsewhere. Pure: time is given."""

import math
from typing import TextIO

from groundstation.result import Result

TERMINAL_S = 0.2
LINE_S = 2.0
WIDTH = 24


class Progress:
    """Writes to ``stream`` when it is time to."""

    def __init__(self, total: int, stream: TextIO, now_s: float) -> None:
        self.done = 0
        self._completed = self._split = self._touched = 0
        self._total = total
        self._stream = stream
        self._terminal = stream.isatty()
        self._began_s = now_s
        self._due_s = now_s + (0.0 if self._terminal else LINE_S)
        self._long = 0

    def count(self, result: Result) -> None:
        """One more run."""
        self.done += 1
        self._completed += result.completed
        self._split += result.disconnected_steps > 0
        self._touched += result.collisions > 0

    def show(self, now_s: float, last: bool = False) -> None:
        """Show where it stands if that is due; ``last`` always is, and ends the line."""
        if now_s < self._due_s and not last:
            return
        self._due_s = now_s + (TERMINAL_S if self._terminal else LINE_S)
        text = self.line(now_s)
        if self._terminal:
            blank = " " * (self._long - len(text))
            self._long = len(text)
            self._stream.write(f"\r{text}{blank}" + ("\n" if last else ""))
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def line(self, now_s: float) -> str:
        """The line: bar, runs, what went wrong so far, time taken and time left."""
        full = self.done * WIDTH // self._total
        taken_s = now_s - self._began_s
        left_s = taken_s / self.done * (self._total - self.done) if self.done else math.inf
        wrong = [
            f"{count} {what}"
            for count, what in (
                (self.done - self._completed, "failed"),
                (self._split, "split"),
                (self._touched, "collided"),
            )
            if count
        ]
        parts = [f"{self.done}/{self._total} runs", *wrong, f"{words(taken_s)}, {words(left_s)} left"]
        return f"[{'#' * full}{'.' * (WIDTH - full)}] " + ", ".join(parts)


def words(seconds: float) -> str:
    """A duration in short."""
    if not math.isfinite(seconds):
        return "?"
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
