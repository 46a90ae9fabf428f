"""``docs/fault-matrix.md`` from what the faults did. Pure."""

import math
import statistics
from collections.abc import Sequence

from contract.arena import Arena
from groundstation.faultreal import REAL_ROWS
from groundstation.faultrows import ROWS, Outcome, Row, allowed_m


def percentiles(values: Sequence[float]) -> tuple[float, float, float] | None:
    """(p50, p99, max); None for no values."""
    if not values:
        return None
    ordered = sorted(values)
    return statistics.median(ordered), ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))], ordered[-1]


HEAD = """# Fault matrix

Written by `ahdc-groundstation faults --repetitions N --progress DIR --markdown docs/fault-matrix.md`. *Zero* is the
time from the fault to the last stretch of zero setpoints or released motors that the emulated controller decoded; -
where it decoded nothing any more. A fault that only turning wheels show (supply cut, jammed, encoders backwards) has
no deadline while none is asked to turn faster than `safety.motion_way_m` within `safety.motion_window_s` can tell.
*Rolled* is the way of the victim's body after the fault. A run is good if both stay within their bounds, the body
comes to rest, nobody collides, the other robots' network stays whole, the robot is left in the run state of its
action, and a failsafe of that row speaks. *CUT*: nothing brakes the body, and it rolls on; the network may be whole
with the victim where it is or where it was cut off. *Named*: no program can stop these motors (a stop switch can); the
robot must say so and end as `fault`, and others that only its links hold together by then may part.

## In lockstep

"""
REAL = """
## In real time

The processes of the mock arena: bridge with router, emulated hardware, recorder, a process a robot. Written by the same
command with `--real`. *Zero* counts from before the fault is asked for, up to 60 ms before emulated hardware has it.
Every recording is read back; none may be unreadable. A robot that hung for a while may go on: its way is looked at
until its process does.

"""
TABLE = """| where | fault | action | zero allowed ms | zero p50/p99/max ms | rolled max m | allowed m | spoke | good |
|---|---|---|---|---|---|---|---|---|
"""


def markdown(lockstep: Sequence[Outcome], real: Sequence[Outcome], arena: Arena) -> str:
    """``docs/fault-matrix.md``; ``arena``: of the missions."""
    what = f"{len(ROWS)} faults, {_often(ROWS, lockstep)} each, at a random millisecond of a mission of"
    where = f"{len(arena.robots)} robots over real bytes ([groundstation/faultrows.py](../groundstation/faultrows.py))."
    real_what = f"{len(REAL_ROWS)} faults, {_often(REAL_ROWS, real)} each."
    tables = (
        TABLE + "".join(_line(row, found, arena) for row in rows)
        for rows, found in ((ROWS, lockstep), (REAL_ROWS, real))
    )
    first, second = tables
    return f"{HEAD}{what}\n{where}\n\n{first}{REAL}{real_what}\n\n{second}"


def _often(rows: Sequence[Row], outcomes: Sequence[Outcome]) -> str:
    counts = [sum(outcome.row == row.name for outcome in outcomes) for row in rows]
    return f"{min(counts)} times" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)} times"


def _line(row: Row, outcomes: Sequence[Outcome], arena: Arena) -> str:
    runs = [outcome for outcome in outcomes if outcome.row == row.name]
    zeros = percentiles([run.zero_s * 1e3 for run in runs if run.zero_s is not None]) if row.zero_s else None
    measured = " / ".join(f"{value:.0f}" for value in zeros) if zeros else "-"
    spoke = ", ".join(dict.fromkeys(f"`{name}`" for run in runs for name in run.failsafe)) or "-"
    deadline = "-" if row.zero_s is None else f"{row.zero_s * 1e3:.0f}"
    allowed_way_m = allowed_m(row, arena)
    allowed = f"{allowed_way_m:.2f}" if math.isfinite(allowed_way_m) else "-"
    rolled = "-" if row.zero_s is None else f"{max((run.rolled_m for run in runs), default=0.0):.2f}"
    good = f"{sum(not run.faults for run in runs)}/{len(runs)}"
    fault = row.fault + (f" ({row.family})" if row.family else "")
    cells = (row.where, fault, row.action, deadline, measured, rolled, allowed, spoke, good)
    return f"| {' | '.join(cells)} |\n"
