"""One robot's decision and what it tells of itself: both profiles, a law of another distribution, and orders."""

import dataclasses
import math
from collections.abc import Iterable

import pytest
from msgspec import structs

from contract.messages import LinkMessage, NeighbourState, Target, ToldClaim, TransactionId
from onboard import unicycle
from onboard.ahdc.controller import MAIL_REPEATS, SIGHTINGS_A_MESSAGE, STILL_MPS, Controller
from onboard.ahdc.cotr import Task
from onboard.ahdc.law import Law
from onboard.ahdc.links import Entry, Link
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.plan import Motion
from onboard.ahdc.view import Decision, Goal, View
from tests.onboard.looks import BESIDE, HERE, look, near
from tests.onboard.samples import field_parameters, paper_parameters

PERIOD_S = 0.01
MOVING = Motion(*HERE, 2.5, 0.3, 0.1)
STANDING = Motion(*HERE, 0.3, 0.0, 0.0)


def controller(parameters: Parameters | None = None, law: Law | None = None) -> Controller:
    """r02 of boot 7."""
    return Controller("r02", 7, parameters or field_parameters(4), PERIOD_S, unicycle.steer, unicycle.rims, law)


def joined() -> Controller:
    """In the field profile, with leave to move."""
    one = controller()
    assert one.field is not None
    one.field.joined = True
    return one


def papered() -> Controller:
    return controller(paper_parameters())


class Drift:
    """A law that goes one way whatever the goal, and notes what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[View, Goal | None]] = []

    def velocity(self, view: View, goal: Goal | None) -> Vector:
        self.asked.append((view, goal))
        return (0.2, 0.1)


def lawful() -> tuple[Controller, Drift]:
    law = Drift()
    return controller(dataclasses.replace(field_parameters(4), profile="drift"), law), law


def said(one: Controller, now_s: float = 1.0) -> NeighbourState:
    return one.announce(STANDING, round(now_s * 1e9), 0.0, 0.0, (0.0, 0.0))


def offer(sender: str, number: int = 1) -> LinkMessage:
    return LinkMessage(to="r02", kind="add", tx=TransactionId(coordinator=sender, boot=1, number=number))


# --- announce: where it is and comes to rest --------------------------------------------------------


@pytest.mark.parametrize("make", [controller, papered, lambda: lawful()[0]], ids=["field", "paper", "another law"])
def test_a_robot_that_has_not_thought_yet_says_where_it_is_and_nothing_more(make) -> None:
    one = make()
    long, short = one.planner.stop_points(MOVING, 0.35, 0.2)
    heading = 2.5 - 2 * math.tau
    told = one.announce(MOVING._replace(heading_rad=heading), 2_000_000_000, 0.35, 0.2, (0.25, 0.15))
    expected = {
        "robot": "r02", "boot": 7, "seq": 1, "stamp_ns": 2_000_000_000, "x_m": 0.4, "y_m": -0.3, "heading_rad": 2.5,
        "vx_mps": round(0.2 * math.cos(2.5), 5), "vy_mps": round(0.2 * math.sin(2.5), 5),
        "stop_long": pytest.approx(long, abs=1e-5), "stop_short": pytest.approx(short, abs=1e-5),
        "rims_mps": (0.3, 0.1), "asked_mps": (0.25, 0.15), "moving": True, "mission": "", "task": "free",
        "claim": -1, "claim_at": None, "claim_wait_s": 0.0, "claims": (), "indicator": False, "hops": 1000,
        "cloud_seen": False, "occupied": "", "sightings": (), "help": None, "links_on": (), "links_kept": (),
        "wishes": (), "mail": (),
    }  # fmt: skip
    assert {name: getattr(told, name) for name in told.__struct_fields__} == expected
    assert math.dist(HERE, long) > math.dist(HERE, short) > 0.01
    assert [said(one).seq for _ in range(2)] == [2, 3]


def test_where_it_rolls_without_obeying_is_told_in_place_of_the_weak_brake_s_rest() -> None:
    one = controller()
    ways = [one.announce(MOVING, 0, 0.3, 0.1, (0.3, 0.1), rolls_to) for rolls_to in (None, (1.25, 0.5))]
    assert ways[1].stop_long == (1.25, 0.5) != ways[0].stop_long
    assert ways[1].stop_short == ways[0].stop_short


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize(("speed_mps", "moving"), [(0.9 * STILL_MPS, False), (STILL_MPS, True), (-0.02, True)])
def test_a_robot_is_still_only_where_no_wheel_turns_or_is_told_to(which: int, speed_mps: float, moving: bool) -> None:
    speeds = [0.0] * 4
    speeds[which] = speed_mps
    told = controller().announce(Motion(*HERE, 0.3, *speeds[:2]), 0, *speeds[2:], (0.0, 0.0))
    assert told.moving == moving


# --- announce: what it does and knows ---------------------------------------------------------------


def test_it_tells_its_task_its_claim_and_what_it_knows() -> None:
    one = controller()
    one.begin("m")
    rumours = (ToldClaim(robot="r09", number=4, target=7, left_m=0.1, hops=1),
               ToldClaim(robot="r02", number=4, target=7, left_m=0.1, hops=1))  # fmt: skip
    other = near("r03", 0.5, 0.5, hops=3, occupied="8", cloud_seen=True, claims=rumours)
    for now_s in (1.0, 1.01):
        one.think(look(other, targets={4: BESIDE, 5: (0.9, -0.31)}, now_s=now_s))
    told = said(one)
    assert (told.mission, told.task, told.claim, told.claim_at) == ("m", "tracking", 4, BESIDE)
    assert (told.indicator, told.hops, told.cloud_seen, told.occupied) == (True, 0, True, "8")
    assert told.sightings == (Target(index=4, x_m=0.4, y_m=0.2), Target(index=5, x_m=0.9, y_m=-0.31))
    assert {claim.robot for claim in told.claims} == {"r03", "r09"}, "not its own, back from another"
    assert said(one, 9.0).claims == (), "forgotten"


def test_it_tells_the_hold_that_remains_to_the_millisecond() -> None:
    one = controller()
    for now_s in (0.99, 1.0):
        one.think(look(targets={0: HERE}, now_s=now_s))
    told = said(one, 1.2504)
    assert (told.task, told.claim, told.occupied, told.sightings) == ("occupied", 0, "1", ())
    assert told.claim_wait_s == 0.75


def test_it_tells_that_it_helps_and_passes_the_call_on() -> None:
    caller, one = joined(), joined()
    for k in range(200):
        caller.think(look(targets={4: BESIDE}, now_s=1.0 + k / 100))
    call = said(caller).help
    assert call is not None
    assert (call.robot, call.hops, call.left_m) == ("r02", 0, 0.5)
    call = structs.replace(call, robot="r03")
    one.think(look(near("r03", 0.9, 0.0, help=call, links_on=("r02",))))
    told = said(one)
    assert told.task == "helping"
    assert told.help is not None
    assert (told.help.robot, told.help.hops) == ("r03", 1)


@pytest.mark.parametrize("make", [controller, papered])
def test_open_targets_are_told_in_turns_and_none_is_passed_over(make) -> None:
    one = make()
    one.begin("m")
    assert said(one).sightings == (), "nothing known yet"
    targets = {k: (0.4 + 0.01 * k, 0.2 - 0.01 * k) for k in range(14)}
    one.think(look(targets=targets, may_move=False))

    def told() -> list[int]:
        shown = said(one).sightings
        assert all((t.x_m, t.y_m) == pytest.approx(targets[t.index]) for t in shown)
        return [t.index for t in shown]

    assert SIGHTINGS_A_MESSAGE == 6
    assert [told() for _ in range(4)] == [[*range(6)], [*range(6, 12)], [12, 13], [*range(6)]]
    one.tasking.memory.occupy(3)
    assert told() == [*range(6, 12)]
    one.begin("n")
    one.think(look(targets=targets, may_move=False))
    assert told() == [*range(6)], "another mission: from the first one"


@pytest.mark.parametrize(("shared", "told"), [(True, [0, 1, 2]), (False, [])])
def test_sightings_are_told_only_where_the_arena_shares_them(shared: bool, told: list[int]) -> None:
    one = controller(dataclasses.replace(field_parameters(4), share_sightings=shared))
    one.think(look(targets={0: BESIDE, 1: (0.9, -0.3), 2: (-0.1, -0.3)}))
    assert [t.index for t in said(one).sightings] == told


# --- links ------------------------------------------------------------------------------------------

STATES = {"r03": Link.ON, "r04": Link.DOUBT, "r05": Link.OFF, "r06": Link.LEAVING, "r07": Link.OFFERED}


def test_links_are_told_as_vouched_for_or_merely_kept_and_follow_their_states() -> None:
    one = joined()
    assert one.field is not None
    entries = one.field.links.entries
    assert one.link_states() == {}
    entries.update((name, Entry(link)) for name, link in STATES.items())
    assert one.link_states() == {"r03": "on", "r04": "doubt", "r06": "leaving", "r07": "doubt"}
    assert (said(one).links_on, said(one).links_kept) == (("r03",), ("r04", "r06", "r07"))
    assert "r06" in one.linked
    assert "r05" not in one.linked
    entries["r04"].state, entries["r06"].state = Link.ON, Link.OFF
    assert one.link_states() == {"r03": "on", "r04": "on", "r07": "doubt"}


def test_a_robot_that_cannot_be_vouched_for_keeps_its_links_and_lets_no_detour_lean_on_them() -> None:
    one = joined()
    assert one.field is not None
    one.field.links.entries["r03"] = Entry(Link.ON)
    for fit, on, kept in ((False, (), ("r03",)), (True, ("r03",), ())):
        one.vouch(fit)
        assert (said(one).links_on, said(one).links_kept) == (on, kept)
        assert one.field.links.vouches("r03") == fit


def test_a_link_is_offered_under_its_own_name_and_boot_and_every_message_rides_on_two_states() -> None:
    one = controller()
    one.think(look(near("r03", 0.5, 0.5)))
    mail = said(one).mail
    assert [(m.to, m.kind) for m in mail] == [("r03", "add")]
    assert mail[0].tx == TransactionId(coordinator="r02", boot=7, number=1)
    one.hear_mail("r01", (offer("r01"),), 1.0)
    assert MAIL_REPEATS == 2
    both = said(one).mail
    assert [(m.to, m.kind) for m in both] == [("r03", "add"), ("r01", "accept")]
    assert said(one).mail == both[1:]
    assert said(one).mail == ()
    assert one.link_states() == {"r03": "doubt", "r01": "doubt"}
    one.think(look(near("r03", 0.5, 0.5), now_s=1.3))
    assert {(m.to, m.kind) for m in said(one).mail} == {("r03", "add"), ("r01", "accept")}, "unanswered: once more"


def test_the_operator_s_release_gives_up_every_link_and_what_was_still_to_be_said_of_them() -> None:
    one = joined()
    assert one.field is not None
    one.hear_mail("r01", (offer("r01"),), 1.0)
    assert said(one).mail
    one.release()
    assert (one.link_states(), said(one).mail, one.field.joined) == ({}, (), False)


def test_the_operator_s_release_ends_the_letter_s_links_and_wishes_too() -> None:
    one = papered()
    one.think(look(near("r03", 0.5, 0.5)))
    one.act(look(near("r03", 0.5, 0.5)))
    assert one.paper is not None
    one.paper.wishes = {"r03"}
    one.release()
    assert (one.link_states(), said(one).wishes, one.paper.kept) == ({}, (), set())


def test_without_power_it_keeps_no_link_with_robots_out_of_reach_and_with_power_it_joins_anew() -> None:
    one = joined()
    assert one.field is not None
    for name in ("r01", "r03", "r04"):
        one.field.links.entries[name] = Entry(Link.OFF if name == "r04" else Link.ON)
    asked: list[str] = []

    def beyond(robots: Iterable[str]) -> list[str]:
        asked.extend(robots)
        return ["r03"]

    one.settle(beyond)
    assert (one.link_states(), asked, one.field.joined) == ({"r01": "on"}, ["r01", "r03"], True)
    one.rejoin()
    assert (one.link_states(), one.field.joined) == ({"r01": "on"}, False)
    letter = papered()
    letter.settle(beyond)
    letter.rejoin()
    assert letter.link_states() == {}


def test_robots_excluded_by_the_operator_are_not_linked_nor_listened_to_until_they_are_readmitted() -> None:
    one = joined()
    assert one.field is not None
    one.field.links.entries["r01"] = Entry(Link.ON)
    one.exclude(frozenset({"r01"}))
    one.hear_mail("r01", (offer("r01"),), 1.0)
    assert (one.link_states(), said(one).mail) == ({}, ())
    assert "r01" not in one.linked
    one.exclude(frozenset())
    one.hear_mail("r01", (offer("r01", 2),), 1.0)
    assert one.link_states() == {"r01": "doubt"}


@pytest.mark.parametrize("make", [joined, papered])
def test_a_robot_that_is_excluded_itself_has_no_goal_and_no_claim_but_keeps_its_links(make) -> None:
    one, view = make(), look(targets={4: BESIDE})
    one.think(view)
    assert said(one).claim == 4
    if one.field is not None:
        one.field.links.entries["r03"] = Entry(Link.ON)
    one.exclude(frozenset({"r02"}))
    one.think(view)
    assert said(one).claim == -1
    assert one.act(view) == Decision(0.0, 0.0, "hold")
    assert ("r03" in one.linked) == (one.field is not None)
    one.exclude(frozenset())
    one.think(look(targets={4: BESIDE}, now_s=2.0))
    assert said(one).claim == 4


def test_by_the_letter_links_are_the_robots_in_reach_and_wishes_are_told_in_order() -> None:
    one = papered()
    assert one.link_states() == {}
    view = look(near("r04", 0.0, 0.9), near("r03", 0.5, 0.5), near("r05", -0.9, 0.9))
    one.think(view)
    one.act(view)
    assert one.link_states() == {"r03": "on", "r04": "on"}
    assert one.paper is not None
    one.paper.wishes = {"r04", "r03"}
    told = said(one)
    assert (told.links_on, told.links_kept, told.wishes) == (("r03", "r04"), (), ("r03", "r04"))
    assert "r03" not in one.linked
    one.vouch(False)
    one.hear_mail("r03", (offer("r03"),), 1.0)
    one.exclude(frozenset({"r03"}))
    assert said(one).links_on == ("r03", "r04"), "the letter knows neither transactions nor exclusion"


def test_by_the_letter_a_link_that_both_ends_wish_away_is_removed() -> None:
    """A ring of four or more: r03 and r04 are linked without r02, whose goal lies towards r03."""
    one = papered()
    told = [near("r03", 0.9, 0.0, links_on=("r02", "r04"), wishes=("r02",)),
            near("r04", 0.0, 0.9, links_on=("r02", "r03"), wishes=("r02",))]  # fmt: skip
    view = look(*told, targets={4: (HERE[0] + 0.5, HERE[1])})
    one.think(view)
    one.act(view)
    assert one.paper is not None
    assert (one.paper.wishes, one.paper.kept) == ({"r04"}, {"r03"})


def test_with_another_law_links_are_the_robots_in_sight() -> None:
    one, _ = lawful()
    assert said(one).links_on == ()
    view = look(near("r04", 0.0, 0.9), near("r03", 0.5, 0.5))
    one.think(view)
    one.act(view)
    assert said(one).links_on == ("r03", "r04")
    assert list(one.link_states().items()) == [("r03", "on"), ("r04", "on")]


# --- act --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [joined, papered])
def test_it_goes_for_its_target_and_says_what_else_it_goes_for(make) -> None:
    one = make()
    view = look(heading_rad=math.pi / 2, targets={4: BESIDE})
    assert one.act(view) == Decision(0.0, 0.0, "hold"), "it has not thought yet"
    one.think(view)
    decision = one.act(view)
    assert decision.waits == ""
    assert decision.left_mps == pytest.approx(decision.right_mps)
    assert decision.left_mps > 0.1
    assert one.act(view._replace(may_move=False)) == Decision(0.0, 0.0, "hold")
    one.begin("n")
    assert one.act(view) == Decision(0.0, 0.0, "hold"), "another mission: nothing left of the goal"
    one.think(look(now_s=2.0))
    decision = one.act(look(now_s=2.0))
    assert decision.waits == "start"
    assert decision.left_mps != 0.0


def test_what_bounds_a_command_is_said_rather_than_what_it_is_for() -> None:
    """A link at r_c, and the robot rolls on into the start direction, away from it."""
    one = joined()
    assert one.field is not None
    one.field.links.entries["r03"] = Entry(Link.ON)
    view = look(near("r03", -1.0, 0.0), heading_rad=0.0, rims=(0.7, 0.7))._replace(start_direction_rad=0.0)
    one.think(view)
    assert one.act(view) == Decision(0.0, 0.0, "link")


def test_it_stands_until_it_has_joined_the_network_even_with_a_target_beside_it() -> None:
    one = controller()
    view = look(targets={4: BESIDE})
    one.think(view)
    assert one.tasking.task is Task.TRACKING
    assert one.act(view) == Decision(0.0, 0.0, "joining")


def test_while_it_holds_its_target_it_turns_towards_the_next_and_without_one_stands() -> None:
    one = joined()
    off = (HERE[0], HERE[1] + 0.03)
    for now_s in (0.99, 1.0, 1.01):
        one.think(look(targets={0: off}, now_s=now_s))
    assert one.tasking.task is Task.OCCUPIED
    assert one.act(look(now_s=1.01)) == Decision(0.0, 0.0, "hold")
    one.think(look(targets={0: off, 1: BESIDE}, now_s=1.2))
    left, right, waits = one.act(look(targets={0: off, 1: BESIDE}, now_s=1.2))
    assert right > 0.01
    assert left == pytest.approx(-right)
    assert waits == "hold"


def test_another_law_takes_the_place_of_the_velocity_and_sees_view_and_goal() -> None:
    one, law = lawful()
    view = look(targets={4: BESIDE})
    one.think(view)
    speed, turn = unicycle.steer((0.2, 0.1), STANDING.heading_rad)
    parameters = one.parameters
    rims = unicycle.rims(speed, turn, parameters.wheel_separation_m, parameters.max_speed_mps)
    assert one.act(view) == Decision(*rims, "")
    assert law.asked == [(view, Goal(BESIDE, 0.0, "target"))]
    assert one.act(view._replace(may_move=False)) == Decision(0.0, 0.0, "hold")
    one.begin("n")
    assert one.act(view) == Decision(*rims, "hold")


def test_rim_speeds_stay_within_the_limit_whatever_a_law_says() -> None:
    one, law = lawful()
    law.velocity = lambda view, goal: (30.0, 40.0)  # type: ignore[method-assign]
    assert max(map(abs, one.act(look())[:2])) == pytest.approx(one.parameters.max_speed_mps)
