"""What a law's command passes on its way to the wheels: the fence, separation, what a robot cut off would do. Pure."""

import math
from collections.abc import Iterable, Mapping

from contract.arena import Arena
from contract.messages import NeighbourState
from onboard import unicycle
from onboard.ahdc.view import Decision, Heard, Left, Sighted
from onboard.courses import cut_bounds, cut_way
from onboard.cut import limit_cut
from onboard.foresight import Foresight
from onboard.hulls import Point
from onboard.limits import Neighbour, bounds_of, inside_fence, limit
from onboard.odometry import Pose
from onboard.record import record


class Guard:
    """The limits of an arena file."""

    def __init__(self, arena: Arena) -> None:
        self.bounds = bounds_of(arena)
        self._cut_bounds = cut_bounds(arena)
        self._separation_m = arena.platform.wheel_separation_m
        self._max_speed_mps = arena.control.max_speed_mps
        self._foresight = Foresight(self._cut_bounds)
        self._around: list[Neighbour] = []
        """The neighbours of the last command."""

    def inside_fence(self, pose: Pose) -> bool:
        """Whether a robot there is inside the fence, give or take what braking errors explain."""
        return inside_fence(self.bounds, pose.x_m, pose.y_m)

    def limited(
        self,
        decision: Decision,
        pose: Pose,
        rims_mps: tuple[float, float],
        asked_mps: tuple[float, float],
        sighted: Mapping[str, Sighted],
        heard: Mapping[str, Heard],
        left_places: Iterable[Left] = (),
    ) -> tuple[float, float, str]:
        """Rim speeds, left and right, m/s, no faster than the decision's, and what bounds them.

        :param pose: own, dead-reckoned to now.
        :param rims_mps: measured.
        :param asked_mps: rim speeds that the wheels have been asked so far, and that others are told.
        :param left_places: where robots may be as well.
        """
        left, right, waits = decision
        around = self._around = [Neighbour(*left.seen[:5]) for left in left_places]
        told_by = self._foresight.told
        for name, (x, y, vx, vy, age_s, _) in sighted.items():
            silence_s, told = 0.0, None
            if name in heard:
                state, silence_s, _ = heard[name]
                told = told_by(state)
            around.append(record(Neighbour, (x, y, vx, vy, age_s, silence_s, told)))
        speed, turn = unicycle.body(left, right, self._separation_m)
        speed, turn, limited_by = limit(speed, turn, pose, rims_mps, around, self.bounds)
        speed, turn, cut_by = limit_cut(speed, turn, pose, rims_mps, asked_mps, around, self._cut_bounds)
        left, right = unicycle.rims(speed, turn, self._separation_m, self._max_speed_mps)
        return left, right, cut_by or limited_by or waits

    def rolls_to(
        self, pose: Pose, rims_mps: tuple[float, float], asked_mps: tuple[float, float], silence_s: float
    ) -> Point:
        """Where wheels that obey nobody since so long take a robot: they do what they were asked, then coast."""
        standing_s = max(0.0, self._cut_bounds.standing_s - silence_s)
        x_m, y_m = pose.x_m, pose.y_m
        way = cut_way((x_m, y_m, pose.heading_rad, *rims_mps), *asked_mps, standing_s, self._cut_bounds)
        return max(way, key=lambda point: math.hypot(point[0] - x_m, point[1] - y_m))

    def hear(self, state: NeighbourState, age_s: float) -> None:
        """Work out a neighbour's message when it comes; ``age_s``: about its age at the next command."""
        self._foresight.hear(state, age_s)

    def look_ahead(self, later_s: float) -> None:
        """After a command: work out what the next one, so much later, will need."""
        self._foresight.look_ahead(self._around, later_s)
