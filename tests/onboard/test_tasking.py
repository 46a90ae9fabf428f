"""Algorithm 2 on what one robot knows, a step at a time: what it learns, chooses, holds and gives up."""

from collections.abc import Callable

import pytest

from contract.messages import Help, Target, ToldClaim
from onboard.ahdc.assist import LIMIT_S, PATIENCE_S, SKIP_S
from onboard.ahdc.cotr import Task
from onboard.ahdc.parameters import Vector
from onboard.ahdc.tasking import LOCKOUT_S, NO_HOPS, RETHINK_S, Tasking
from onboard.ahdc.view import Goal
from tests.onboard.looks import BESIDE, HERE, fielded, look, near, occupying, papered

# --- what it says before it knows anything, and after it has left ---------------------------------


@pytest.mark.parametrize("make", [fielded, papered])
def test_a_robot_that_knows_nothing_claims_nothing_and_leads_nobody(make: Callable[[], Tasking]) -> None:
    tasking = make()
    assert tasking.task is Task.FREE
    assert (tasking.claim, tasking.claim_at(), tasking.hold_left_s(0.0)) == (None, None, 0.0)
    assert (tasking.hops, tasking.indicator, tasking.helping) == (NO_HOPS, False, False)
    assert (tasking.cloud_seen, tasking.occupied_count) == (False, 0)


def test_a_robot_that_leaves_the_network_claims_nothing_calls_nobody_and_remembers_what_is_occupied() -> None:
    tasking = fielded()
    help_ = Help(robot="r03", hops=0, left_m=0.9)
    tasking.update(look(targets={0: BESIDE, 1: (0.9, -0.3)}))
    tasking.update(look(near("r03", 0.9, 0.0, help=help_, links_on=("r02",), occupied="8"), targets={0: BESIDE}))
    assert tasking.assist.told is not None
    tasking.leave()
    assert tasking.task is Task.FREE
    assert (tasking.claim, tasking.claim_at(), tasking.assist.told) == (None, None, None)
    assert (tasking.hops, tasking.indicator, tasking.helping) == (NO_HOPS, False, False)
    assert tasking.memory.occupied == 0b1000
    tasking.update(look(targets={0: BESIDE}))
    assert tasking.claim == 0, "readmitted"


def test_a_helper_that_leaves_the_network_passes_no_request_on() -> None:
    tasking = fielded()
    tasking.update(look(near("r03", 0.9, 0.0, help=Help(robot="r03", hops=0, left_m=0.1), links_on=("r02",))))
    assert tasking.helping
    tasking.leave()
    assert tasking.assist.told is None
    assert not tasking.helping


# --- observing and tracking -----------------------------------------------------------------------


@pytest.mark.parametrize("make", [fielded, papered])
@pytest.mark.parametrize("now_s", [0.0, 7.0])
def test_a_target_in_sight_is_tracked_at_once_and_claimed(make: Callable[[], Tasking], now_s: float) -> None:
    tasking = make()
    assert tasking.update(look(targets={4: BESIDE}, now_s=now_s)) == Goal(BESIDE, 0.0, "target")
    assert tasking.task is Task.TRACKING
    assert (tasking.claim, tasking.claim_at()) == (4, BESIDE)
    assert tasking.cloud_seen
    assert tasking.hold_left_s(now_s) == 0.0


def test_a_robot_that_may_not_move_learns_but_chooses_nothing() -> None:
    tasking = fielded()
    assert tasking.update(look(targets={4: BESIDE}, may_move=False)) is None
    assert tasking.task is Task.FREE
    assert tasking.memory.open == {4: BESIDE}
    assert not tasking.indicator, "nobody leads others to a target that it does not track"


def test_a_tracker_keeps_its_target_though_a_nearer_one_comes_into_sight() -> None:
    tasking = fielded()
    tasking.update(look(targets={4: BESIDE}))
    for k in range(1, 5):
        goal = tasking.update(look(targets={4: BESIDE, 5: (0.5, -0.3)}, now_s=1.0 + k * RETHINK_S))
        assert goal == Goal(BESIDE, 0.0, "target")


def test_a_free_robot_of_the_field_profile_looks_for_a_target_every_so_often() -> None:
    tasking = fielded()
    tasking.update(look(now_s=1.0))
    tasking.update(look(targets={4: BESIDE}, now_s=1.0 + RETHINK_S / 2))
    assert tasking.task is Task.FREE
    tasking.update(look(targets={4: BESIDE}, now_s=1.0 + RETHINK_S))
    assert tasking.task is Task.TRACKING


def test_the_letter_looks_at_every_step_and_takes_the_nearest_target() -> None:
    tasking = papered()
    tasking.update(look(now_s=1.0))
    tasking.update(look(targets={4: BESIDE, 5: (0.4, -0.6)}, now_s=1.001))
    assert tasking.claim == 5


def test_the_letter_loses_a_target_out_of_sight_and_forgets_it() -> None:
    tasking = papered()
    tasking.update(look(targets={4: BESIDE}, now_s=1.0))
    assert tasking.update(look(targets={4: BESIDE}, now_s=1.1)) == Goal(BESIDE, 0.0, "target")
    assert tasking.update(look(now_s=1.2)) is None
    assert tasking.task is Task.FREE
    assert tasking.claim is None


def test_the_field_profile_goes_on_to_a_target_it_remembers() -> None:
    tasking = fielded()
    tasking.update(look(targets={4: BESIDE}, now_s=1.0))
    assert tasking.update(look(now_s=1.1)) == Goal(BESIDE, 0.0, "target")


@pytest.mark.parametrize("make", [fielded, papered])
def test_a_target_that_another_has_occupied_is_given_up(make: Callable[[], Tasking]) -> None:
    tasking = make()
    tasking.update(look(targets={4: BESIDE}, now_s=1.0))
    tasking.update(look(near("r03", 0.5, 0.5, occupied="10"), targets={4: BESIDE}, now_s=1.1))
    assert tasking.task is Task.FREE
    assert tasking.claim is None
    tasking.update(look(targets={4: BESIDE}, now_s=9.0))
    assert tasking.task is Task.FREE


@pytest.mark.parametrize(
    ("rims", "reached"),
    [((0.0, 0.0), True), ((0.04, 0.04), True), ((0.05, 0.05), False), ((0.06, 0.06), False), ((-0.3, -0.3), False),
     ((0.3, -0.3), True)],
)  # fmt: skip
def test_the_field_profile_reaches_a_target_only_when_slow_and_the_letter_at_any_speed(
    rims: Vector, reached: bool
) -> None:
    for tasking, there in ((fielded(), reached), (papered(), True)):
        tasking.update(look(targets={4: HERE}, now_s=1.0))
        tasking.update(look(targets={4: HERE}, rims=rims, now_s=1.1))
        assert (tasking.task is Task.OCCUPIED) == there
        assert tasking.memory.is_open(4) != there


@pytest.mark.parametrize(("distance_m", "task"), [(0.05, Task.OCCUPIED), (0.051, Task.TRACKING)])
def test_a_target_is_reached_up_to_and_including_the_reach(distance_m: float, task: Task) -> None:
    tasking = fielded()
    for now_s in (1.0, 1.1):
        tasking.update(look(at=(0.0, 0.0), targets={4: (distance_m, 0.0)}, now_s=now_s))
    assert tasking.task is task


# --- holding --------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [fielded, papered])
def test_a_reached_target_is_held_for_its_time_and_then_the_next_is_gone_for_at_once(
    make: Callable[[], Tasking],
) -> None:
    tasking = occupying(make(), 1.0)
    targets = {0: HERE, 1: BESIDE}
    assert tasking.update(look(targets=targets, now_s=1.75)) is None
    assert tasking.hold_left_s(1.75) == pytest.approx(0.25)
    assert tasking.hold_left_s(5.0) == 0.0
    assert tasking.update(look(targets=targets, now_s=2.0)) == Goal(BESIDE, 0.0, "target")
    assert tasking.claim == 1
    tasking.update(look(targets=targets, at=BESIDE, now_s=2.1))
    assert tasking.occupied_count == 2


def test_a_stop_does_not_prolong_the_hold() -> None:
    tasking = occupying(fielded(), 1.0)
    for now_s in (1.3, 1.6):
        assert tasking.update(look(now_s=now_s, may_move=False)) is None
    assert tasking.hold_left_s(1.6) == pytest.approx(0.4)
    tasking.update(look(now_s=2.0))
    assert tasking.task is Task.FREE
    assert tasking.claim is None


def test_an_occupying_robot_claims_what_it_will_go_for_and_thinks_it_over_every_so_often() -> None:
    tasking = occupying(fielded(), 1.0)
    assert (tasking.claim, tasking.claim_at()) == (0, HERE)
    far, nearer = {1: BESIDE}, {1: BESIDE, 2: (0.5, -0.3)}
    tasking.update(look(targets=far, now_s=1.1))
    assert (tasking.claim, tasking.claim_at()) == (1, BESIDE)
    tasking.update(look(targets=nearer, now_s=1.1 + RETHINK_S / 2))
    assert tasking.claim == 1
    tasking.update(look(targets=nearer, now_s=1.1 + RETHINK_S))
    assert tasking.claim == 2


def test_by_the_letter_an_occupying_robot_claims_what_it_sits_on() -> None:
    tasking = occupying(papered(), 1.0)
    tasking.update(look(targets={0: HERE, 1: BESIDE}, now_s=1.5))
    assert tasking.claim == 0


@pytest.mark.parametrize(("other_m", "claim"), [(0.6, 0), (0.8, 1)])
def test_the_hold_that_remains_counts_as_way_towards_the_next_target(other_m: float, claim: int) -> None:
    """0.5 s more at 0.8 m/s and 0.3 m to go: 0.7 m."""
    tasking = occupying(fielded(), 1.0)
    place = (HERE[0] + 0.3, HERE[1])
    other = near("r03", 0.3 + other_m, 0.0, claim=1, claim_at=place)
    tasking.update(look(other, targets={1: place}, now_s=1.5))
    assert tasking.claim == claim


# --- yielding and giving up -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rival", "other_m", "kept"),
    [("r03", 0.4, False), ("r03", 0.6, True), ("r03", 0.5, True), ("r01", 0.5, False), ("r01", 0.6, True)],
)
def test_the_farther_of_two_yields_and_between_equals_the_higher_id(rival: str, other_m: float, kept: bool) -> None:
    """The robot is 0.5 m away. The same rule when it tracks the target already and when it looks for one."""
    other = near(rival, 0.0, 0.5 + other_m, claim=4, claim_at=BESIDE)
    tracks, looks = fielded(), fielded()
    tracks.update(look(targets={4: BESIDE}, now_s=0.9))
    for tasking in (tracks, looks):
        tasking.update(look(other, targets={4: BESIDE}))
        assert (tasking.task is Task.TRACKING) == kept
        assert (tasking.claim == 4) == kept


@pytest.mark.parametrize(("after_s", "task"), [(0.9 * LOCKOUT_S, Task.FREE), (LOCKOUT_S, Task.TRACKING)])
def test_a_yielded_target_is_left_alone_for_a_while_though_its_claim_is_gone(after_s: float, task: Task) -> None:
    tasking = fielded()
    tasking.update(look(targets={4: BESIDE}, now_s=1.0))
    tasking.update(look(near("r01", 0.0, 0.9, claim=4, claim_at=BESIDE), targets={4: BESIDE}, now_s=1.5))
    assert tasking.task is Task.FREE
    tasking.update(look(near("r01", 0.0, 0.9, seq=2), targets={4: BESIDE}, now_s=1.5 + after_s))
    assert tasking.task is task


def test_a_tracker_without_progress_asks_for_help_and_at_last_leaves_the_target_for_a_while() -> None:
    tasking = fielded()

    def at(now_s: float) -> Help | None:
        tasking.update(look(targets={4: BESIDE}, now_s=now_s))
        return tasking.assist.told

    assert at(1.0) is None
    assert at(1.1) is None
    assert at(1.1 + 0.9 * PATIENCE_S) is None
    assert at(2.0) == Help(robot="r02", hops=0, number=1, left_m=0.5)
    assert at(1.9 + LIMIT_S) is not None
    assert at(2.1 + LIMIT_S) is None
    assert tasking.task is Task.FREE
    at(2.0 + LIMIT_S + SKIP_S)
    assert tasking.task is Task.FREE
    at(2.2 + LIMIT_S + SKIP_S)
    assert tasking.claim == 4


# --- choice ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("position", "claim_at", "heard", "chosen"),
    [
        ((0.0, 0.3), None, True, 0),
        ((0.45, 0.0), None, True, 1),
        ((0.45, 0.0), None, False, 1),
        ((0.0, 0.3), (0.45, 0.0), True, 1),
        ((0.45, 0.0), (0.0, 0.3), True, 0),
    ],
    ids=["between both", "stands there", "stands there unheard", "is bound for there", "leaves there"],
)
def test_a_target_is_left_to_the_neighbour_that_will_be_nearer_to_it(
    position: Vector, claim_at: Vector | None, heard: bool, chosen: int
) -> None:
    """Targets 0.4 m to the right and to the left: all else is equal."""
    claim = {} if claim_at is None else {"claim": 9, "claim_at": (HERE[0] + claim_at[0], HERE[1] + claim_at[1])}
    targets = {0: (HERE[0] + 0.4, HERE[1]), 1: (HERE[0] - 0.4, HERE[1])}
    view = look(near("r03", *position, **claim), targets=targets)
    tasking = fielded()
    tasking.update(view if heard else view._replace(heard={}))
    assert tasking.claim == chosen


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("others", "chosen"), [([2.0, 2.2], 1), ([-2.26, 1.74], 0)], ids=["the cloud lies ahead", "all around"]
)
def test_the_outer_target_is_taken_first_as_seen_from_the_middle_of_all_open_ones(
    others: list[float], chosen: int, turned: bool
) -> None:
    ahead = [0.3, -0.5, *others] if chosen else [-0.3, 0.5, *others]
    targets = {k: (0.0, x) if turned else (x, 0.0) for k, x in enumerate(ahead)}
    tasking = fielded()
    tasking.update(look(at=(0.0, 0.0), targets=targets))
    assert tasking.claim == chosen


def test_claims_passed_on_from_robots_out_of_hearing_count_and_are_passed_on_by_the_name_of_their_owner() -> None:
    rumour = ToldClaim(robot="r09", number=4, target=4, left_m=0.1, hops=1)
    own = ToldClaim(robot="r02", number=7, target=5, left_m=0.1, hops=1)
    told = near("r03", 0.5, 0.5, claims=(rumour, own))
    looks, tracks = fielded(), fielded()
    tracks.update(look(targets={4: BESIDE}, now_s=0.9))
    for tasking in (looks, tracks):
        tasking.update(look(told, targets={4: BESIDE}))
        assert tasking.task is Task.FREE
        assert {passed.robot for passed in tasking.book.to_tell(1.0)} == {"r03", "r09"}


# --- learning -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "known"), [(fielded, True), (papered, False)])
def test_a_target_told_of_is_gone_for_in_the_field_profile_alone(make: Callable[[], Tasking], known: bool) -> None:
    tasking = make()
    seen = Target(index=4, x_m=BESIDE[0], y_m=BESIDE[1])
    tasking.update(look(near("r03", 0.5, 0.5, sightings=(seen,), cloud_seen=True)))
    assert tasking.cloud_seen
    assert (tasking.claim == 4) == known


def test_a_message_is_learned_from_once_so_what_is_seen_after_it_counts() -> None:
    tasking = fielded()
    told = near("r03", 0.5, 0.5, sightings=(Target(index=4, x_m=0.4, y_m=0.21),))
    tasking.update(look(told))
    assert tasking.claim_at() == (0.4, 0.21)
    for now_s in (1.1, 1.2):
        tasking.update(look(told, targets={4: BESIDE}, now_s=now_s))
        assert tasking.claim_at() == BESIDE
    tasking.update(look(near("r03", 0.5, 0.5, seq=2, sightings=told.sightings), now_s=1.3))
    assert tasking.claim_at() == (0.4, 0.21)
