"""The order in which robots reach start poses that lie too near to each other to pass between, and where they wait."""

import math
from itertools import combinations

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contract.messages import RobotReport
from groundstation.homeward import AWAY_M, CLEARING_S, Homeward, timeout_s
from groundstation.parking import APART_M, CLEAR_M, NoWay, aside, waves, waves_of
from onboard.odometry import Pose
from tests.groundstation.test_repeat_and_home import arena_of, cloud_of
from tests.groundstation.virtual import Virtual

FENCE = (0.15, 0.15, 3.85, 4.85)


def block(
    columns: int, rows: int, gap_m: float, corner: tuple[float, float] = (1.5, 1.5)
) -> dict[str, tuple[float, float]]:
    return {
        f"r{columns * j + i:02d}": (corner[0] + gap_m * i, corner[1] + gap_m * j)
        for j in range(rows)
        for i in range(columns)
    }


def order(starts: dict[str, tuple[float, float]], disc_m: float = 0.195) -> list[set[str]]:
    return [set(wave) for wave in waves(tuple(starts.items()), FENCE, disc_m)]


def test_far_enough_apart_all_go_at_once_and_in_a_block_from_the_inside_out() -> None:
    assert len(order(block(3, 3, 0.4))) == 1
    assert order(block(3, 3, 0.3)) == [{"r04"}, set(block(3, 3, 0.3)) - {"r04"}]
    inner = {f"r{5 * j + i:02d}" for j in (1, 2, 3) for i in (1, 2, 3)}
    assert order(block(5, 5, 0.25)) == [{"r12"}, inner - {"r12"}, set(block(5, 5, 0.25)) - inner]
    in_the_corner = order(block(3, 3, 0.3, (0.35, 0.35)))
    assert in_the_corner[0] == {"r00"}
    assert set().union(*in_the_corner) == set(block(3, 3, 0.3))


def test_starts_that_touch_are_refused_by_name() -> None:
    with pytest.raises(NoWay, match=r"r00 and r01 start 0\.17 m apart"):
        order(block(3, 3, 0.17))


@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(0.3, 2.0), st.floats(0.3, 2.0)), min_size=2, max_size=6, unique=True))
def test_every_robot_is_of_one_wave_and_the_last_of_them_have_a_way_out(places: list[tuple[float, float]]) -> None:
    starts = {f"r{i:02d}": place for i, place in enumerate(places)}
    try:
        found = order(starts)
    except NoWay:
        assert any(math.dist(a, b) < 2 * 0.195 for a, b in combinations(places, 2))
        return
    assert sorted(name for wave in found for name in wave) == sorted(starts)
    rest = {name: starts[name] for wave in found[:-1] for name in wave}
    if rest:
        assert order(rest)[-1] == found[-2], "without the last wave, the one before it is the last"


def test_robots_wait_clear_of_the_starts_and_of_each_other_and_stay_where_they_are_no_obstacle() -> None:
    arena = arena_of(9, gap_m=0.3)
    places = {name: robot.start for name, robot in arena.robots.items()} | {"r05": (3.0, 3.0)}
    waiting = [name for name in places if name not in ("r01", "r02")]
    found = aside(arena, places, waiting)
    assert found["r05"] == (3.0, 3.0)
    assert set(found) == set(waiting)
    for place in found.values():
        assert all(math.dist(place, robot.start) >= CLEAR_M - 1e-6 for robot in arena.robots.values())
        assert min(place) >= 0.15
        assert place[0] <= 3.85
        assert place[1] <= 4.85
    assert all(math.dist(a, b) >= APART_M - 1e-6 for a, b in combinations(found.values(), 2))


def test_without_room_to_wait_home_is_refused_before_a_wheel_turns() -> None:
    arena = arena_of(9, gap_m=0.3)
    places = {name: robot.start for name, robot in arena.robots.items()}
    narrow = msgspec.structs.replace(arena, arena=msgspec.structs.replace(arena.arena, size_m=(1.8, 1.8)))
    words = Homeward(narrow).begin(tuple(places), places | {"r01": (1.6, 1.6)})
    assert "no room for r" in words
    assert "carry it" in words
    tight = msgspec.structs.replace(arena, arena=msgspec.structs.replace(arena.arena, size_m=(1.3, 1.3)))
    words = Homeward(tight).begin(tuple(places), places | {"r01": (1.1, 1.1)})
    assert "no floor is left" in words


def reports(arena_names: list[str], home: set[str]) -> dict[str, RobotReport]:
    return {
        name: RobotReport(
            robot=name, boot=1, stamp_ns=0, run="running", pose_valid=True, task="home" if name in home else "homing"
        )
        for name in arena_names
    }


def test_each_wave_goes_when_the_one_before_is_home() -> None:
    arena = arena_of(9, gap_m=0.3)
    steps = waves_of(arena)
    assert [len(wave) for wave in steps] == [1, 3, 5]
    names = list(arena.robots)
    places = {name: (2.0 + 0.4 * (i % 3), 2.0 + 0.4 * (i // 3)) for i, name in enumerate(names)}
    way = Homeward(arena)
    assert way.begin(tuple(names), places) == ""
    assert set(way.aside) == set(names)
    nobody, home = reports(names, set()), set()
    for k, wave in enumerate(steps):
        away = way.advance(tuple(names), reports(names, home), places, float(k))
        assert set(way.aside) == {name for later in steps[k + 1 :] for name in later}
        assert set(away) == set(names) - home
        assert way.advance(tuple(names), reports(names, home), places, k + 0.5), "not before they are home"
        assert set(way.aside) == {name for later in steps[k + 1 :] for name in later}
        home |= set(wave)
    assert nobody
    assert way.advance(tuple(names), reports(names, home), places, 9.0) == []


def test_those_in_the_way_are_waited_for_but_not_for_ever() -> None:
    arena = arena_of(9, gap_m=0.3)
    names = tuple(arena.robots)
    places = {name: robot.start for name, robot in arena.robots.items()} | {"r01": (3.0, 3.0)}
    way = Homeward(arena)
    assert way.begin(names, places) == ""
    assert set(way.aside) == set(names), "r01 belongs into the corner; the others leave, and it waits for them"
    nobody = reports(list(names), set())
    way.advance(names, nobody, places, 0.0)
    assert "r01" in way.aside
    way.advance(names, nobody, places, CLEARING_S - 0.1)
    assert "r01" in way.aside
    way.advance(names, nobody, places, CLEARING_S)
    assert "r01" not in way.aside
    assert timeout_s(arena) == 180.0 + 2 * 30.0


def test_who_is_home_already_stays_where_only_the_outermost_are_away() -> None:
    arena = arena_of(9, gap_m=0.3)
    outermost = waves_of(arena)[-1]
    places = {name: robot.start for name, robot in arena.robots.items()} | {outermost[0]: (3.0, 3.0)}
    way = Homeward(arena)
    assert way.begin(tuple(places), places) == ""
    assert way.aside == {}
    assert math.dist(places[outermost[1]], arena.robots[outermost[1]].start) <= AWAY_M


def test_a_block_with_gaps_too_small_to_pass_is_filled_from_the_corner() -> None:
    arena = arena_of(4, gap_m=0.3, columns=2)
    assert len(waves_of(arena)) > 1
    poses = [Pose(0.7 + 0.45 * (i % 2), 1.15 - 0.45 * (i // 2), 2.5) for i in range(4)]
    swarm = Virtual(arena, cloud_of((2.0, 3.0)), poses)
    swarm.phase("ready", 2.0)
    swarm.order("home")
    swarm.phase("homing", 0.1)
    swarm.until(lambda: bool(swarm.session.heartbeat(swarm.now_ns).aside), 2.0)
    swarm.until(lambda: swarm.session.phase != "homing", timeout_s(arena))
    assert swarm.session.detail == "all robots at home"
    for name, robot in arena.robots.items():
        assert math.dist(swarm.pose(name)[:2], robot.start) < 0.03, name
    assert swarm.least_m > arena.platform.diameter_m
