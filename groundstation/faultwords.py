"""What a fault did, judged: by what the motors decoded and how far the body rolled. Pure."""

from collections.abc import Iterable, Iterator

from contract.arena import Arena
from contract.messages import MotorSample
from groundstation.faultrows import Outcome, Row


def zero_after_s(
    samples: Iterable[MotorSample], fault_ns: int, first: bool = False, gentle_radps: float | None = None
) -> float | None:
    """From the fault to the last, or the first, stretch of zeros or released motors; None: there is none such.

    :param gentle_radps: leave out the time for which neither wheel is asked to turn faster than that.
    """
    began = gentle = None
    for sample in samples:
        stamp_ns = sample.stamp_ns
        if stamp_ns < fault_ns:
            continue
        stands = sample.released or not sample.enabled or (sample.left_radps == 0.0 == sample.right_radps)
        fastest = 0.0 if stands else max(abs(sample.left_radps), abs(sample.right_radps))
        if gentle_radps is not None and fastest <= gentle_radps:
            gentle = stamp_ns if gentle is None else gentle
        elif gentle is not None:
            fault_ns += stamp_ns - gentle
            gentle = None
        if stands:
            began = stamp_ns if began is None else began
        elif not first:
            began = None
    if began is None:
        return None
    return round(((began if gentle is None else min(gentle, began)) - fault_ns) * 1e-9, 4)


def gentle_radps(row: Row, arena: Arena) -> float | None:
    """What wheels must be asked to do, at least, to show a fault that only turning ones have; None: any row else."""
    safety, radius_m = arena.safety, arena.platform.wheel_radius_m
    return safety.motion_way_m / safety.motion_window_s / radius_m if row.turning else None


def judge(row: Row, outcome: Outcome, allowed: float) -> Iterator[str]:
    """What the row demands and the outcome lacks, in words."""
    if outcome.collisions and row.action != "named":
        yield f"{outcome.collisions} collision(s)"
    if outcome.split:
        yield "the others came apart"
    if row.ends and outcome.state not in row.ends:
        yield f"left {outcome.state or 'in no state'}, expected {' or '.join(row.ends)}"
    if row.failsafes and not set(row.failsafes) & set(outcome.failsafe):
        yield f"spoke {', '.join(outcome.failsafe) or 'nothing'}, expected {' or '.join(row.failsafes)}"
    if row.zero_s is None:
        if outcome.failsafe and not row.failsafes:
            yield f"stopped by {', '.join(outcome.failsafe)}"
        return
    if not (row.blind and row.resumes):
        yield from _at_rest(row, outcome, row.zero_s)
    elif outcome.rest_s is None and not outcome.rolled_m:
        yield "not seen again"
    if outcome.rolled_m > allowed:
        yield f"rolled {outcome.rolled_m:g} m, {allowed:.2f} m allowed"


def _at_rest(row: Row, outcome: Outcome, within_s: float) -> Iterator[str]:
    if outcome.zero_s is None and outcome.rest_s is None:
        yield "neither a zero nor rest"
    elif outcome.zero_s is not None and outcome.zero_s > within_s:
        yield f"zero after {outcome.zero_s:g} s, {within_s:g} s allowed"
    if outcome.rest_s is None and not row.resumes:
        yield "still moving when last looked at"
