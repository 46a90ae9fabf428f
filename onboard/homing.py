"""The way home: to a robot's start pose, round the others, without links. Not the paper; an order chooses it. Pure.

Direction: of those that are free for a quarter of a metre, the one nearest to the way home; robots at rest are
discs just too large to touch, moving ones larger; of two equal ways round, the right-hand one, so that robots
that meet pass each other. Speed: what stops within the free length and at home. A robot that comes no nearer for
a while makes a detour; which way differs from robot to robot and from time to time, so that a jam dissolves. Wheels
that do not turn at a creeping command are given faster ones (onboard/dead_zone.py), and home is then as near, and
faced as exactly, as such wheels can come to. The supervisor's fence and separation stand behind all of it. Where starts
are too near to each other to pass between, the station tells robots to wait aside (groundstation/parking.py).
"""

import math
from collections.abc import Collection
from typing import Final, NamedTuple
from zlib import crc32

from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.stopping import Brake, speed_for_stop_mps
from onboard.ahdc.view import Decision, Sighted, View
from onboard.dead_zone import ROLL_S, DeadZone
from onboard.limits import Bounds
from onboard.unicycle import fold, rims, steer

ARRIVED_M: Final = 0.02
LEFT_M: Final = 0.06
"""Farther from home than this, an arrived robot goes back."""
FACING_RAD: Final = 0.1
RESTING_MPS: Final = 0.02
SPEED_SHARE: Final = 0.6
"""Of u_max: nobody is in a hurry to go home."""
FREE_M: Final = 0.25
"""A direction is free that meets no disc for this long, or up to home."""
SPARE_M: Final = 0.03
"""Added to the least distance the supervisor allows: the disc of a robot at rest."""
MOVING_M: Final = 0.06
"""Added to the disc of a robot that moves."""
BENDS_RAD = tuple(side * math.radians(angle) for angle in range(0, 180, 12) for side in (-1, 1))[1:]
"""Candidate directions, off the way home; of each pair the right-hand one first."""
REACH_M: Final = 0.6
"""Others farther away than this are in nobody's way."""
TURNING_BACK_RAD: Final = 0.4
"""What it costs to change the side on which the others are passed."""
PROGRESS_M: Final = 0.03
PATIENCE_S: Final = 2.5
DETOUR_S = (0.8, 1.7, 2.6)
TURN_GAIN_PER_S: Final = 3.0
SPIN_RADPS: Final = 2.0


class Home(NamedTuple):
    """Where a robot belongs: m and rad, arena frame."""

    x_m: float
    y_m: float
    heading_rad: float


class Disc(NamedTuple):
    """Where the robot's centre must not go, m."""

    x_m: float
    y_m: float
    radius_m: float


class Homing:
    """One robot's way home; :meth:`begin` before each."""

    def __init__(self, robot: str, home: Home, parameters: Parameters, bounds: Bounds, period_s: float) -> None:
        self.robot = robot
        self.home = home
        self.arrived = False
        self.aside: Vector | None = None
        """Where to wait first, m; None: go home."""
        self._parameters = parameters
        self._bounds = bounds
        (weak, _), (_, slow) = parameters.brake_deceleration_mps2, parameters.motor_lag_s
        self._brake = Brake(weak, slow + 2 * period_s)
        self._wheels = DeadZone(SPEED_SHARE * parameters.max_speed_mps)
        self._side = -1
        self._goal: Vector = home[:2]
        self._best_m = math.inf
        self._progress_s = -math.inf
        self._detours = 0
        self._detour_until_s = -math.inf

    def begin(self, now_s: float) -> None:
        """Progress counts from here."""
        self.arrived = False
        self._wheels.forget(now_s)
        self._best_m, self._progress_s = math.inf, now_s
        self._detour_until_s = -math.inf

    def decide(self, view: View, told_mps: Vector = (0.0, 0.0)) -> Decision:
        """Rim speeds of this step, m/s.

        :param told_mps: rim speeds that left for the wheels in the last step.
        """
        motion = view.motion
        peak_mps = max(abs(motion.left_mps), abs(motion.right_mps))
        self._wheels.saw(max(map(abs, told_mps)), peak_mps, view.now_s)
        if not view.may_move:
            self._progress_s = max(self._progress_s, view.now_s)
            return Decision(0.0, 0.0, "hold")
        own = (motion.x_m, motion.y_m)
        goal = self.aside or self.home[:2]
        if goal != self._goal:
            self._goal, self._best_m, self._progress_s = goal, math.inf, view.now_s
        away_m = math.dist(own, goal)
        if self.aside is not None and away_m <= LEFT_M + self._roll_m:
            self.arrived = False
            return Decision(0.0, 0.0, "home")
        still = peak_mps < RESTING_MPS
        if self.aside is None and away_m <= (LEFT_M if self.arrived else ARRIVED_M) + self._roll_m:
            error = fold(self.home.heading_rad - motion.heading_rad)
            facing_rad = FACING_RAD + self._wheels.least_mps * ROLL_S / self._parameters.wheel_separation_m
            facing = abs(error) < (2 * facing_rad if self.arrived else facing_rad)
            self.arrived = facing and (still or self.arrived)
            turn = 0.0 if facing else max(-SPIN_RADPS, min(SPIN_RADPS, TURN_GAIN_PER_S * error))
            return self._drive(0.0, turn)
        self.arrived = False
        discs = [disc for disc in map(self._disc, view.sighted.values()) if math.dist(own, disc[:2]) < REACH_M]
        speed, turn = steer(self._velocity(own, goal, discs, view.now_s), motion.heading_rad)
        return self._drive(speed, turn)

    @property
    def _roll_m(self) -> float:
        return self._wheels.roll_m(self._brake.deceleration_mps2)

    def _drive(self, speed_mps: float, turn_radps: float) -> Decision:
        p = self._parameters
        return Decision(
            *self._wheels.raised(*rims(speed_mps, turn_radps, p.wheel_separation_m, p.max_speed_mps)), "home"
        )

    def _disc(self, seen: Sighted) -> Disc:
        """Another robot, predicted to now."""
        radius_m = self._bounds.min_distance_m + SPARE_M
        if math.hypot(seen.vx_mps, seen.vy_mps) > RESTING_MPS:
            radius_m += MOVING_M
        return Disc(seen.x_m + seen.vx_mps * seen.age_s, seen.y_m + seen.vy_mps * seen.age_s, radius_m)

    def _velocity(self, own: Vector, goal: Vector, discs: Collection[Disc], now_s: float) -> Vector:
        away_m = math.dist(own, goal)
        bearing = math.atan2(goal[1] - own[1], goal[0] - own[0]) + self._detour(away_m, now_s)
        need_m = min(FREE_M, max(0.0, away_m - SPARE_M))
        best, best_bend, best_m = math.inf, 0.0, 0.0
        for bend in BENDS_RAD:
            if abs(bend) >= best:
                break
            angle = bearing + bend
            free_m = free_length_m(own, (math.cos(angle), math.sin(angle)), discs, self._bounds, FREE_M)
            cost = abs(bend) + (TURNING_BACK_RAD if bend * self._side < 0 else 0.0) + 40 * max(0.0, need_m - free_m)
            if cost < best:
                best, best_bend, best_m = cost, bend, free_m
        if best_bend:
            self._side = 1 if best_bend > 0 else -1
        stop_m = min(away_m, best_m) if best_m < FREE_M else away_m
        speed_mps = min(SPEED_SHARE * self._parameters.max_speed_mps, speed_for_stop_mps(stop_m, self._brake))
        angle = bearing + best_bend
        return (speed_mps * math.cos(angle), speed_mps * math.sin(angle))

    def _detour(self, away_m: float, now_s: float) -> float:
        """Angle by which to turn off the way home, rad; 0 while there is progress."""
        if away_m < self._best_m - PROGRESS_M:
            self._best_m, self._progress_s = away_m, now_s
        if now_s - self._progress_s > PATIENCE_S:
            self._detours += 1
            draw = crc32(f"{self.robot} {self._detours}".encode())
            self._detour_until_s = self._progress_s = now_s + DETOUR_S[draw % len(DETOUR_S)]
            self._best_m = math.inf
        if now_s >= self._detour_until_s:
            return 0.0
        draw = crc32(f"{self.robot} {self._detours}".encode())
        return (1.0 + (draw >> 8) % 100 / 50) * (1 if draw >> 4 & 1 else -1)


def free_length_m(own: Vector, way: Vector, discs: Collection[Disc], bounds: Bounds, most_m: float) -> float:
    """How far the unit vector ``way`` leads without entering a disc or leaving the fence, at most ``most_m``.

    From inside a disc, and from beyond the fence, only what leads out is free.
    """
    free_m = most_m
    for x_m, y_m, radius_m in discs:
        dx, dy = x_m - own[0], y_m - own[1]
        along = dx * way[0] + dy * way[1]
        if along <= 0.0:
            continue
        square = radius_m * radius_m - (dx * dx + dy * dy - along * along)
        if square > 0.0:
            free_m = min(free_m, max(0.0, along - math.sqrt(square)))
    low_x, low_y, high_x, high_y = bounds.fence
    for place, direction, low, high in ((own[0], way[0], low_x, high_x), (own[1], way[1], low_y, high_y)):
        if direction > 1e-9:
            free_m = min(free_m, max(0.0, (high - place) / direction))
        elif direction < -1e-9:
            free_m = min(free_m, max(0.0, (low - place) / direction))
    return free_m
