"""The planner leaves out what cannot bind and says it at once: it answers as if it looked at everything each time."""

import dataclasses
import math
import random
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from onboard.ahdc.behaviour import FADED_M
from onboard.ahdc.field_law import into_discs
from onboard.ahdc.parameters import Vector
from onboard.ahdc.plan import (
    LOOK_AHEAD_S,
    REFINEMENTS,
    SHARES,
    TURNING_STOP_MPS,
    YIELD_RANGE_M,
    Command,
    Motion,
    Partner,
    Planner,
    enforced_radius_m,
    inside_disc,
    make_disc,
    way_clearance_m,
)
from onboard.ahdc.room import CONTACT_M, Disc, keepout
from onboard.ahdc.stopping import StopTable, stop_tables
from tests.onboard.samples import field_parameters

PARAMETERS = field_parameters()
STOPS = stop_tables(PARAMETERS)
PERIOD_S = 0.01
REST = Motion(0.0, 0.0, 0.0, 0.0, 0.0)


def planner() -> Planner:
    return Planner(PARAMETERS, STOPS, PERIOD_S)


class Scene(NamedTuple):
    motion: Motion
    partners: list[Partner]
    speed_mps: float
    turn_radps: float


def scenes(count: int, seed: int = 0) -> Iterator[Scene]:
    """Robots that drive, spin or stand, among others near contact, near the end of a link, or anywhere."""
    rng = random.Random(seed)
    for _ in range(count):
        forward, spin = rng.choice([0.0, 0.004, 0.006, 0.3, 0.8]), rng.choice([0.0, 0.0, 0.2])
        forward *= rng.choice([-1, 1])
        x, y, heading = rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-math.pi, math.pi)
        motion = Motion(x, y, heading, forward - spin, forward + spin)
        partners = [partner(rng, motion, f"r{k + 2:02d}") for k in range(rng.randrange(4))]
        yield Scene(motion, partners, rng.uniform(-0.9, 0.9), rng.choice([0.0, rng.uniform(-9, 9)]))


def partner(rng: random.Random, motion: Motion, name: str) -> Partner:
    least_m, most_m = rng.choice([(0.1, 0.5), (0.8, 1.05), (0.1, 1.2)])
    place = beside(rng, motion[:2], rng.uniform(least_m, most_m))
    long, short = (tuple(beside(rng, place, rng.uniform(0.0, reach_m)) for _ in "ab") for reach_m in (0.25, 0.1))
    age_s = rng.choice([rng.uniform(0.0, 0.15), rng.uniform(0.0, 2.0)])
    return Partner(name, rng.random() < 0.6, place, long, short, age_s, rng.random() < 0.5)


def beside(rng: random.Random, place: Vector, distance_m: float) -> Vector:
    angle = rng.uniform(-math.pi, math.pi)
    return (place[0] + distance_m * math.cos(angle), place[1] + distance_m * math.sin(angle))


def rest(table: StopTable, motion: Motion, command: Vector | None = None) -> Vector:
    """Where the robot rests after braking at once, or after a period of a command; in the arena frame."""
    rims = motion[3:]
    ahead, left = table.place(*rims) if command is None else table.place_after(*rims, *command, PERIOD_S)
    cosine, sine = math.cos(motion.heading_rad), math.sin(motion.heading_rad)
    return (motion.x_m + ahead * cosine - left * sine, motion.y_m + ahead * sine + left * cosine)


def discs(table: StopTable, motion: Motion, partners: list[Partner], which: int) -> list[Disc]:
    """One for each enforced link and each place its partner may come to rest at."""
    start = rest(table, motion)
    return [
        make_disc(start, point, enforced_radius_m(PARAMETERS, other.age_s))
        for other in partners
        if other.enforced
        for point in (other.long_stops, other.short_stops)[which]
    ]


def rims(speed_mps: float, turn_radps: float) -> Vector:
    """Both wheels are slowed alike, so that the curvature stays."""
    half = turn_radps * PARAMETERS.wheel_separation_m / 2
    left, right = speed_mps - half, speed_mps + half
    over = max(1.0, abs(left) / PARAMETERS.max_speed_mps, abs(right) / PARAMETERS.max_speed_mps)
    return (left / over, right / over)


def refused(scene: Scene, speed_mps: float) -> str:
    """The whole rule: every disc of both brakes, and every keep-out."""
    motion, command = scene.motion, rims(speed_mps, scene.turn_radps)
    for which, table in enumerate(STOPS):
        end = rest(table, motion, command)
        if not all(inside_disc(end, disc) for disc in discs(table, motion, scene.partners, which)):
            return "link"
    own, brake, end = motion[:2], rest(STOPS.long, motion), rest(STOPS.long, motion, command)
    for other in scene.partners:
        for point in (other.place, *other.long_stops):
            _, radius_m, _ = keepout(point, math.dist(brake, point), math.dist(own, point), other.resting)
            if way_clearance_m(own, end, point) < radius_m - 1e-9:
                return "separation"
    return ""


def command_by_the_rule(scene: Scene) -> Command:
    refusals = {share: refused(scene, share * scene.speed_mps) for share in SHARES}
    good = next((share for share in SHARES if not refusals[share]), None)
    last = [share for share in SHARES if good is None or share > good][-1:]
    bound = refusals[last[0]] if last else ""
    if good is None:
        standing = abs(scene.motion.left_mps + scene.motion.right_mps) / 2 < TURNING_STOP_MPS
        return Command(*(rims(0.0, scene.turn_radps) if standing else (0.0, 0.0)), bound)
    step = (last[0] - good) / 2 if last else 0.0
    for _ in range(REFINEMENTS):
        if not refused(scene, (good + step) * scene.speed_mps):
            good += step
        step /= 2
    return Command(*rims(good * scene.speed_mps, scene.turn_radps), bound)


def test_the_planner_answers_as_if_it_looked_at_everything() -> None:
    plan = planner()
    met: Counter[str] = Counter()
    for scene in scenes(800):
        command = plan.choose(plan.room(scene.motion, scene.partners), scene.speed_mps, scene.turn_radps)
        expected = command_by_the_rule(scene)
        assert command == (pytest.approx(expected[0]), pytest.approx(expected[1]), expected[2]), scene
        share = abs(command[0] + command[1]) / 2 / abs(scene.speed_mps)
        met[command.bound] += 1
        met["between"] += command.bound != "" and share > 0.01
        met["turns on the spot"] += command.bound != "" and share < 1e-9 < abs(command[1])
    assert min(met[case] for case in ("", "link", "separation", "between", "turns on the spot")) > 20, met


def test_resting_places_are_those_of_both_brakes() -> None:
    plan = planner()
    for scene in scenes(20):
        command = rims(scene.speed_mps, scene.turn_radps)
        for places, by in (
            (plan.brake_points(scene.motion), None),
            (plan.room(scene.motion, []).brakes, None),
            (plan.stop_points(scene.motion, *command), command),
        ):
            assert places == tuple(pytest.approx(rest(table, scene.motion, by)) for table in STOPS)


def test_a_velocity_minds_every_link_whose_disc_it_can_come_to_the_rim_of() -> None:
    """It looks farther ahead than a command, and so at more discs; what it is not told of could not bend it."""
    plan = planner()
    rng, bent = random.Random(1), 0
    for scene in scenes(800, seed=1):
        room = plan.room(scene.motion, scene.partners)
        every = discs(STOPS.long, scene.motion, scene.partners, 0)
        told_all = room._replace(long=sorted(every, key=lambda disc: disc not in room.long), far=[])
        u = beside(rng, (0.0, 0.0), PARAMETERS.max_speed_mps)
        bent += into_discs(u, told_all) != u
        assert into_discs(u, room) == pytest.approx(into_discs(u, told_all), abs=1e-12)
    assert bent > 100


def test_a_velocity_looks_past_all_discs_it_cannot_come_to_the_rim_of() -> None:
    plan = planner()
    ahead_m = 2 * LOOK_AHEAD_S * PARAMETERS.max_speed_mps
    diameter = enforced_radius_m(PARAMETERS, 0.0)
    for gap_m, minded in ((diameter - ahead_m - 0.001, 0), (diameter - ahead_m + 0.001, 1)):
        other = Partner("r02", True, (gap_m, 0.0), ((gap_m, 0.0),), ((gap_m, 0.0),), 0.0, False)
        room = plan.room(REST, [other])
        assert (len(room.long), len(room.far)) == (0, minded)


@pytest.mark.parametrize("avoidance_radius_m", [0.2, 0.5])
def test_a_velocity_hears_of_all_robots_it_gives_way_to_or_shrinks_from(avoidance_radius_m: float) -> None:
    plan = Planner(dataclasses.replace(PARAMETERS, avoidance_radius_m=avoidance_radius_m), STOPS, PERIOD_S)
    near_m = max(YIELD_RANGE_M, avoidance_radius_m + FADED_M)
    for distance_m, heard in ((near_m - 0.001, 1), (near_m + 0.001, 0)):
        other = Partner("r02", False, (distance_m, 0.0), ((0.0, 9.0),), ((0.0, 9.0),), 0.0, False)
        assert plan.room(REST, [other]).near == [(distance_m, other)] * heard


def test_at_rest_only_robots_close_by_are_kept_out_of() -> None:
    """A way of at most l clears a point at 2 l + contact by half the gap."""
    plan = planner()
    near = Partner("r02", False, (CONTACT_M + 0.01, 0.0), ((0.3, 0.0),), ((0.3, 0.0),), 0.0, False)
    far = Partner("r03", False, (0.0, 1.0), ((0.0, 0.9),), ((0.0, 0.9),), 0.0, False)
    room = plan.room(REST, [near, far])
    assert {centre for centre, _, _ in room.keepouts} == {near.place, near.long_stops[0]}


def test_a_robot_at_rest_leaves_the_whole_gap_and_any_other_half_of_it() -> None:
    plan = planner()
    full_mps = PARAMETERS.max_speed_mps
    way_m = plan.stop_points(REST, full_mps, full_mps)[0][0]
    place = (CONTACT_M + 1.5 * way_m, 0.0)
    for resting, bound in ((True, ""), (False, "separation")):
        other = Partner("r02", False, place, (place,), (place,), 0.0, resting)
        assert plan.choose(plan.room(REST, [other]), full_mps, 0.0).bound == bound


def test_a_link_binds_if_it_does_for_one_brake() -> None:
    """Braking better than announced is as wrong as braking worse."""
    plan = planner()
    near, far = ((-0.5, 0.0),), ((1e-6 - enforced_radius_m(PARAMETERS, 0.0), 0.0),)
    for long, short, bound in ((near, near, ""), (far, near, "link"), (near, far, "link")):
        other = Partner("r02", True, near[0], long, short, 0.0, True)
        assert plan.choose(plan.room(REST, [other]), PARAMETERS.max_speed_mps, 0.0).bound == bound
