"""The course of a deployment on one robot: step after step, and back where one fails. Pure but for its runner."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, Protocol

from groundstation.deployment.plan import Release, Step, fault_of

Ending = Literal["done", "refused", "failed", "rolled back", "stranded"]
"""``failed``: before anything was switched, the robot runs what it ran; ``stranded``: the way back failed too."""


class Runner(Protocol):
    """Does a step on one robot's computer."""

    def __call__(self, step: Step) -> tuple[int, str]:
        """Exit code and output; no exception."""
        ...


class Outcome(NamedTuple):
    """How it ended on one robot."""

    robot: str
    ending: Ending
    detail: str = ""
    release: str = ""
    """What the robot runs now, as far as known."""
    before: str = ""


def follow(
    robot: str,
    steps: Sequence[Step],
    back: Callable[[], Sequence[Step]],
    run: Runner,
    tell: Callable[[str], None],
    release: Release,
    before: str,
) -> Outcome:
    """Do the steps; after a failure beyond the switch, the way back.

    :param back: the steps to the release ``before``.
    :param tell: hears what is under way, a line each.
    """
    for step in steps:
        tell(step.says)
        fault = fault_of(step, *run(step), release)
        if not fault:
            continue
        if not step.switched:
            return Outcome(robot, "failed", fault, before, before)
        tell(f"FAILED, going back: {fault}")
        for undo in back():
            worse = fault_of(undo, *run(undo))
            if worse:
                return Outcome(robot, "stranded", f"{fault}; and the way back: {worse}", "", before)
        return Outcome(robot, "rolled back", fault, before, before)
    return Outcome(robot, "done", "", release.name, before)
