"""Views for the tests of one robot's decisions, and robots that make them: r02, with targets and others around."""

from collections.abc import Mapping

from contract.messages import NeighbourState
from onboard.ahdc.cotr import Task
from onboard.ahdc.parameters import Vector
from onboard.ahdc.plan import Motion
from onboard.ahdc.tasking import Tasking
from onboard.ahdc.view import Heard, Sighted, View
from tests.onboard.samples import field_parameters, paper_parameters, state

HERE = (0.4, -0.3)
BESIDE = (0.4, 0.2)
"""0.5 m from here."""


def fielded(robots: int = 4) -> Tasking:
    return Tasking("r02", field_parameters(robots))


def papered() -> Tasking:
    return Tasking("r02", paper_parameters())


def look(
    *told: NeighbourState,
    now_s: float = 1.0,
    at: Vector = HERE,
    heading_rad: float = 0.3,
    rims: Vector = (0.0, 0.0),
    targets: Mapping[int, Vector] | None = None,
    silent: bool = False,
    seen: bool = True,
    may_move: bool = True,
) -> View:
    """It hears these and, where ``seen``, sees them where they say they are; the start direction is 2 rad."""
    sighted = {s.robot: Sighted(s.x_m, s.y_m, 0.0, 0.0, 0.0, True) for s in told if seen}
    heard = {s.robot: Heard(s, 0.0, silent) for s in told}
    return View(now_s, Motion(*at, heading_rad, *rims), sighted, heard, targets or {}, 2.0, may_move)


def near(robot: str, dx_m: float, dy_m: float, **says: object) -> NeighbourState:
    """The message of a robot so far from here."""
    return state(robot, HERE[0] + dx_m, HERE[1] + dy_m, **says)


def occupying(tasking: Tasking, now_s: float = 1.0) -> Tasking:
    """It has just reached a target that lies where it stands."""
    for step_s in (now_s - 0.01, now_s):
        tasking.update(look(targets={0: HERE}, now_s=step_s))
    assert tasking.task is Task.OCCUPIED
    return tasking
