"""An adversary against the stop-point plan: it steers every robot, and chooses brakes, ages, phases and who dies when.

Robots run in closed loop on their own clocks with the very planner of the field profile and, after it, the supervisor's
limit of separation; their motors follow their own brakes, anywhere in the calibrated interval. Neighbours know each
other by announcements that are as old as the adversary likes. It wants links longer than r_c, or robots nearer than a
diameter, and climbs towards either.
"""

import math
import random
from typing import Any, NamedTuple

from onboard.ahdc.field_law import FieldLaw
from onboard.ahdc.links import Entry, Link
from onboard.ahdc.plan import Motion
from onboard.ahdc.stopping import Brake, rim_after
from onboard.ahdc.view import Heard, Sighted, View
from onboard.limits import Neighbour, bounds_of, limit
from onboard.unicycle import FAST_TURN_GAIN_PER_S, body, rims, steer
from tests.onboard.samples import arena, field_parameters, state

PERIOD_S, SUBSTEP_S, ANNOUNCE_S, SILENCE_S = 0.01, 0.002, 0.03, 0.5
WISH_S, WISHES = 0.2, 9
"""The adversary gives each robot a new wish this often, so many times."""
TURN_RADPS = 9.0
"""Faster than the law ever turns."""
GAINS_PER_S = (6.0, FAST_TURN_GAIN_PER_S)
"""With which a wish may turn towards a heading, as the law does."""
PARAMETERS = field_parameters()
BOUNDS = bounds_of(arena("field"))._replace(fence=(-99.0, -99.0, 99.0, 99.0))
"""Of the supervisor, without a fence."""


class Wish(NamedTuple):
    """A speed, m/s, with a turn rate, rad/s, or, where there is a gain, towards a heading, rad."""

    speed_mps: float
    turn: float
    gain_per_s: float = 0.0

    def turn_rate_radps(self, heading_rad: float) -> float:
        """At that heading."""
        if not self.gain_per_s:
            return self.turn
        rate = self.gain_per_s * math.remainder(self.turn - heading_rad, math.pi)
        return max(-TURN_RADPS, min(TURN_RADPS, rate))


class Robot(NamedTuple):
    """What the adversary chooses for one robot."""

    x_m: float
    y_m: float
    heading_rad: float
    brake: Brake
    phase_s: float
    age_s: float
    """Of what it learns of others: exposure to use, less what lies between two announcements."""
    wishes: tuple[Wish, ...]
    """In turn."""
    dies_s: float
    """From then on its command is zero and it says nothing; infinite for never."""


class Found(NamedTuple):
    """What a search came to."""

    longest_m: float
    """Of the enforced links, at any time."""
    nearest_m: float
    worst: tuple[Robot, ...]


def draw(rng: random.Random, robots: int, max_age_s: float, close: bool) -> tuple[Robot, ...]:
    """Robots in a chain, near the end of their links, or near each other."""
    made: list[Robot] = []
    x = y = 0.0
    for _ in range(robots):
        made.append(_robot(rng, x, y, max_age_s))
        angle, gap_m = rng.uniform(-0.6, 0.6), rng.uniform(0.22, 0.5) if close else rng.uniform(0.6, 0.95)
        x, y = x + gap_m * math.cos(angle), y + gap_m * math.sin(angle)
    return tuple(made)


def _robot(rng: random.Random, x: float, y: float, max_age_s: float) -> Robot:
    p = PARAMETERS
    return Robot(
        x, y, rng.uniform(-math.pi, math.pi),
        Brake(rng.uniform(*p.brake_deceleration_mps2), rng.uniform(*p.motor_lag_s)),
        rng.uniform(0.0, PERIOD_S), rng.uniform(0.0, max_age_s - ANNOUNCE_S),
        tuple(_wish(rng) for _ in range(WISHES)), rng.uniform(0.2, 1.5) if rng.random() < 0.25 else math.inf,
    )  # fmt: skip


def _wish(rng: random.Random) -> Wish:
    speed = rng.choice((-1.0, 1.0, rng.uniform(-1.0, 1.0))) * PARAMETERS.max_speed_mps
    if rng.random() < 0.25:
        return Wish(speed, rng.uniform(-math.pi, math.pi), rng.choice(GAINS_PER_S))
    return Wish(speed, rng.choice((0.0, 0.0, rng.uniform(-TURN_RADPS, TURN_RADPS), -TURN_RADPS, TURN_RADPS)))


def mutate(rng: random.Random, robots: tuple[Robot, ...], max_age_s: float) -> tuple[Robot, ...]:
    """One choice made anew."""
    k = rng.randrange(len(robots))
    old, fresh = robots[k], _robot(rng, robots[k].x_m, robots[k].y_m, max_age_s)
    name = rng.choice(["heading_rad", "brake", "phase_s", "age_s", "wishes", "wishes", "wishes", "dies_s"])
    value = getattr(fresh, name)
    if name == "wishes":
        at = rng.randrange(WISHES)
        value = (*old.wishes[:at], _wish(rng), *old.wishes[at + 1 :])
    return (*robots[:k], old._replace(**{name: value}), *robots[k + 1 :])


class _Loop:
    """One robot's body, motors and law."""

    def __init__(self, name: str, robot: Robot, linked: list[str], supervised: bool) -> None:
        self.name, self.robot, self.supervised = name, robot, supervised
        self.motion = Motion(robot.x_m, robot.y_m, robot.heading_rad, 0.0, 0.0)
        self.command = (0.0, 0.0)
        self.law = FieldLaw(name, 1, PARAMETERS, PERIOD_S, steer)
        for other in linked:
            self.law.links.entries[other] = Entry(Link.ON)
        self.next_s, self.say_s = robot.phase_s, 0.0
        self.said: list[tuple[float, Any]] = []
        self.track: list[tuple[float, float, float, float, float]] = []

    def roll(self) -> None:
        x, y, heading, left, right = self.motion
        new_left, way_left = rim_after(left, self.command[0], self.robot.brake, SUBSTEP_S)
        new_right, way_right = rim_after(right, self.command[1], self.robot.brake, SUBSTEP_S)
        way, turn = (way_left + way_right) / 2, (way_right - way_left) / PARAMETERS.wheel_separation_m
        x, y = x + way * math.cos(heading + turn / 2), y + way * math.sin(heading + turn / 2)
        self.motion = Motion(x, y, heading + turn, new_left, new_right)

    def velocity(self) -> tuple[float, float]:
        speed = (self.motion.left_mps + self.motion.right_mps) / 2
        return speed * math.cos(self.motion.heading_rad), speed * math.sin(self.motion.heading_rad)

    def announce(self, now_s: float) -> None:
        long, short = self.law.planner.stop_points(self.motion, *self.command)
        vx, vy = self.velocity()
        moving = max(map(abs, (*self.command, self.motion.left_mps, self.motion.right_mps))) >= 0.01
        x, y = self.motion[:2]
        message = state(self.name, x, y, vx_mps=vx, vy_mps=vy, stop_long=long, stop_short=short, moving=moving)
        self.said.append((now_s, message))

    def limited(self, sighted: dict[str, Sighted], heard: dict[str, Heard]) -> tuple[float, float]:
        """The command within the supervisor's separation, as :meth:`onboard.agent.Agent.step` has it."""
        p, (x, y, heading, left, right) = PARAMETERS, self.motion
        around = [Neighbour(*seen[:5], heard[name].age_s if name in heard else 0.0) for name, seen in sighted.items()]
        speed, turn = body(*self.command, p.wheel_separation_m)
        v, omega, _ = limit(speed, turn, (x, y, heading), (left, right), around, BOUNDS)
        return rims(v, omega, p.wheel_separation_m, p.max_speed_mps)

    def step(self, now_s: float, others: "list[_Loop]") -> None:
        wish = self.robot.wishes[min(int(now_s / WISH_S), WISHES - 1)]
        sighted, heard = {}, {}
        for other in others:
            known = newest(other.track, now_s - self.robot.age_s)
            if known is None:
                continue
            stamp_s, x, y, vx, vy = known
            sighted[other.name] = Sighted(x, y, vx, vy, now_s - stamp_s, True)
            told = newest(other.said, now_s - self.robot.age_s)
            if told is not None:
                heard[other.name] = Heard(told[1], now_s - told[0], now_s - told[0] > SILENCE_S)
        view = View(now_s, self.motion, sighted, heard, {}, 0.0, True)
        if now_s >= self.robot.dies_s or len(heard) < len(others):
            self.command = (0.0, 0.0)
        else:
            law, turn_radps = self.law, wish.turn_rate_radps(self.motion.heading_rad)
            room = law.planner.room(self.motion, law.partners(view))
            self.command = law.planner.choose(room, wish.speed_mps, turn_radps)[:2]
            if self.supervised:
                self.command = self.limited(sighted, heard)


def newest(entries: list[Any], until_s: float) -> Any:
    """The last entry of that time or before; entries begin with their times."""
    return next((entry for entry in reversed(entries) if entry[0] <= until_s), None)


def fly(robots: tuple[Robot, ...], linked: bool = True, supervised: bool = True) -> tuple[float, float]:
    """(longest link, least distance) of one flight, m; not supervised: by the plan alone."""
    names = [f"r{k}" for k in range(len(robots))]
    loops = [
        _Loop(name, robot, [names[j] for j in (k - 1, k + 1) if linked and 0 <= j < len(names)], supervised)
        for k, (name, robot) in enumerate(zip(names, robots, strict=True))
    ]
    longest, nearest = 0.0, math.inf
    for tick in range(round(WISHES * WISH_S / SUBSTEP_S) + 400):
        now_s = tick * SUBSTEP_S
        for loop in loops:
            loop.roll()
            if tick % 5 == 0:
                loop.track = [*loop.track[-20:], (now_s, *loop.motion[:2], *loop.velocity())]
        for loop in loops:
            if now_s >= loop.next_s:
                loop.next_s += PERIOD_S
                loop.step(now_s, [other for other in loops if other is not loop])
                if now_s >= loop.say_s and now_s < loop.robot.dies_s:
                    loop.say_s = now_s + ANNOUNCE_S
                    loop.announce(now_s)
        places = [loop.motion[:2] for loop in loops]
        for i, place in enumerate(places):
            for j in range(i):
                distance = math.dist(place, places[j])
                if distance < nearest:
                    nearest = distance
                if i - j == 1 and distance > longest:
                    longest = distance
    return longest, nearest


def search(seed: int, climbs: int, robots: int = 2, max_age_s: float = 0.08, close: bool = False) -> Found:
    """Draw, then climb towards longer links, or with ``close`` towards nearer robots."""
    rng = random.Random(seed)
    best = draw(rng, robots, max_age_s, close)
    longest, nearest = fly(best, not close)
    for _ in range(climbs):
        other = mutate(rng, best, max_age_s)
        far, near = fly(other, not close)
        if (near < nearest) if close else (far > longest):
            best, longest, nearest = other, far, near
    return Found(longest, nearest, best)
