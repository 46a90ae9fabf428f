"""Robots that drive at each other, round each other, before each other, to places or at random; one of them is cut off.

What each wants is drawn, what it gets has passed the limits of :mod:`onboard.limits` and :mod:`onboard.cut`. Brakes are
mixed; poses and messages are fresh, or as old as they may be.

A robot that is cut off is ``hung`` and falls silent; or its wheels are ``unheard``, and hear nothing either; or they
are ``deaf``, but heard. Robots with such wheels go on telling others what they have commanded.
"""

import math
import random
from typing import Literal, NamedTuple

from onboard.ahdc.stopping import Brake, rim_after
from onboard.asked import DOUBT_NS
from onboard.cut import CutBounds, limit_cut
from onboard.limits import Bounds, Neighbour, Told, limit

DIAMETER_M = 0.14
MAX_RIM_MPS = 0.8
BRAKE = Bounds(
    fence=(-1e3, -1e3, 1e3, 1e3),
    min_distance_m=0.15,
    separation_m=0.11,
    deceleration_mps2=(1.6, 2.4),
    lag_s=(0.06, 0.15),
)
BOUNDS = CutBounds(brake=BRAKE, standing_s=0.22, coast_mps2=0.6, contact_m=0.145, beyond_fence_m=0.08)
STEP_S = 0.002
SILENCE_S = 0.25
"""Wheels silent for longer do what poses show, and the robot holds."""
POSES_STEPS = 50
"""Poses show what was so many steps ago."""
CONTROL_STEPS, MESSAGE_STEPS, STEPS = 5, 15, 2400
STYLES = ("at", "cross", "orbit", "place", "wild")
FLOOR_M = 1.4
START_M = 0.35


FaultKind = Literal["hung", "unheard", "deaf"]


class Moment(NamedTuple):
    """What there was to be seen and heard of one robot."""

    stamp_s: float
    vx_mps: float
    vy_mps: float
    told: Told
    rims_mps: tuple[float, float]


class Body:
    """A differential drive that obeys, then, cut off, keeps its command for a while and coasts."""

    def __init__(self, draw: random.Random) -> None:
        self.x, self.y = draw.uniform(0.0, FLOOR_M), draw.uniform(0.0, FLOOR_M)
        self.heading = draw.uniform(-math.pi, math.pi)
        self.rims = (0.0, 0.0)
        self.command = (0.0, 0.0)
        self.brake = Brake(draw.uniform(*BRAKE.deceleration_mps2), draw.uniform(*BRAKE.lag_s))
        self.cut_s = math.inf
        self.style = draw.choice(STYLES)
        self.hurry = draw.uniform(0.4, 1.0)
        self.place = (draw.uniform(0.0, FLOOR_M), draw.uniform(0.0, FLOOR_M))
        self.whim = (0.0, 0.0)
        self.wanted = (0.0, 0.0)
        """The last command given, obeyed or not."""
        self.heard = (0.0, 0.0)
        """Rim speeds at the last feedback."""
        self.fault: FaultKind = "hung"
        self.history: list[Moment] = []

    @property
    def at(self) -> tuple[float, float]:
        return self.x, self.y

    def advance(self, now_s: float) -> None:
        released = now_s >= self.cut_s + BOUNDS.standing_s - 0.02
        brake = Brake(BOUNDS.coast_mps2, 0.0) if released else self.brake
        command = (0.0, 0.0) if released else self.command
        left, left_m = rim_after(self.rims[0], command[0], brake, STEP_S)
        right, right_m = rim_after(self.rims[1], command[1], brake, STEP_S)
        self.rims = (left, right)
        turn, way = (right_m - left_m) / BRAKE.separation_m, (left_m + right_m) / 2
        self.x += way * math.cos(self.heading + turn / 2)
        self.y += way * math.sin(self.heading + turn / 2)
        self.heading += turn

    def measured(self, now_s: float) -> tuple[float, float]:
        """Rim speeds as the robot itself knows them."""
        since_s = now_s - self.cut_s
        if self.fault != "unheard" or since_s <= 0.0:
            return self.rims
        if since_s <= SILENCE_S:
            return self.heard
        return self.history[-1 - POSES_STEPS].rims_mps

    def asked(self, now_s: float) -> tuple[float, float]:
        """What the robot says that its wheels were told."""
        if self.fault == "unheard" and now_s - self.cut_s > DOUBT_NS * 1e-9:
            return self.command
        return self.wanted

    def remember(self, now_s: float) -> None:
        speed = sum(self.rims) / 2
        if now_s <= self.cut_s:
            self.heard = self.rims
        told = Told((*self.at, self.heading), self.measured(now_s), self.asked(now_s))
        velocity = speed * math.cos(self.heading), speed * math.sin(self.heading)
        stamp_s = min(now_s, self.cut_s) if self.fault == "hung" else now_s
        self.history.append(Moment(stamp_s, *velocity, told, self.rims))

    def seen(self, now_s: float, age_steps: int, every_steps: int) -> Neighbour:
        """As another robot knows it whose poses and messages are that old, and which told so often."""
        last = len(self.history) - 1
        pose = self.history[max(0, last - age_steps)]
        spoke = max(0, last - age_steps)
        if self.fault == "hung":
            spoke = min(spoke, int(min(self.cut_s, 1e3) / STEP_S))
        spoke = spoke // every_steps * every_steps
        message = self.history[spoke]
        silence_s = now_s - message.stamp_s
        return Neighbour(*pose.told.place[:2], pose.vx_mps, pose.vy_mps, age_steps * STEP_S, silence_s, message.told)

    def wish(self, other: "Body", draw: random.Random) -> tuple[float, float]:
        """Speed and turn rate."""
        if self.style == "wild":
            if draw.random() < 0.03:
                self.whim = (draw.uniform(-0.8, 0.8), draw.uniform(-6.0, 6.0))
            return self.whim
        goal_x, goal_y = other.at
        if self.style == "cross":
            ahead_m = 0.3 * sum(other.rims)
            goal_x, goal_y = goal_x + ahead_m * math.cos(other.heading), goal_y + ahead_m * math.sin(other.heading)
        elif self.style == "place":
            if math.dist(self.at, self.place) < 0.1:
                self.place = (draw.uniform(0.0, FLOOR_M), draw.uniform(0.0, FLOOR_M))
            goal_x, goal_y = self.place
        off = math.remainder(math.atan2(goal_y - self.y, goal_x - self.x) - self.heading, math.tau)
        off -= 1.2 if self.style == "orbit" else 0.0
        return 0.8 * self.hurry * max(0.0, math.cos(off)), max(-6.0, min(6.0, 6.0 * off))

    def obey(self, now_s: float, wish: tuple[float, float], others: list[Neighbour], ruled: bool) -> None:
        half_m = BRAKE.separation_m / 2
        speed, turn = wish
        fastest = max(abs(speed - half_m * turn), abs(speed + half_m * turn))
        scale = min(1.0, MAX_RIM_MPS / fastest) if fastest > 0.0 else 1.0
        pose = (self.x, self.y, self.heading)
        rims = self.measured(now_s)
        speed, turn, _ = limit(scale * speed, scale * turn, pose, rims, others, BRAKE)
        if ruled:
            speed, turn, _ = limit_cut(speed, turn, pose, rims, self.asked(now_s), others, BOUNDS)
        if now_s > self.cut_s + SILENCE_S:
            speed = turn = 0.0
        self.wanted = (speed - half_m * turn, speed + half_m * turn)
        if now_s < self.cut_s:
            self.command = self.wanted


def flight(seed: int, oldest_s: float = 0.0, ruled: bool = True, fault: FaultKind = "hung") -> float | None:
    """Least distance of two or three robots, the first of which is cut off, m; None where they start too near.

    :param oldest_s: poses and messages are up to so old, one age a robot; messages come every 30 ms.
    """
    draw = random.Random(seed)
    bodies = [Body(draw) for _ in range(draw.choice((2, 2, 3)))]
    pairs = [(a, b) for i, a in enumerate(bodies) for b in bodies[:i]]
    if min(math.dist(a.at, b.at) for a, b in pairs) < START_M:
        return None
    bodies[0].cut_s = draw.uniform(0.2, 3.0)
    bodies[0].fault = fault
    ages = [int(draw.uniform(0.25, 1.0) * oldest_s / STEP_S) for _ in bodies]
    every = MESSAGE_STEPS if oldest_s > 0.0 else CONTROL_STEPS
    nearest_m = math.inf
    for step in range(STEPS):
        now_s = step * STEP_S
        for body in bodies:
            body.remember(now_s)
        if step % CONTROL_STEPS == 0:
            for index, own in enumerate(bodies):
                if now_s < own.cut_s or own.fault != "hung":
                    other = bodies[0] if index and draw.random() < 0.5 else bodies[(index + 1) % len(bodies)]
                    others = [body.seen(now_s, ages[index], every) for body in bodies if body is not own]
                    own.obey(now_s, own.wish(other, draw), others, ruled)
        for body in bodies:
            body.advance(now_s)
        nearest_m = min(nearest_m, *(math.dist(a.at, b.at) for a, b in pairs))
    return nearest_m


def search(
    first_seed: int, flights: int, oldest_s: float = 0.0, ruled: bool = True, fault: FaultKind = "hung"
) -> list[tuple[float, int]]:
    """(least distance m, seed) of that many flights, the nearest first."""
    found = ((flight(seed, oldest_s, ruled, fault), seed) for seed in range(first_seed, first_seed + flights))
    return sorted((least, seed) for least, seed in found if least is not None)
