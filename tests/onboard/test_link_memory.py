"""What links depend on beside their messages: silence, disobedience, reboots, operators, and what is remembered."""

import pytest

from onboard.ahdc.links import REMEMBERED, Link
from tests.onboard.link_ends import after, life, linked, message, sent, tell

PATH = ("r01", "r03", "r02")


def test_links_to_silent_robots_are_kept_and_not_vouched_for() -> None:
    table = linked("r01", "r02", "r03")
    table.note_silence(["r02"])
    assert (table.enforced(), table.vouched()) == (["r02", "r03"], ["r03"])
    table.note_silence([])
    assert table.vouched() == ["r02", "r03"]


def test_a_robot_that_does_not_obey_vouches_for_nothing_and_keeps_its_links() -> None:
    table = linked("r01", "r02", "r03")
    table.fit = False
    assert (table.enforced(), table.vouched()) == (["r02", "r03"], [])
    assert not table.propose_removal(list(PATH), 0.0)


def test_the_first_boot_noted_of_a_neighbour_changes_nothing() -> None:
    table = linked("r01", "r02")
    for _ in range(2):
        table.note_boot("r02", 5)
        assert table.state("r02") is Link.ON


def test_a_neighbour_that_has_rebooted_is_offered_anew() -> None:
    """Its link is enforced, not vouched for, and neither inquired about nor repeated until then."""
    table = linked("r01", "r02", "r03")
    for boot in (1, 2):
        table.note_boot("r02", boot)
    assert (table.enforced(), table.vouched()) == (["r02", "r03"], ["r03"])
    assert after(table, 9.0) == []
    table.offer("r02", 9.0)
    assert sent(table) == [message("r02", "add", life("r01", 1))]


def test_a_rebooted_neighbours_offer_is_taken_at_once() -> None:
    table = linked("r01", "r02")
    for boot in (1, 2):
        table.note_boot("r02", boot)
    assert tell(table, "r02", "add", life("r02", 1, boot=2)) == [message("r02", "accept", life("r02", 1, boot=2))]


def test_a_reboot_ends_the_removal_of_that_link_alone() -> None:
    table = linked("r01", "r02", "r03")
    table.propose_removal(list(PATH), 0.0)
    for robot in ("r03", "r02"):
        table.note_boot(robot, 1)
        assert table.removal is not None
        table.note_boot(robot, 2)
        assert (table.removal is None) == (robot == "r02")
    sent(table)
    assert after(table, 9.0) == [], "nothing is left to give up"


def test_a_reboot_makes_no_link() -> None:
    table = linked("r01", "r02")
    table.forget("r02")
    for robot in ("r02", "r03"):
        for boot in (1, 2):
            table.note_boot(robot, boot)
    assert table.enforced() == []


def test_a_removal_begun_before_a_robots_own_reboot_is_unknown_to_it() -> None:
    table = linked("r01", "r02")
    old = life("r01", 1, boot=0)
    assert tell(table, "r02", "inquire", old) == [message("r02", "unknown", old)]


def test_released_every_link_is_off_and_nothing_of_it_comes_back() -> None:
    table = linked("r01", "r02", "r03", "r04")
    table.note_boot("r04", 1)
    table.note_boot("r04", 2)
    tell(table, "r03", "lock", life("r02", 9), path=("r02", "r03", "r01"), hop=2)
    table.propose_removal(["r01", "r02", "r03"], 0.0)
    table.offer("r05", 0.0)
    table.release()
    assert table.enforced() == []
    assert sent(table) == []
    assert table.removal is None
    assert after(table, 9.0) == []
    for robot in ("r02", "r03", "r04"):
        assert tell(table, robot, "add", life(robot, 5)) == []
    assert table.enforced() == []
    for robot in ("r02", "r03"):
        tell(table, robot, "add", life(robot, 7))
        tell(table, robot, "confirm", life(robot, 7))
    late = tell(table, "r03", "lock", life("r02", 9), path=("r02", "r03", "r01"), hop=2)
    assert [said.kind for said in late] == ["nack"]


def test_a_link_whose_robot_was_taken_out_is_off_and_the_others_stay() -> None:
    table = linked("r01", "r02", "r03", "r04")
    table.propose_removal(["r01", "r03", "r04"], 0.0)
    sent(table)
    table.forget("r02")
    assert table.enforced() == ["r03", "r04"]
    assert table.removal is not None
    assert tell(table, "r02", "add", life("r02", 5)) == []
    table.forget("r04")
    assert table.enforced() == ["r03"]
    assert table.removal is None
    assert after(table, 9.0) == []


def test_a_removal_is_closed_for_a_robot_that_was_taken_out() -> None:
    table = linked("r01", "r02", "r03")
    tell(table, "r03", "lock", life("r02", 9), path=("r02", "r03", "r01"), hop=2)
    assert table.state("r02") is Link.DOUBT
    table.forget("r02")
    for kind in ("add", "confirm"):
        tell(table, "r02", kind, life("r02", 7))
    late = tell(table, "r03", "lock", life("r02", 9), path=("r02", "r03", "r01"), hop=2)
    assert [said.kind for said in late] == ["nack"]
    assert table.state("r02") is Link.ON


def test_a_robot_that_was_never_linked_can_be_taken_out() -> None:
    table = linked("r01", "r02")
    table.forget("r03")
    assert table.enforced() == ["r02"]


@pytest.mark.parametrize("extra", [0, 1])
def test_the_last_closed_transactions_are_kept_in_mind(extra: int) -> None:
    """The oldest is forgotten first; it is older than any message still under way."""
    table = linked("r02", "r03")
    for number in range(1, REMEMBERED + extra + 1):
        tell(table, "r01", "abort", life("r01", number))
    taken = [bool(tell(table, "r01", "add", life("r01", number))) for number in (1, 2)]
    assert taken == [extra == 1, False]
