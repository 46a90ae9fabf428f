"""Whom robots lead and follow: indicators and hops, calls for help, and where one without a target goes."""

import math
from collections.abc import Callable

import pytest

from contract.messages import Help, NeighbourState
from onboard.ahdc.assist import OPEN_S
from onboard.ahdc.cotr import Task
from onboard.ahdc.parameters import Vector
from onboard.ahdc.tasking import (
    ASIDE_M,
    HELP_STAND_OFF_M,
    LEAD_M,
    NO_HOPS,
    RELAY_STOP_M,
    STAND_OFF_M,
    Tasking,
)
from onboard.ahdc.view import Goal
from tests.onboard.looks import BESIDE, HERE, fielded, look, near, occupying, papered

# --- indicators and hops --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "targets", "indicator", "hops"),
    [
        (fielded, {4: BESIDE}, False, 0),
        (fielded, {4: BESIDE, 5: (0.9, -0.3)}, True, 0),
        (papered, {4: BESIDE}, False, 2),
        (papered, {4: BESIDE, 5: (0.9, -0.3)}, True, 0),
    ],
)
def test_a_tracker_that_sees_another_target_indicates_and_in_the_field_profile_every_tracker_leads(
    make: Callable[[], Tasking], targets: dict[int, Vector], indicator: bool, hops: int
) -> None:
    tasking = make()
    for now_s in (1.0, 1.1):
        tasking.update(look(near("r03", 0.5, 0.5, hops=1), targets=targets, now_s=now_s))
    assert tasking.task is Task.TRACKING
    assert (tasking.indicator, tasking.hops) == (indicator, hops)


def test_by_the_letter_what_is_seen_occupied_is_nothing_to_indicate() -> None:
    tasking = papered()
    for now_s in (1.0, 1.1):
        tasking.update(look(near("r03", 0.5, 0.5, occupied="20"), targets={4: BESIDE, 5: (0.9, -0.3)}, now_s=now_s))
    assert tasking.claim == 4
    assert not tasking.indicator


@pytest.mark.parametrize(("heard_hops", "hops"), [((0, 1), 1), ((2, 1), 2), ((2, 2), 3), ((3, 3), NO_HOPS)])
def test_who_does_not_lead_is_one_hop_farther_than_its_nearest_neighbour_and_a_path_has_at_most_n_hops(
    heard_hops: tuple[int, int], hops: int
) -> None:
    told = [near(f"r0{k}", 0.1 * k, 0.5, hops=h) for k, h in enumerate(heard_hops, 3)]
    free, occupied = fielded(4), occupying(fielded(4))
    for tasking in (free, occupied):
        tasking.update(look(*told, now_s=1.1))
        assert tasking.hops == hops
    free.update(look(*told, silent=True, now_s=1.2))
    assert free.hops == NO_HOPS, "silent robots lead nobody"


# --- HELP -----------------------------------------------------------------------------------------


def calls(left_m: float, **says: object) -> NeighbourState:
    """r03 on a taut link to the right asks for help, with so much way left."""
    return near(
        "r03", 0.9, 0.0, seq=2, **{"help": Help(robot="r03", hops=0, left_m=left_m), "links_on": ("r02",)} | says
    )


def test_a_free_robot_comes_when_called_and_is_free_again_when_the_call_ends() -> None:
    tasking = fielded()
    assert tasking.update(look(calls(0.2))) == Goal((1.3, -0.3), HELP_STAND_OFF_M, "help")
    assert tasking.helping
    assert tasking.assist.told == Help(robot="r03", hops=1, left_m=0.2)
    tasking.update(look(near("r03", 0.9, 0.0, seq=3), now_s=1.1))
    assert not tasking.helping
    assert tasking.assist.told is None


@pytest.mark.parametrize(("left_m", "helps"), [(0.4, True), (0.9, False)])
def test_a_tracker_comes_to_one_with_less_way_left_and_else_keeps_its_target_and_asks_itself(
    left_m: float, helps: bool
) -> None:
    tasking = fielded()
    tasking.update(look(targets={4: BESIDE}, now_s=0.9))
    tasking.update(look(calls(left_m), targets={4: BESIDE}))
    assert tasking.helping == helps
    assert (tasking.task is Task.FREE) == helps
    expected = Help(robot="r03", hops=1, left_m=0.4) if helps else Help(robot="r02", hops=0, number=1, left_m=0.5)
    assert tasking.assist.told == expected


def test_a_helper_takes_a_target_only_where_that_is_nearer_than_the_way_left_to_the_one_that_asks() -> None:
    for left_m, task in ((0.5, Task.FREE), (0.51, Task.TRACKING)):
        tasking = fielded()
        tasking.update(look(calls(left_m), at=(0.0, 0.0), targets={4: (0.5, 0.0)}))
        assert tasking.task is task


def test_a_robot_that_holds_its_target_passes_a_call_on_without_asking_itself_and_comes_after_its_hold() -> None:
    tasking = occupying(fielded(), 1.0)
    assert tasking.update(look(calls(0.2), now_s=1.5)) is None
    assert not tasking.helping
    assert tasking.assist.told == Help(robot="r03", hops=1, left_m=0.2)
    goal = tasking.update(look(calls(0.2), now_s=2.0))
    assert goal is not None
    assert goal.why == "help"


def test_a_call_that_stays_open_concerns_everybody_but_nobody_goes_to_a_robot_it_does_not_see() -> None:
    tasking = fielded()
    slack = calls(0.2, links_on=())
    for now_s, helps in ((1.0, False), (0.9 + OPEN_S, False), (1.0 + OPEN_S, True)):
        goal = tasking.update(look(slack, now_s=now_s, seen=now_s < 3.0))
        assert tasking.helping == helps
    assert goal is None


def test_silent_robots_call_nobody() -> None:
    tasking = fielded()
    tasking.update(look(calls(0.2), silent=True))
    assert not tasking.helping
    assert tasking.assist.told is None


# --- where a robot without a target goes ----------------------------------------------------------


@pytest.mark.parametrize("make", [fielded, papered])
def test_before_anything_is_seen_it_goes_on_into_the_start_direction(make: Callable[[], Tasking]) -> None:
    tasking = make()
    goal = tasking.update(look())
    assert goal is not None
    assert goal[1:] == (0.0, "start")
    assert goal.point == pytest.approx((HERE[0] + LEAD_M * math.cos(2.0), HERE[1] + LEAD_M * math.sin(2.0)))


@pytest.mark.parametrize(
    ("told", "towards"),
    [
        ([near("r03", 0.6, 0.0, hops=1), near("r04", 0.0, 0.7, hops=0)], "r04"),
        ([near("r03", 0.6, 0.0, hops=1), near("r04", 0.0, 0.7, hops=1)], "r03"),
        ([near("r03", 0.6, 0.0)], None),
    ],
    ids=["fewest hops", "the nearest of equals", "none knows one"],
)
def test_a_free_robot_of_the_field_profile_follows_the_neighbour_with_fewest_hops(
    told: list[NeighbourState], towards: str | None
) -> None:
    tasking = fielded()
    tasking.memory.occupy(9)
    tasking.cloud_seen = True
    goal = tasking.update(look(*told))
    places = {s.robot: (s.x_m, s.y_m) for s in told}
    assert goal == (None if towards is None else Goal(places[towards], STAND_OFF_M, "indicator"))


def test_nobody_follows_one_that_is_no_nearer_to_an_indicator_or_out_of_sight_or_silent() -> None:
    leader, follower = near("r03", 0.6, 0.0, hops=0), near("r04", 0.0, 0.7, hops=1)
    view = look(leader, follower)
    both, unseen, silent = view, view._replace(sighted={"r04": view.sighted["r04"]}), look(leader, silent=True)
    for shown, goal in ((both, Goal((1.0, -0.3), STAND_OFF_M, "indicator")), (unseen, None), (silent, None)):
        tasking = fielded()
        tasking.memory.occupy(9)
        tasking.cloud_seen = True
        assert tasking.update(shown) == goal


def test_with_an_occupied_target_but_no_cloud_seen_nor_leader_it_goes_on_into_the_start_direction() -> None:
    tasking = fielded()
    tasking.memory.occupy(9)
    goal = tasking.update(look())
    assert goal is not None
    assert goal.why == "start"


@pytest.mark.parametrize(
    ("told", "towards"),
    [
        ([near("r03", 0.6, 0.0, indicator=True), near("r04", 0.0, 0.5, indicator=True)], "r04"),
        ([near("r03", 0.6, 0.0, indicator=True), near("r04", 0.0, 0.5, hops=0)], "r03"),
        ([near("r03", 0.6, 0.0, hops=0)], None),
    ],
    ids=["the nearest", "not one that only tracks", "none"],
)
@pytest.mark.parametrize("occupied", [False, True])
def test_by_the_letter_a_free_robot_follows_the_nearest_indicator_in_sight(
    told: list[NeighbourState], towards: str | None, occupied: bool
) -> None:
    tasking = papered()
    tasking.cloud_seen = True
    if occupied:
        tasking.memory.occupy(9)
    goal = tasking.update(look(*told))
    places = {s.robot: (s.x_m, s.y_m) for s in told}
    assert goal == (None if towards is None else Goal(places[towards], STAND_OFF_M, "indicator"))
    assert tasking.update(look(*told, silent=True)) is None


def test_the_letter_neither_steps_aside_nor_stands_between_others_nor_comes_when_called() -> None:
    way = {"task": "tracking", "claim": 1, "claim_at": (HERE[0], HERE[1] + 0.1), "links_on": ("r02",)}
    told = [near("r03", 0.0, 0.9, help=Help(robot="r03", hops=0, left_m=0.1), **way),
            near("r04", 0.0, -0.8, indicator=True, links_on=("r02",))]  # fmt: skip
    assert papered().update(look(*told)) == Goal((told[1].x_m, told[1].y_m), STAND_OFF_M, "indicator")


def test_a_free_robot_stops_near_the_place_between_those_that_pull() -> None:
    tasking = fielded()
    tasking.memory.occupy(9)
    told = [near("r03", 0.0, 0.9, claim=1, claim_at=(HERE[0], HERE[1] + 1.2), hops=0, links_on=("r02",)),
            near("r04", 0.0, -0.8, hops=0, links_on=("r02",))]  # fmt: skip
    goal = tasking.update(look(*told))
    assert goal is not None
    assert goal[1:] == (RELAY_STOP_M, "indicator")
    assert goal.point == pytest.approx((HERE[0], HERE[1] + 0.2), abs=0.06)


@pytest.mark.parametrize("angle_rad", [0.4, 2.0, -1.0, -2.5])
def test_out_of_the_way_is_straight_away_from_the_nearest_target_that_another_tracks(angle_rad: float) -> None:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    nearest, other = ((HERE[0] + d * cosine, HERE[1] + d * sine) for d in (0.1, -0.2))
    told = [near(f"r0{k}", 0.4 * k - 1.0, 0.6, task="tracking", claim=k, claim_at=place)
            for k, place in ((3, other), (4, nearest), (5, other))]  # fmt: skip
    goal = fielded(6).update(look(*told))
    assert goal is not None
    assert goal[1:] == (0.0, "aside")
    assert goal.point == pytest.approx((nearest[0] - ASIDE_M * cosine, nearest[1] - ASIDE_M * sine))
    silent = fielded(6).update(look(*told, silent=True))
    assert silent is not None
    assert silent.why == "start"
