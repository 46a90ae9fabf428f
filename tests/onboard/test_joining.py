"""Whom the field profile links with, and from when on a robot may move: rules 7 and 8 as the law keeps them."""

from collections.abc import Callable, Iterable

import pytest

from onboard import unicycle
from onboard.ahdc.field_law import LISTEN_S, FieldLaw
from onboard.ahdc.link_state import OFF, ON, Entry, Link
from onboard.ahdc.parameters import Vector
from onboard.ahdc.plan import Motion
from onboard.ahdc.view import Heard, Sighted, View
from tests.onboard.samples import field_parameters, state

PARAMETERS = field_parameters(3)
R_C_M = PARAMETERS.sensing_radius_m
OWN = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
NEAR, FAR = (0.4, 0.0), (0.0, R_C_M + 0.05)


def new_law(robot: str = "r01", joined: bool = False, linked: Iterable[str] = ()) -> FieldLaw:
    law = FieldLaw(robot, 7, PARAMETERS, 0.01, unicycle.steer)
    law.joined |= joined
    for name in linked:
        law.links.entries[name] = Entry(ON)
    return law


def view(
    now_s: float, others: dict[str, Vector], silent: str = "", unseen: str = "", boots: dict[str, int] | None = None
) -> View:
    """Others at their places, each heard of, in that order; they keep what links they have with the robot."""
    told = {
        name: state(name, *place, boot=(boots or {}).get(name, 1), links_kept=("r01", "r09"))
        for name, place in others.items()
    }
    sighted = {name: Sighted(*place, 0.0, 0.0, 0.0, True) for name, place in others.items() if name != unseen}
    heard = {name: Heard(message, 0.0, name == silent) for name, message in told.items()}
    return View(now_s, OWN, sighted, heard, {}, 0.0, True)


def offered(law: FieldLaw) -> list[str]:
    return [message.to for message in law.links.outbox if message.kind == "add"]


@pytest.mark.parametrize("robot", ["r01", "r09"])
def test_a_robot_that_has_just_come_offers_links_to_everybody_within_r_c(robot: str) -> None:
    law = new_law(robot)
    law.keep_links(view(5.0, {"r02": FAR, "r03": NEAR, "r04": (0.0, R_C_M)}))
    assert offered(law) == ["r03", "r04"]
    assert all(message.tx is not None and message.tx.coordinator == robot for message in law.links.outbox)
    assert all(message.tx is not None and message.tx.boot == 7 for message in law.links.outbox)


@pytest.mark.parametrize(("robot", "offers"), [("r01", ["r02"]), ("r09", [])])
def test_of_two_that_have_joined_the_lower_id_offers(robot: str, offers: list[str]) -> None:
    law = new_law(robot, joined=True)
    law.keep_links(view(5.0, {"r02": NEAR}))
    assert offered(law) == offers


def test_alone_it_has_joined_once_it_has_listened() -> None:
    for start_s in (0.0, 5.0):
        law = new_law()
        law.keep_links(view(start_s, {}))
        law.keep_links(view(start_s + LISTEN_S - 0.01, {}))
        assert not law.joined
        law.keep_links(view(start_s + LISTEN_S + 0.01, {}))
        assert law.joined


@pytest.mark.parametrize("place", [NEAR, (0.0, R_C_M)])
def test_it_joins_only_once_linked_to_every_robot_within_r_c(place: Vector) -> None:
    law = new_law()
    for now_s in (5.0, 6.0, 7.0):
        law.keep_links(view(now_s, {"r02": place, "r03": FAR}))
        assert not law.joined
    law.links.entries["r02"].state = ON
    law.keep_links(view(8.0, {"r02": place, "r03": FAR}))
    assert law.joined


def met(others: dict[str, Vector], now_s: float = 5.0) -> FieldLaw:
    """A law that has not joined, for r03 is missing; it has been linked to r02, whose link a detour has replaced."""
    law = new_law(linked=["r02"])
    law.keep_links(view(now_s, others))
    law.links.entries["r02"].state = OFF
    return law


LONG = (0.0, R_C_M - 0.01)
OTHERS = {"r02": LONG, "r03": NEAR}


def test_it_joins_once_it_has_been_linked_to_every_robot_if_never_to_all_at_one_moment() -> None:
    law = met(OTHERS)
    law.keep_links(view(5.0 + LISTEN_S + 0.01, OTHERS))
    assert not law.joined
    law.links.entries["r03"] = Entry(ON)
    law.keep_links(view(5.5, OTHERS))
    assert law.joined
    assert set(offered(law)) == {"r03"}


def test_a_long_link_that_a_detour_has_replaced_is_not_offered_again_and_a_short_one_is() -> None:
    law = met(OTHERS)
    law.keep_links(view(5.05, OTHERS))
    assert offered(law) == ["r03"]
    short = {"r02": (0.0, 0.4), "r03": NEAR}
    law = met(short)
    law.keep_links(view(5.05, short))
    assert offered(law) == ["r03", "r02"]


def test_a_link_that_the_other_end_does_not_know_of_is_no_meeting() -> None:
    law = new_law(linked=["r02"])
    stranger = view(5.0, OTHERS)
    stranger.heard["r02"] = Heard(state("r02", *LONG, boot=1, links_kept=()), 0.0, False)
    law.keep_links(stranger)
    law.links.entries["r02"].state = OFF
    law.links.entries["r03"] = Entry(ON)
    law.keep_links(view(5.5, OTHERS))
    assert not law.joined


@pytest.mark.parametrize(
    "lose",
    [
        lambda law: law.rejoin(),
        lambda law: law.release(),
        lambda law: law.forget("r04"),
        lambda law: law.exclude(frozenset({"r04"})),
        lambda law: law.keep_links(view(5.2, OTHERS, boots={"r02": 2})),
    ],
    ids=["rejoin", "release", "forget", "exclude", "boot"],
)
def test_links_that_end_without_a_detour_are_waited_for_again(lose: Callable[[FieldLaw], None]) -> None:
    law = met(OTHERS)
    lose(law)
    law.links.entries["r03"] = Entry(ON)
    for now_s in (5.5, 6.0):
        law.keep_links(view(now_s, OTHERS, boots={"r02": law.links.boots["r02"]}))
    assert not law.joined
    assert "r02" in offered(law)


def test_a_link_whose_other_end_has_forgotten_it_is_waited_for_again() -> None:
    law = new_law(linked=["r02"])
    law.keep_links(view(5.0, OTHERS))
    forgetful = view(5.1, OTHERS)
    forgetful.heard["r02"] = Heard(state("r02", *LONG, boot=1, links_kept=()), 0.0, False)
    law.keep_links(forgetful)
    law.links.entries["r03"] = Entry(ON)
    law.keep_links(view(5.5, OTHERS))
    assert law.links.state("r02") is Link.OFFERED
    assert not law.joined


def test_once_joined_it_meets_nobody_and_after_a_rejoin_waits_for_all() -> None:
    law = new_law(linked=["r02", "r03"])
    for now_s in (5.0, 5.4, 5.5):
        law.keep_links(view(now_s, OTHERS))
    assert law.joined
    law.links.entries["r02"].state = OFF
    law.rejoin()
    law.keep_links(view(6.0, OTHERS))
    assert not law.joined
    assert offered(law) == ["r02"]


def test_a_silent_robot_is_offered_nothing_and_not_vouched_for() -> None:
    law = new_law(joined=True, linked=["r02"])
    others = {"r02": NEAR, "r03": (0.0, 0.4)}
    law.keep_links(view(5.0, others, silent="r02"))
    assert not law.links.vouches("r02")
    assert offered(law) == ["r03"]
    law = new_law(joined=True)
    law.keep_links(view(5.0, others, silent="r02"))
    assert offered(law) == ["r03"]


def test_a_robot_that_is_heard_but_not_seen_is_offered_nothing() -> None:
    law = new_law(joined=True)
    law.keep_links(view(5.0, {"r02": NEAR, "r03": (0.0, 0.4)}, unseen="r02"))
    assert offered(law) == ["r03"]


def test_who_has_a_link_is_not_offered_another_and_those_after_it_are() -> None:
    law = new_law(joined=True, linked=["r02"])
    law.keep_links(view(5.0, {"r02": NEAR, "r03": (0.0, 0.4)}))
    assert offered(law) == ["r03"]
    assert law.links.vouches("r02")


def test_a_neighbour_that_has_rebooted_is_offered_its_link_anew() -> None:
    law = new_law(joined=True, linked=["r02"])
    law.keep_links(view(5.0, {"r02": NEAR}, boots={"r02": 3}))
    assert law.links.vouches("r02")
    law.keep_links(view(5.1, {"r02": NEAR}, boots={"r02": 4}))
    assert not law.links.vouches("r02")
    assert law.links.enforces("r02")
    assert offered(law) == ["r02"]


def test_an_offer_is_repeated() -> None:
    law = new_law(joined=True)
    for now_s in (5.0, 5.05, 5.15):
        law.keep_links(view(now_s, {"r02": NEAR}))
    assert offered(law) == ["r02", "r02"]


def test_who_is_taken_out_of_the_network_loses_its_links_and_is_offered_none_until_readmitted() -> None:
    law = new_law(joined=True, linked=["r02", "r03"])
    law.exclude(frozenset({"r02"}))
    law.keep_links(view(5.0, {"r02": NEAR, "r03": (0.0, 0.4)}))
    assert law.links.enforced() == ["r03"]
    assert offered(law) == []
    law.exclude(frozenset())
    law.keep_links(view(5.1, {"r02": NEAR, "r03": (0.0, 0.4)}))
    assert offered(law) == ["r02"]


def test_who_is_excluded_keeps_nobody_from_joining() -> None:
    law = new_law()
    law.exclude(frozenset({"r02"}))
    for now_s in (5.0, 5.0 + LISTEN_S + 0.01):
        law.keep_links(view(now_s, {"r02": NEAR}))
    assert law.joined


def test_released_it_is_as_at_the_start() -> None:
    law = new_law(linked=["r02"])
    for now_s in (5.0, 6.0):
        law.keep_links(view(now_s, {"r02": NEAR}))
    assert law.joined
    law.release()
    assert not law.joined
    assert law.links.state("r02") is OFF
    law.keep_links(view(7.0, {}))
    assert not law.joined
    law.keep_links(view(8.0, {"r02": NEAR}))
    assert law.links.state("r02") is Link.OFFERED
    assert not law.joined
