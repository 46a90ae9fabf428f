"""One law per equation of the paper; PAPER.md names them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard import unicycle
from onboard.ahdc import behaviour, cotr, expansion, neighbours, preservation, topology
from onboard.ahdc.cotr import Event, Task
from onboard.ahdc.paper_law import PaperLaw
from onboard.ahdc.parameters import Parameters
from onboard.ahdc.plan import Motion
from onboard.ahdc.view import Goal, Heard, Sighted, View
from tests.onboard.samples import paper_parameters, state

R_C, R_N, EPSILON = 1.0, 0.8, 0.2
coordinate = st.floats(-2, 2, allow_nan=False, width=32)
points = st.tuples(coordinate, coordinate)
names = st.sampled_from([f"r{k:02d}" for k in range(2, 12)])
swarms = st.dictionaries(names, points, max_size=9)
angles = st.floats(-math.pi, math.pi)
graphs = st.dictionaries(names, st.sets(names), max_size=9)


def turned(point: tuple[float, float], angle: float, shift: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    c, s = math.cos(angle), math.sin(angle)
    return (c * point[0] - s * point[1] + shift[0], s * point[0] + c * point[1] + shift[1])


@given(angles, angles, st.floats(0.001, 2))
def test_eq_1_body_follows_the_velocity(direction: float, heading: float, speed: float) -> None:
    wanted = (speed * math.cos(direction), speed * math.sin(direction))
    v, omega = unicycle.steer(wanted, heading)
    along = wanted[0] * math.cos(heading) + wanted[1] * math.sin(heading)
    assert v == pytest.approx(along, abs=1e-9)
    assert abs(v) <= speed + 1e-12
    later = heading + 1e-3 * omega
    assert abs(math.sin(direction - later)) <= abs(math.sin(direction - heading)) + 1e-12
    assert unicycle.steer((0.0, 0.0), heading) == (0.0, 0.0)
    assert unicycle.steer(wanted, heading, 9.0) == (v, pytest.approx(1.5 * omega))


@given(st.floats(0.0, 1 / 6), st.floats(0.05, 1.5))
def test_a_body_whose_turn_lags_by_the_delay_hardly_overshoots(delay_s: float, error: float) -> None:
    gain = unicycle.turn_gain_per_s(delay_s)
    assert 6.0 <= gain <= 9.0
    rate, worst, dt = 0.0, 0.0, 1e-3
    left = error
    for _ in range(1500):
        _, wanted = unicycle.steer((1.0, 0.0), -left, gain)
        rate += (wanted - rate) * min(1.0, dt / max(delay_s, dt))
        left -= rate * dt
        worst = max(worst, -left)
    assert worst <= 0.18 * error
    assert abs(left) < 0.05 * error


def test_fast_motors_turn_faster_and_slow_ones_as_before() -> None:
    assert unicycle.turn_gain_per_s(0.02) == 9.0
    assert unicycle.turn_gain_per_s(0.17) == 6.0


@given(points, points)
def test_eq_2_connection_is_symmetric_and_closed_at_r_c(a: tuple[float, float], b: tuple[float, float]) -> None:
    assert neighbours.connected(math.dist(a, b), R_C) == neighbours.connected(math.dist(b, a), R_C)
    assert neighbours.connected(math.dist(a, b), R_C) == (math.dist(a, b) <= R_C)
    assert neighbours.connected(R_C, R_C)
    assert not neighbours.connected(math.nextafter(R_C, 2), R_C)


@given(points, swarms)
def test_eq_3_4_critical_and_noncritical_split_the_neighbours(
    own: tuple[float, float], others: dict[str, tuple[float, float]]
) -> None:
    distances = neighbours.neighbours(own, others, R_C)
    critical = neighbours.critical_robots(distances, others, R_N)
    noncritical = neighbours.noncritical_robots(distances, others, R_N)
    assert critical | noncritical == set(distances)
    assert not critical & noncritical
    for name in critical:
        assert distances[name] > R_N
        assert not any(
            math.dist(own, others[k]) <= R_N and math.dist(others[name], others[k]) <= R_N
            for k in distances
            if k != name
        )


@given(points, swarms)
def test_eq_3_is_symmetric_on_equal_views(own: tuple[float, float], others: dict[str, tuple[float, float]]) -> None:
    mine = neighbours.neighbours(own, others, R_C)
    critical = neighbours.critical_robots(mine, others, R_N)
    for name in mine:
        theirs = {k: p for k, p in others.items() if k != name} | {"me": own}
        distances = neighbours.neighbours(others[name], theirs, R_C)
        assert (name in critical) == ("me" in neighbours.critical_robots(distances, theirs, R_N))


@given(st.dictionaries(names, st.floats(0, R_C)))
def test_eq_5_direct_robots_are_within_r_n(distances: dict[str, float]) -> None:
    direct = neighbours.noncritical_direct(distances, R_N)
    assert all(distances[name] <= R_N for name in direct)
    assert all(distances[name] > R_N for name in set(distances) - direct)


@given(points, swarms)
def test_eq_6_covered_robots_have_a_robot_near_both(
    own: tuple[float, float], others: dict[str, tuple[float, float]]
) -> None:
    distances = neighbours.neighbours(own, others, R_C)
    covered = neighbours.noncritical_covered(distances, others, R_N)
    direct = neighbours.noncritical_direct(distances, R_N)
    for name in distances:
        witness = any(math.dist(others[k], others[name]) <= R_N for k in direct if k != name)
        assert (name in covered) == (name not in direct and witness)


def test_eq_5_6_the_noncritical_area_is_closed_at_r_n() -> None:
    assert neighbours.noncritical_direct({"r02": R_N}, R_N) == {"r02"}
    others = {"r02": (R_N, 0.0), "r03": (0.0, 0.0)}
    assert neighbours.noncritical_covered({"r02": 0.9, "r03": 0.1}, others, R_N) == {"r02"}


@given(st.lists(st.floats(R_N, R_C), max_size=6), st.data())
def test_eq_7_no_run_step_within_the_bound_breaks_a_link(distances: list[float], data: st.DataObject) -> None:
    bound = preservation.run_step_bound_m(distances, R_C, EPSILON)
    assert 0 <= bound <= EPSILON / 2
    for distance in distances:
        theirs = preservation.run_step_bound_m([distance], R_C, EPSILON)
        mine_to, theirs_to = data.draw(angles), data.draw(angles)
        a = (bound * math.cos(mine_to), bound * math.sin(mine_to))
        b = (distance + theirs * math.cos(theirs_to), theirs * math.sin(theirs_to))
        assert math.dist(a, b) <= R_C + 1e-12


@given(st.floats(0, 2))
def test_eq_8_two_half_slacks_never_exceed_r_c(distance: float) -> None:
    half = preservation.pair_run_step_m(distance, R_C)
    assert half >= 0
    assert half == pytest.approx((R_C - distance) / 2) if distance <= R_C else half == 0


@given(st.lists(st.floats(0, 1.2), max_size=6))
def test_eq_9_10_slack_is_bounded_by_epsilon_and_by_every_critical_link(distances: list[float]) -> None:
    slack = preservation.slack_m(distances, R_C, EPSILON)
    assert slack <= EPSILON
    assert all(slack / 2 <= preservation.pair_run_step_m(d, R_C) + 1e-12 for d in distances)
    assert preservation.slack_m([], R_C, EPSILON) == EPSILON


@given(st.dictionaries(names, st.floats(0, math.pi), min_size=1))
def test_eq_11_the_kept_link_has_the_least_angle(theta: dict[str, float]) -> None:
    kept = topology.kept_link(theta)
    assert all(theta[kept] <= angle for angle in theta.values())
    assert all(kept <= name for name, angle in theta.items() if angle == theta[kept])


@given(points, points, angles, angles, points)
def test_theta_is_an_unsigned_angle_that_turns_with_the_frame(
    own: tuple[float, float], other: tuple[float, float], direction: float, turn: float, shift: tuple[float, float]
) -> None:
    goal = (math.cos(direction), math.sin(direction))
    theta = topology.link_angle_rad(own, other, goal)
    assert 0 <= theta <= math.pi
    if math.dist(own, other) > 1e-3:
        moved = topology.link_angle_rad(turned(own, turn, shift), turned(other, turn, shift), turned(goal, turn))
        assert moved == pytest.approx(theta, abs=1e-6)
        along = (own[0] + goal[0], own[1] + goal[1])
        assert topology.link_angle_rad(own, along, goal) == pytest.approx(0, abs=1e-6)


@given(st.sets(names), graphs)
def test_def_3_groups_part_the_links_and_are_joined_without_the_robot(
    links: set[str], graph: dict[str, set[str]]
) -> None:
    both = topology.undirected(graph)
    groups = topology.polygon_groups("me", links, graph)
    assert sorted(name for group in groups for name in group) == sorted(links)
    for group in groups:
        for a in group:
            assert group <= topology.reachable(both, a, {"me"})
            assert not (links - group) & topology.reachable(both, a, {"me"})


@given(st.sets(names, min_size=1), graphs)
def test_def_4_a_chain_link_has_no_other_path(links: set[str], graph: dict[str, set[str]]) -> None:
    for group in topology.polygon_groups("me", links, graph):
        if topology.is_chain(group):
            (only,) = group
            assert not (links - {only}) & topology.reachable(topology.undirected(graph), only, {"me"})
        else:
            assert len(group) > 1


@given(points, points, points, st.tuples(*[st.floats(0, 3)] * 3))
def test_eq_12_is_the_weighted_sum_saturated_at_u_max(
    c: tuple[float, float], s: tuple[float, float], a: tuple[float, float], weights: tuple[float, float, float]
) -> None:
    u = behaviour.velocity((c, s, a), weights, 0.8)
    total = tuple(sum(w * part[k] for w, part in zip(weights, (c, s, a), strict=True)) for k in (0, 1))
    length = math.hypot(*total)
    assert math.hypot(*u) == pytest.approx(0.8 * min(1.0, length), abs=1e-9)
    assert u[0] * total[1] == pytest.approx(u[1] * total[0], abs=1e-6)


@given(points, swarms)
def test_cohesion_points_into_the_neighbours(own: tuple[float, float], others: dict[str, tuple[float, float]]) -> None:
    u = behaviour.cohesion(own, others.values(), R_C)
    if not others:
        assert u == (0.0, 0.0)
        return
    middle = [sum(p[k] for p in others.values()) / len(others) for k in (0, 1)]
    assert u == pytest.approx(((middle[0] - own[0]) / R_C, (middle[1] - own[1]) / R_C))


@given(angles, angles, st.floats(0.05, 0.45), st.floats(0.05, 0.45))
def test_separation_pushes_away_and_grows_when_nearer(bearing: float, ahead: float, near: float, far: float) -> None:
    near, far = sorted((near, far))
    towards = (math.cos(bearing), math.sin(bearing))
    course = (math.cos(ahead), math.sin(ahead))
    pushes = [behaviour.separation((0, 0), [(d * towards[0], d * towards[1])], course, 0.2) for d in (near, far)]
    for u in pushes:
        assert u[0] * towards[0] + u[1] * towards[1] <= 0
        assert math.hypot(*u) <= 1 + 1e-12
    assert math.hypot(*pushes[0]) >= math.hypot(*pushes[1]) - 1e-9
    assert math.hypot(*behaviour.separation((0, 0), [(0.0, 0.0)], course, 0.2)) > 0


@given(points, st.lists(points, max_size=4), angles, angles, points)
def test_separation_does_not_know_the_frame_nor_the_order_of_the_others(
    own: tuple[float, float],
    ways: list[tuple[float, float]],
    ahead: float,
    turn: float,
    shift: tuple[float, float],
) -> None:
    others = [(own[0] + 0.19 * x, own[1] + 0.19 * y) for x, y in ways if math.hypot(x, y) > 1e-3]
    course = (math.cos(ahead), math.sin(ahead))
    u = behaviour.separation(own, others, course, 0.1)
    moved = [turned(other, turn, shift) for other in reversed(others)]
    turned_u = behaviour.separation(turned(own, turn, shift), moved, turned(course, turn), 0.1)
    assert turned_u == pytest.approx(turned(u, turn), abs=1e-6)


@pytest.mark.parametrize(("bearing", "weight"), [(0.0, 1.0), (math.pi / 2, 0.75), (-math.pi / 2, 0.75), (math.pi, 0.5)])
def test_separation_fades_beyond_r_a_is_half_as_strong_to_the_rear_and_steps_to_the_right(
    bearing: float, weight: float
) -> None:
    towards = (math.cos(bearing), math.sin(bearing))
    near, far = [(d * towards[0], d * towards[1]) for d in (0.25, 0.51)]
    u = behaviour.separation((0.0, 0.0), [far, near], (1.0, 0.0), 0.2)
    push = weight * math.exp(-30.0 * 0.05)
    away, right = (-push * towards[0], -push * towards[1]), (push * towards[1], -push * towards[0])
    assert u == pytest.approx((away[0] + 0.3 * right[0], away[1] + 0.3 * right[1]))


def test_separation_grows_no_more_deep_inside_r_a() -> None:
    edge = 0.2 - 5.0 / 30.0 + 1e-7
    assert behaviour.separation((0.0, 0.0), [(-0.02, 0.0), (edge, 0.0)], (0.0, 0.0), 0.2) == pytest.approx(
        (0.0, 0.0), abs=1e-3
    )


def test_coincident_robots_part_as_if_the_other_were_a_hair_ahead_along_x() -> None:
    for course in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        hair = behaviour.separation((0.0, 0.0), [(1e-6, 0.0)], course, 0.001)
        assert behaviour.separation((0.0, 0.0), [(0.0, 0.0)], course, 0.001) == pytest.approx(hair, abs=1e-4)


@given(points, points)
def test_alignment_points_to_the_goal(own: tuple[float, float], goal: tuple[float, float]) -> None:
    u = behaviour.alignment(own, goal)
    distance = math.dist(own, goal)
    if distance > 1e-6:
        assert math.hypot(*u) == pytest.approx(1.0)
        assert u[0] * (goal[0] - own[0]) + u[1] * (goal[1] - own[1]) == pytest.approx(distance, rel=1e-6)
    else:
        assert math.hypot(*u) <= 1


def test_alignment_is_a_unit_vector_and_naught_at_the_goal() -> None:
    assert behaviour.alignment((1.0, 1.0), (4.0, 5.0)) == pytest.approx((0.6, 0.8))
    assert behaviour.alignment((1.0, 1.0), (1.0, 1.0)) == (0.0, 0.0)


@given(points, st.floats(0.01, 3.0))
def test_saturation_shortens_and_never_turns(vector: tuple[float, float], limit: float) -> None:
    length = math.hypot(*vector)
    share = min(1.0, limit / length) if length else 1.0
    assert behaviour.saturate(vector, limit) == pytest.approx((share * vector[0], share * vector[1]))


@given(st.lists(st.floats(R_N, R_C), max_size=5), st.floats(0.001, 1))
def test_eq_13_is_eq_7_over_the_time_step(distances: list[float], run_step_s: float) -> None:
    bound = preservation.speed_bound_mps(distances, R_C, EPSILON, run_step_s)
    assert bound * run_step_s == pytest.approx(preservation.run_step_bound_m(distances, R_C, EPSILON))
    if not distances:
        assert bound == pytest.approx(EPSILON / (2 * run_step_s))


@given(
    points,
    st.dictionaries(names, points, min_size=1, max_size=6),
    graphs,
    angles,
    st.dictionaries(names, st.sets(st.sampled_from(["me", "r02"]))),
)
def test_eq_14_removal_needs_both_ends_and_never_the_kept_link(
    own: tuple[float, float],
    critical: dict[str, tuple[float, float]],
    graph: dict[str, set[str]],
    direction: float,
    wishes: dict[str, set[str]],
) -> None:
    goal = (math.cos(direction), math.sin(direction))
    wished = expansion.wished_removals("me", own, critical, critical, graph, goal)
    removed = expansion.removable_links("me", wished, wishes)
    for group in topology.polygon_groups("me", critical, graph):
        theta = {name: topology.link_angle_rad(own, critical[name], goal) for name in group}
        assert group - wished == {topology.kept_link(theta)}
    assert removed == {name for name in wished if "me" in wishes.get(name, ())}
    assert expansion.consent("me", wished, wishes) == removed


def test_a_way_through_the_robot_itself_joins_no_links_and_each_group_gives_up_its_own() -> None:
    here = {"r02": (0.9, 0.1), "r03": (0.9, -0.1), "r04": (-0.9, 0.1), "r05": (-0.9, -0.1)}
    through_me = {name: {"me"} for name in here}
    assert expansion.wished_removals("me", (0.0, 0.0), here, here, through_me, (0.0, 1.0)) == set()
    pairs = through_me | {"r02": {"me", "r03"}, "r04": {"me", "r05"}}
    assert expansion.wished_removals("me", (0.0, 0.0), here, here, pairs, (0.0, 1.0)) == {"r03", "r05"}


def view(sighted: dict[str, Sighted], heard: dict[str, Heard] | None = None) -> View:
    return View(0.0, Motion(0.0, 0.0, 0.0, 0.0, 0.0), sighted, heard or {}, {}, 0.0, True)


def test_algorithm_1_stops_without_a_goal_and_bounds_with_critical_robots() -> None:
    parameters: Parameters = paper_parameters()
    law = PaperLaw("r01", parameters)
    goal = Goal((3.0, 0.0), 0.0, "target")
    assert law.velocity(view({}), None) == (0.0, 0.0)
    assert math.hypot(*law.velocity(view({}), goal)) == pytest.approx(parameters.max_speed_mps)
    almost = Sighted(-0.999, 0.0, 0.0, 0.0, 0.0, True)
    bounded = law.velocity(view({"r02": almost}), goal)
    assert law.kept == {"r02"}
    assert math.hypot(*bounded) == pytest.approx(0.001 / (2 * parameters.run_step_s))
    two = {"r02": Sighted(-0.9, 0.3, 0.0, 0.0, 0.0, True), "r03": Sighted(-0.9, -0.3, 0.0, 0.0, 0.0, True)}
    heard = {
        "r02": Heard(state("r02", links_on=("r01", "r03"), wishes=("r01",)), 0.0, False),
        "r03": Heard(state("r03", links_on=("r01", "r02")), 0.0, False),
    }
    law.velocity(view(two, heard), Goal((0.0, -3.0), 0.0, "target"))
    assert law.wishes == {"r02"}
    assert law.kept == {"r03"}


def test_algorithm_1_keeps_critical_links_where_it_stops_and_bounds_nothing_for_a_covered_robot() -> None:
    law = PaperLaw("r01", paper_parameters())
    assert law.neighbours == law.wishes == law.kept == set(), "what it may tell before its first step"
    far, between = Sighted(-0.9, 0.0, 0.0, 0.0, 0.0, True), Sighted(-0.45, 0.0, 0.0, 0.0, 0.0, True)
    for goal in (None, Goal((0.5, 0.0), 0.5, "indicator")):
        assert law.velocity(view({"r02": far}), goal) == (0.0, 0.0)
        assert law.kept == {"r02"}
    law.velocity(view({"r02": far, "r03": between}), Goal((3.0, 0.0), 0.0, "target"))
    assert law.kept == set(), "r03 is near both"
    assert law.neighbours == {"r02", "r03"}


def test_algorithm_1_removes_no_link_joined_to_others_by_the_robot_itself_alone() -> None:
    law = PaperLaw("r01", paper_parameters())
    two = {"r02": Sighted(-0.9, 0.3, 0.0, 0.0, 0.0, True), "r03": Sighted(0.9, -0.3, 0.0, 0.0, 0.0, True)}
    heard = {name: Heard(state(name, links_on=("r01",), wishes=("r01",)), 0.0, False) for name in two}
    law.velocity(view(two, heard), Goal((0.0, -3.0), 0.0, "target"))
    assert law.wishes == set()
    assert law.kept == {"r02", "r03"}


EXPECTED = {
    (Task.FREE, Event.OBSERVED): Task.TRACKING,
    (Task.TRACKING, Event.REACHED): Task.OCCUPIED,
    (Task.TRACKING, Event.LOST): Task.FREE,
    (Task.OCCUPIED, Event.HELD): Task.FREE,
}


def test_algorithm_2_over_the_full_product_of_states_and_events() -> None:
    for task in Task:
        for event in Event:
            assert cotr.transition(task, event) is EXPECTED.get((task, event), task)


@given(points, st.dictionaries(st.integers(0, 30), points))
def test_algorithm_2_line_4_takes_the_nearest_target(
    own: tuple[float, float], targets: dict[int, tuple[float, float]]
) -> None:
    chosen = cotr.nearest_target(own, targets)
    assert (chosen is None) == (not targets)
    if chosen is not None:
        assert all(math.dist(own, targets[chosen]) <= math.dist(own, p) for p in targets.values())


@given(st.sampled_from(Task), st.sets(st.integers(0, 5)), st.one_of(st.none(), st.integers(0, 5)))
def test_algorithm_2_lines_10_11_an_indicator_sees_another_target(
    task: Task, seen: set[int], tracked: int | None
) -> None:
    targets = dict.fromkeys(seen, (0.0, 0.0))
    assert cotr.is_indicator(task, tracked, targets) == (task is not Task.FREE and bool(seen - {tracked}))
