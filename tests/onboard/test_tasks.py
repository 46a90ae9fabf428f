"""COTR's field additions: yielding, choice by reachability, memory, HELP."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

import onboard.ahdc.memory as memories
from contract.messages import Help, NeighbourState
from onboard.ahdc.assist import LIMIT_S, OPEN_S, PATIENCE_S, Assist
from onboard.ahdc.cotr import TIE_M, Claim, Task, reachable_target, spanning_excess_m, yields
from onboard.ahdc.memory import TargetMemory, from_hex, to_hex
from onboard.ahdc.plan import Motion
from onboard.ahdc.relay import middle, relay_point
from onboard.ahdc.tasking import NO_HOPS, Tasking
from onboard.ahdc.view import Heard, Sighted, View
from tests.onboard.samples import field_parameters, state

coordinate = st.floats(-3, 3)
points = st.tuples(coordinate, coordinate)
distances = st.floats(0.1, 3).map(lambda x: round(x, 3))


@given(st.floats(0, 2), st.floats(0, 2))
@example(TIE_M, 0.0)
@example(0.0, TIE_M)
def test_of_two_robots_on_one_target_exactly_one_yields(mine: float, theirs: float) -> None:
    first = yields("r01", mine, [Claim("r02", 7, theirs)], 7)
    second = yields("r02", theirs, [Claim("r01", 7, mine)], 7)
    assert first != second
    assert not yields("r01", mine, [Claim("r02", 8, theirs)], 7)


@given(st.lists(points, max_size=7), st.floats(0.1, 1))
def test_the_spanning_excess_is_zero_for_close_points_and_frame_free(
    cloud: list[tuple[float, float]], free: float
) -> None:
    excess = spanning_excess_m(cloud, free)
    assert excess >= 0
    moved = [(-y + 1, x - 2) for x, y in cloud]
    assert math.isclose(spanning_excess_m(moved, free), excess, abs_tol=1e-6)
    assert spanning_excess_m(cloud, 100.0) == 0


@given(st.lists(points, max_size=7), st.floats(0.1, 1))
def test_the_spanning_excess_is_that_of_the_shortest_tree(cloud: list[tuple[float, float]], free: float) -> None:
    pairs = itertools.combinations(range(len(cloud)), 2)
    tree = list(range(len(cloud)))
    excess = 0.0
    for gap, one, other in sorted((math.dist(cloud[one], cloud[other]), one, other) for one, other in pairs):
        if tree[one] != tree[other]:
            excess += max(0.0, gap - free)
            tree = [tree[one] if root == tree[other] else root for root in tree]
    assert spanning_excess_m(cloud, free) == pytest.approx(excess, abs=1e-9)


def reachable(
    own: tuple[float, float],
    targets: dict[int, tuple[float, float]],
    anchors: list[tuple[float, float]],
    radius_m: float,
    middle: tuple[float, float] | None = None,
) -> int | None:
    """The choice among all of them."""
    options = sorted((math.dist(own, place), index) for index, place in targets.items())
    return reachable_target(own, targets, options, anchors, radius_m, middle)


def test_where_no_target_is_open_none_is_chosen() -> None:
    assert reachable((0.0, 0.0), {}, [(1.0, 0.0)], 0.98) is None


def test_of_targets_that_cost_the_same_the_one_of_lower_index_is_chosen() -> None:
    outer, inner = (-1.5, 0.0), (0.5, 0.0)
    assert reachable((0.0, 0.0), {0: outer, 1: inner}, [], 0.98, inner) == 0
    assert reachable((0.0, 0.0), {1: outer, 0: inner}, [], 0.98, inner) == 0


def test_a_target_is_no_better_for_being_far_from_the_others() -> None:
    targets = {0: (0.4, 0.0), 1: (-0.45, 0.0), 2: (-0.025, -3.0)}
    as_far_from_both = (-0.025, 0.0)
    assert reachable((0.0, 0.0), targets, [(0.1, 0.6)], 0.98, as_far_from_both) == 0


@given(st.dictionaries(st.integers(0, 20), points, min_size=1), points)
def test_without_anchors_the_nearest_target_is_chosen(
    targets: dict[int, tuple[float, float]], own: tuple[float, float]
) -> None:
    chosen = reachable(own, targets, [], 0.98)
    assert all(math.dist(own, targets[chosen]) <= math.dist(own, p) for p in targets.values())


def test_a_target_that_stretches_the_swarm_costs_more_than_a_farther_one_within_it() -> None:
    anchors = [(0.0, 0.0), (0.0, 0.8)]
    assert reachable((0.5, 0.4), {0: (1.4, 0.4), 1: (-0.6, 0.4)}, anchors, 0.98) == 1


def test_a_target_that_another_will_be_nearer_to_is_left_to_it() -> None:
    targets = {0: (0.4, 0.0), 1: (-0.45, 0.0)}
    assert reachable((0.0, 0.0), targets, [], 0.98) == 0
    assert reachable((0.0, 0.0), targets, [(0.4, 0.0)], 0.98) == 1
    assert reachable((0.0, 0.0), targets, [(0.4, 0.0), (-0.45, 0.1)], 0.98) == 0


def test_of_two_targets_the_outer_is_taken_first_unless_it_is_much_farther() -> None:
    def chosen(outer_m: float) -> int | None:
        return reachable((0.0, 0.0), {0: (0.3, 0.0), 1: (-outer_m, 0.0)}, [], 0.98, (1.0, 0.0))

    assert chosen(0.5) == 1
    assert chosen(0.8) == 1
    assert chosen(1.2) == 0


@given(
    st.dictionaries(st.integers(0, 9), points, min_size=1, max_size=6),
    points,
    st.lists(points, max_size=4),
    points,
    st.floats(0.3, 2.0),
)
def test_the_search_that_ends_early_finds_the_least_cost(
    targets: dict[int, tuple[float, float]],
    own: tuple[float, float],
    anchors: list[tuple[float, float]],
    middle: tuple[float, float],
    radius: float,
) -> None:
    def cost(index: int) -> float:
        place = targets[index]
        farther = max(0.0, math.dist(own, place) - min((math.dist(place, a) for a in anchors), default=math.inf))
        stretch = spanning_excess_m([place, *anchors], 0.9 * radius)
        return math.dist(own, place) + 2 * stretch + 0.6 * farther - 0.5 * math.dist(place, middle)

    chosen = reachable(own, targets, anchors, radius, middle)
    assert cost(chosen) == pytest.approx(min(cost(k) for k in targets), abs=1e-9)


@pytest.mark.parametrize(("occupied", "why"), [(False, "start"), (True, "indicator")])
def test_robots_without_a_target_go_on_into_the_start_direction_until_one_is_occupied(occupied: bool, why: str) -> None:
    told = state("r02", 0.5, 0.0, claim=0, claim_at=(1.2, 0.0), task="tracking", cloud_seen=True, hops=0)
    tasking = Tasking("r01", field_parameters(3))
    if occupied:
        tasking.memory.occupy(3)
    goal = tasking.update(looking({"r02": told}))
    assert goal is not None
    assert goal.why == why


@given(st.sets(st.integers(0, 600)))
def test_occupied_bitmaps_survive_the_wire(indices: set[int]) -> None:
    memory = TargetMemory()
    for index in indices:
        memory.occupy(index)
    assert from_hex(to_hex(memory.occupied)) == memory.occupied
    assert {k for k in range(601) if not memory.is_open(k)} == indices


def test_memory_keeps_what_was_seen_until_it_is_occupied() -> None:
    memory = TargetMemory()
    memory.see(3, (1.0, 2.0))
    memory.see(4, (2.0, 2.0))
    memory.merge(1 << 3)
    assert memory.open == {4: (2.0, 2.0)}


def test_help_is_asked_for_after_the_patience_and_given_up_after_the_limit() -> None:
    assist = Assist("r02", robots=4)
    assist.start_tracking(0.0)
    assert not assist.track(1.0, 0.0)
    assert not assist.track(0.9, 1.0)
    assert not assist.track(0.89, 0.99 + PATIENCE_S)
    assert assist.request is None
    assert not assist.track(0.89, 1.01 + PATIENCE_S)
    assert assist.request is not None
    assert not assist.track(0.89, 1.0 + PATIENCE_S + LIMIT_S)
    assert assist.track(0.89, 1.02 + PATIENCE_S + LIMIT_S)


@given(st.lists(st.tuples(st.sampled_from(["r01", "r03", "r04"]), st.integers(0, 5), distances), max_size=5))
def test_the_shortest_way_left_wins_and_hops_stay_below_the_number_of_robots(heard: list[tuple[str, int]]) -> None:
    assist = Assist("r02", robots=4)
    assist.request = Help(robot="r02", hops=0, left_m=0.5)
    told_of = [Help(robot=robot, hops=hops, left_m=left_m) for robot, hops, left_m in heard]
    told_by = {f"r{k:02d}": help_ for k, help_ in enumerate(told_of, 10)}
    assist.listen(told_by.items(), taut=told_by)
    fitting = [(left_m, robot, hops + 1) for robot, hops, left_m in heard if hops + 1 < 4]
    better = min((entry for entry in fitting if entry[:2] < (0.5, "r02")), default=None)
    told = assist.told
    assert told is not None
    assert (told.left_m, told.robot, told.hops) == (better or (0.5, "r02", 0))


def test_a_tracker_nearer_to_its_target_than_the_one_that_asks_keeps_it_and_asks_itself() -> None:
    far = [("r03", Help(robot="r01", hops=0, left_m=2.4))]
    nearer, level, farther, idle = (Assist("r02", robots=4) for _ in range(4))
    nearer.listen(far, 0.4, 1.0, ["r03"])
    assert nearer.heard is None
    assert nearer.via == ""
    assert nearer.told == Help(robot="r02", hops=0, number=1, left_m=0.4)
    level.listen(far, 2.4, 1.0, ["r03"])
    farther.listen(far, 2.5, 1.0, ["r03"])
    idle.listen(far, taut=["r03"])
    assert level.via == farther.via == idle.via == "r03"
    assert level.request is farther.request is None


def test_a_request_made_on_hearing_another_runs_out_like_any_other() -> None:
    assist = Assist("r02", robots=4)
    assist.start_tracking(1.0)
    assist.listen([("r03", Help(robot="r01", hops=0, left_m=2.4))], 0.4, 1.0, ["r03"])
    assert not assist.track(0.4, 0.9 + LIMIT_S)
    assert assist.track(0.4, 1.1 + LIMIT_S)


def test_each_request_has_a_number_of_its_own_and_a_robot_that_has_stopped_tracking_tells_none() -> None:
    assist = Assist("r02", robots=4)
    numbers = []
    for start_s in (0.0, 10.0, 20.0):
        assist.start_tracking(start_s)
        assist.track(0.5, start_s)
        assist.track(0.5, start_s + 2 * PATIENCE_S)
        assert assist.told is not None
        numbers.append(assist.told.number)
        assist.stop_tracking()
        assert assist.told is None
    assert len(set(numbers)) == 3


@pytest.mark.parametrize(
    ("hops", "taut", "via"),
    [
        ((0, 0), ("r04",), "r04"),
        ((0, 1), ("r03", "r04"), "r03"),
        ((1, 0), ("r03", "r04"), "r04"),
        ((0, 0), ("r03", "r04"), "r03"),
    ],
    ids=["over the taut link", "nearer first", "nearer last", "as near: the lower id"],
)
def test_of_two_that_pass_on_one_request_it_goes_to_the_one_nearer_to_who_asks(
    hops: tuple[int, int], taut: tuple[str, ...], via: str
) -> None:
    assist = Assist("r02", robots=6)
    told = zip(("r03", "r04"), (Help(robot="r01", hops=n, left_m=0.4) for n in hops), strict=True)
    assist.listen(told, now_s=1.0, taut=taut)
    assert assist.via == via
    assert assist.told == Help(robot="r01", hops=min(hops) + 1, left_m=0.4)


@pytest.mark.parametrize(("own_m", "task"), [(0.05, Task.TRACKING), (0.16, Task.TRACKING), (0.18, Task.FREE)])
def test_a_helper_nearer_to_a_target_than_the_one_that_asks_takes_it_instead_of_blocking_it(
    own_m: float, task: Task
) -> None:
    tasking = Tasking("r02", field_parameters(6))
    request = Help(robot="r06", hops=0, left_m=0.17)
    told = state("r06", 0.95, claim=0, claim_at=(0.23, 0.0), task="tracking", help=request, links_on=("r02",))
    view = View(
        now_s=1.0,
        motion=Motion(0.23 - own_m, 0.0, 0.0, 0.0, 0.0),
        sighted={"r06": Sighted(0.95, 0.0, 0.0, 0.0, 0.0, True)},
        heard={"r06": Heard(told, 0.0, False)},
        targets={0: (0.23, 0.0)},
        start_direction_rad=0.0,
        may_move=True,
    )
    tasking.update(view)
    assert tasking.task is task
    assert tasking.helping == (task is Task.FREE)


@pytest.mark.parametrize(
    ("heard_hops", "hops"), [(NO_HOPS, NO_HOPS), (NO_HOPS - 1, NO_HOPS), (NO_HOPS - 2, NO_HOPS - 1)]
)
def test_in_a_swarm_of_thousands_no_hop_count_leaves_what_a_message_can_say(heard_hops: int, hops: int) -> None:
    parameters = dataclasses.replace(field_parameters(2), robots=3 * NO_HOPS)
    tasking = Tasking("r02", parameters)
    asked = Help(robot="r09", hops=heard_hops - 1, left_m=0.2)
    told = state("r06", 0.9, hops=heard_hops, help=asked, links_kept=("r02",))
    sighted = {"r06": Sighted(0.9, 0.0, 0.0, 0.0, 0.0, True)}
    view = View(1.0, Motion(0.0, 0.0, 0.0, 0.0, 0.0), sighted, {"r06": Heard(told, 0.0, False)}, {}, 0.0, True)
    tasking.update(view)
    assert tasking.hops == hops
    assert tasking.assist.told == replace(asked, hops=heard_hops)


@pytest.mark.parametrize("asked", [None, Help(robot="r06", hops=0, left_m=0.1)])
@pytest.mark.parametrize(
    ("task", "place", "goal"),
    [
        ("tracking", (0.1, 0.0), (-0.25, 0.0)),
        ("tracking", (0.0, -0.29), (0.0, 0.06)),
        ("tracking", (0.0, 0.0), (0.35, 0.0)),
        ("tracking", (0.31, 0.0), None),
        ("occupied", (0.1, 0.0), None),
    ],
)
def test_a_robot_without_a_target_keeps_clear_of_one_that_another_tracks(
    task: str, place: tuple[float, float], goal: tuple[float, float] | None, asked: Help | None
) -> None:
    """Even one that is asked for help: a robot that has given the target up stands right before it."""
    told = state("r06", 0.3, 0.3, task=task, claim=4, claim_at=place, links_on=("r02",), help=asked)
    sighted = {"r06": Sighted(0.3, 0.3, 0.0, 0.0, 0.0, True)}
    view = View(1.0, Motion(0.0, 0.0, 0.0, 0.0, 0.0), sighted, {"r06": Heard(told, 0.0, False)}, {}, 0.0, True)
    found = Tasking("r02", field_parameters(2)).update(view)
    aside = found.point if found is not None and found.why == "aside" else None
    assert aside == (None if goal is None else pytest.approx(goal))


def test_a_request_from_the_farthest_hop_goes_no_farther() -> None:
    assist = Tasking("r02", dataclasses.replace(field_parameters(2), robots=3 * NO_HOPS)).assist
    assist.listen([("r06", Help(robot="r09", hops=NO_HOPS, left_m=0.2))], taut=["r06"])
    assert assist.told is None


def test_a_request_dies_out_when_its_robot_falls_silent() -> None:
    robots = {name: Assist(name, robots=5) for name in ("r02", "r03", "r04", "r05")}
    told: dict[str, Help | None] = {
        "r02": Help(robot="r01", hops=1),
        "r03": Help(robot="r01", hops=2),
        "r04": None,
        "r05": None,
    }
    for _ in range(6):
        for name, assist in robots.items():
            heard = [(other, help_) for other, help_ in told.items() if other != name and help_ is not None]
            assist.listen(heard, taut=robots)
        told = {name: assist.told for name, assist in robots.items()}
    assert set(told.values()) == {None}


def test_a_request_concerns_those_on_taut_links_and_after_a_while_everybody() -> None:
    asked = [("r03", Help(robot="r01", hops=0, number=1, left_m=0.4))]
    again = [("r03", Help(robot="r01", hops=0, number=2, left_m=0.4))]
    assist = Assist("r02", robots=5)
    assist.listen(asked, now_s=1.0)
    assert assist.heard is None
    assist.listen(asked, now_s=2.0, taut=["r04"])
    assert assist.heard is None
    assist.listen(asked, now_s=3.0, taut=["r03"])
    assert assist.via == "r03"
    assist.listen(asked, now_s=3.1)
    assert assist.via == "r03", "the link is slack again because it helps"
    assist.listen(again, now_s=3.2)
    assert assist.heard is None, "another request, and the link is slack"
    assist.listen(again, now_s=3.1 + OPEN_S)
    assert assist.heard is None
    assist.listen(again, now_s=3.2 + OPEN_S)
    assert assist.via == "r03"
    assist.listen([], now_s=9.0)
    assist.listen(again, now_s=9.1)
    assert assist.heard is None, "not told for a moment: open anew"


@pytest.mark.parametrize(
    ("x_m", "links", "taut"),
    [(0.9, {"links_on": ("r02",)}, True), (0.9, {"links_kept": ("r02",)}, True), (0.9, {"links_on": ("r03",)}, False),
     (0.81, {"links_on": ("r02",)}, True), (0.79, {"links_on": ("r02",)}, False)],
)  # fmt: skip
def test_a_link_is_taut_where_it_is_kept_and_long(x_m: float, links: dict[str, tuple[str, ...]], taut: bool) -> None:
    request = Help(robot="r03", hops=0, left_m=0.1)
    tasking = Tasking("r02", field_parameters(4))
    tasking.update(looking({"r03": state("r03", x_m, help=request, **links)}))
    assert tasking.helping == taut


def looking(heard: dict[str, NeighbourState], now_s: float = 1.0) -> View:
    """A robot at the origin that hears these, sees them where they say they are, and sees no target."""
    sighted = {name: Sighted(told.x_m, told.y_m, 0.0, 0.0, 0.0, True) for name, told in heard.items()}
    ears = {name: Heard(told, 0.0, False) for name, told in heard.items()}
    return View(now_s, Motion(0.0, 0.0, 0.0, 0.0, 0.0), sighted, ears, {}, 0.0, True)


@given(st.lists(points, min_size=1, max_size=6), st.floats(-math.pi, math.pi))
def test_the_middle_is_nearly_that_of_the_smallest_circle(cloud: list[tuple[float, float]], turn: float) -> None:
    x, y = middle(cloud)
    radius = max(math.dist((x, y), point) for point in cloud)
    widest = max(math.dist(one, other) for one in cloud for other in cloud)
    assert widest / 2 - 1e-9 <= radius <= 1.1 * widest / math.sqrt(3) + 1e-9
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = middle([(cosine * a - sine * b + 1, sine * a + cosine * b) for a, b in cloud])
    assert max(math.dist(turned, (cosine * a - sine * b + 1, sine * a + cosine * b)) for a, b in cloud) <= 1.1 * radius


def test_between_two_it_is_midway_and_round_more_it_is_within_a_twentieth_of_the_radius() -> None:
    assert middle([(0.0, 0.0), (1.0, 0.0)]) == pytest.approx((0.5, 0.0), abs=1e-3)
    cloud, radius = [(0.5, 0.5), (0.0, -0.4), (-0.5, 0.8), (0.4, 0.6)], 0.6654
    assert max(math.dist(middle(cloud), point) for point in cloud) <= 1.05 * radius


@pytest.mark.parametrize(
    ("others", "goal"),
    [
        ([("r01", 0.0, 0.9, {"claim": 1, "claim_at": (0.2, 1.2)}), ("r03", 0.0, -0.8, {"hops": 1})], (0.1, 0.2)),
        ([("r01", 0.0, 0.9, {"claim": 1, "claim_at": (0.2, 1.2)}), ("r03", 0.0, -0.8, {"hops": 2})], None),
        ([("r01", 0.0, 0.9, {"hops": 0}), ("r03", 0.0, -0.8, {"hops": 1})], None),
        ([("r01", 0.0, 0.9, {"claim": 1, "claim_at": (0.2, 1.2)}), ("r03", 0.0, -0.8, {"links_on": ()})], None),
        ([("r00", 0.9, 0.0, {"links_on": ()}), ("r01", 0.0, 0.9, {"claim": 1, "claim_at": (0.2, 1.2)}),
          ("r03", 0.0, -0.8, {"hops": 1})], (0.1, 0.2)),
    ],
    ids=["between", "a follower does not hold it back", "nobody is bound for a target", "no link",
         "who keeps no link does not count"],
)  # fmt: skip
def test_a_free_robot_stands_between_those_that_pull(
    others: list[tuple[str, float, float, dict[str, object]]], goal: tuple[float, float] | None
) -> None:
    heard = {name: state(name, x, y, **{"hops": 0, "links_on": ("r02",)} | more) for name, x, y, more in others}
    view = looking(heard)
    found = relay_point(view, "r02", 1)
    if goal is None:
        assert found is None
        return
    assert found is not None
    assert math.dist(found, goal) < 0.06
    tasking = Tasking("r02", field_parameters(4))
    tasking.memory.occupy(9)
    went = tasking.update(view)
    assert went is not None
    assert went.point == found
    assert went.why == "indicator"


def test_what_is_open_follows_what_is_seen_and_what_is_occupied() -> None:
    memory = TargetMemory()
    assert memory.open == {}
    memory.see(3, (1.0, 2.0))
    assert memory.open == {3: (1.0, 2.0)}
    memory.see(3, (1.5, 2.0))
    assert memory.open == {3: (1.5, 2.0)}
    memory.see_all({3: (1.5, 2.0), 5: (0.0, 1.0)})
    assert memory.open == {3: (1.5, 2.0), 5: (0.0, 1.0)}
    memory.merge(0)
    memory.occupy(3)
    assert memory.open == {5: (0.0, 1.0)}
    memory.see(3, (2.0, 2.0))
    assert memory.open == {5: (0.0, 1.0)}
    memory.merge(1 << 5)
    assert memory.open == {}
    assert to_hex(0) == ""


@given(
    st.lists(st.tuples(st.integers(0, 30), points) | st.sets(st.integers(0, 30), max_size=3), max_size=40),
    points,
    st.integers(-1, 30),
)
@pytest.mark.parametrize(("few", "rings"), [(0, 1), (0, 2), (4, memories.RINGS), (memories.FEW, memories.RINGS)])
def test_what_is_asked_of_memory_is_what_a_look_at_all_of_it_gives(
    few: int, rings: int, events: list[tuple[int, tuple[float, float]] | set[int]], own: tuple[float, float], last: int
) -> None:
    """Targets seen, seen elsewhere, occupied, occupied before they are seen."""
    memory, known, occupied = TargetMemory(), {}, set()
    for event in events:
        if isinstance(event, set):
            memory.merge(sum(1 << index for index in event))
            occupied |= event
        else:
            memory.see(*event)
            known[event[0]] = event[1]
    left = {index: place for index, place in known.items() if index not in occupied}
    assert memory.open == left
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memories, "FEW", few)
        patch.setattr(memories, "RINGS", rings)
        assert list(memory.nearest(own)) == sorted((math.dist(own, place), index) for index, place in left.items())
    assert memory.after(last, 3) == (sorted(k for k in left if k > last)[:3] or sorted(left)[:3])
    if left:
        xs, ys = zip(*left.values(), strict=True)
        assert memory.middle() == pytest.approx((sum(xs) / len(xs), sum(ys) / len(ys)), abs=1e-5)


def test_a_target_just_where_the_look_by_cells_ends_is_found_once() -> None:
    memory = TargetMemory()
    memory.see_all({index: (memories.CELL_M * index / 2, 0.0) for index in range(memories.FEW + 5)})
    assert [index for _, index in memory.nearest((0.0, 0.0))] == list(range(memories.FEW + 5))


def test_the_middle_of_targets_told_over_the_wire_is_exact() -> None:
    memory = TargetMemory()
    memory.see_all({0: (0.1, 0.2), 1: (9.0, 9.0), 2: (0.5, 0.4)})
    memory.occupy(1)
    assert memory.middle() == (0.3, 0.3)


def test_a_look_for_the_nearest_of_many_targets_is_no_look_at_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither does the choice by reachability look far: what lies far away stretches the swarm."""
    memory = TargetMemory()
    for index in range(2500):
        memory.see(index, (0.5 * (index % 50), 0.5 * (index // 50)))
    looked: list[int] = []
    ring = TargetMemory._ring
    monkeypatch.setattr(
        TargetMemory, "_ring", lambda me, *cell: (looked.append(index) or index for index in ring(me, *cell))
    )
    own, anchors = (20.2, 12.1), [(20.7, 12.1), (20.2, 11.5)]
    assert list(memory.nearest(own)) == sorted((math.dist(own, place), index) for index, place in memory.open.items())
    looked.clear()
    chosen = reachable_target(own, memory.open, memory.nearest(own), anchors, 0.98, memory.middle())
    assert chosen == reachable(own, memory.open, anchors, 0.98, memory.middle())
    assert 0 < len(looked) < 120
