"""How a link is asked away: the coordinator keeps it until the other end knows that it is over."""

import pytest

from contract.messages import TransactionId
from onboard.ahdc.links import COMMIT_REPEAT_S, LOCK_TIMEOUT_S, Link, LinkTable
from tests.onboard.link_ends import PATH, TX, after, life, linked, message, sent, tell


def proposed(now_s: float = 0.0) -> LinkTable:
    """The coordinator, having asked."""
    table = linked("r01", "r02", "r04", "r05")
    assert table.propose_removal(list(PATH), now_s)
    sent(table)
    return table


def committed() -> LinkTable:
    """The coordinator, having had its answer."""
    table = proposed()
    tell(table, "r04", "yes", TX)
    return table


def test_a_proposal_stops_vouching_first_and_asks_along_the_detour() -> None:
    table = linked("r01", "r02", "r04")
    assert table.propose_removal(list(PATH), 0.0)
    assert sent(table) == [message("r02", "lock", TX, PATH, 1)]
    assert table.enforces("r04")
    assert table.vouched() == ["r02"]


def test_only_what_is_vouched_for_is_proposed() -> None:
    """Nor a link as its own detour."""
    table = linked("r01", "r02", "r04", "r05", "r06")
    table.note_silence(["r05"])
    table.offer("r07", 0.0)
    sent(table)
    for path in (["r01", "r04"], ["r01", "r05", "r04"], ["r01", "r07", "r04"], ["r01", "r02", "r05"],
                 ["r01", "r02", "r08"]):  # fmt: skip
        assert not table.propose_removal(path, 0.0)
        assert sent(table) == []
        assert table.removal is None
    assert table.vouched() == ["r02", "r04", "r06"]


def test_one_removal_at_a_time() -> None:
    table = proposed()
    assert not table.propose_removal(["r01", "r02", "r05"], 0.0)
    assert sent(table) == []
    assert table.state("r05") is Link.ON


def test_a_proposal_not_answered_in_time_is_given_up() -> None:
    table = proposed(1.0)
    assert after(table, 1.0 + LOCK_TIMEOUT_S) == []
    assert table.state("r04") is Link.DOUBT
    assert after(table, 1.01 + LOCK_TIMEOUT_S) == [message("r04", "abort", TX)]
    assert table.vouched() == ["r02", "r04", "r05"]
    assert after(table, 9.0) == []
    assert table.propose_removal(list(PATH), 9.0)


def test_a_proposal_refused_is_given_up_at_once() -> None:
    table = proposed()
    assert tell(table, "r02", "nack", TX, 0.0, PATH, 0) == [message("r04", "abort", TX)]
    assert table.state("r04") is Link.ON
    assert table.removal is None
    assert tell(table, "r02", "nack", TX, 0.0, PATH, 0) == []


def test_a_refusal_of_another_removal_is_not_taken_for_this_one() -> None:
    table = proposed()
    assert tell(table, "r02", "nack", life("r01", 9), 0.0, PATH, 0) == []
    assert table.state("r04") is Link.DOUBT
    assert [said.kind for said in tell(table, "r04", "yes", TX)] == ["commit"]


def test_after_yes_the_end_is_told_until_it_is_acknowledged() -> None:
    table = proposed()
    assert tell(table, "r04", "yes", TX) == [message("r04", "commit", TX)]
    assert table.state("r04") is Link.LEAVING
    assert table.vouched() == ["r02", "r05"]
    for due_s in (COMMIT_REPEAT_S, 2 * COMMIT_REPEAT_S):
        assert after(table, due_s - 0.01) == []
        assert after(table, due_s) == [message("r04", "commit", TX)]
    assert table.enforces("r04")
    assert tell(table, "r04", "ack", TX) == []
    assert table.state("r04") is Link.OFF
    assert after(table, 9.0) == []
    assert tell(table, "r04", "add", life("r04", 5)) == [], "the life that ended"


def test_a_removal_under_way_leaves_room_for_the_next() -> None:
    table = committed()
    assert table.propose_removal(["r01", "r02", "r05"], 0.0)
    assert sent(table) == [message("r02", "lock", life("r01", 2), ("r01", "r02", "r05"), 1)]


@pytest.mark.parametrize("tx", [life("r01", 9), life("r04", 1)])
def test_an_acknowledgement_of_something_else_ends_nothing(tx: TransactionId) -> None:
    table = committed()
    tell(table, "r04", "ack", tx)
    tell(table, "r05", "ack", TX)
    assert (table.state("r04"), table.state("r05")) == (Link.LEAVING, Link.ON)


def test_an_acknowledgement_before_its_time_ends_nothing() -> None:
    table = proposed()
    tell(table, "r04", "ack", TX)
    assert table.state("r04") is Link.DOUBT


def test_a_yes_of_somebody_else_or_to_something_else_commits_nothing() -> None:
    table = proposed()
    assert tell(table, "r05", "yes", TX) == []
    assert tell(table, "r04", "yes", life("r01", 9)) == [message("r04", "abort", life("r01", 9))]
    assert tell(table, "r04", "yes", life("r04", 1)) == []
    assert (table.state("r04"), table.state("r05")) == (Link.DOUBT, Link.ON)
    assert table.removal is not None


def test_a_yes_that_comes_late_is_told_how_it_ended() -> None:
    given_up, done = proposed(), committed()
    after(given_up, 1.0)
    assert tell(given_up, "r04", "yes", TX) == [message("r04", "abort", TX)]
    assert given_up.state("r04") is Link.ON
    tell(done, "r04", "ack", TX)
    assert tell(done, "r04", "yes", TX) == [message("r04", "commit", TX)]
    assert done.state("r04") is Link.OFF


def test_an_inquiry_is_answered_with_what_became_of_the_removal() -> None:
    assert tell(proposed(), "r04", "inquire", TX) == [], "still open"
    assert tell(proposed(), "r04", "inquire", life("r01", 9)) == [message("r04", "abort", life("r01", 9))]
    assert tell(committed(), "r04", "inquire", TX) == [message("r04", "commit", TX)]
    forgotten = life("r01", 1, boot=7)
    assert tell(committed(), "r04", "inquire", forgotten) == [message("r04", "unknown", forgotten)]
    assert tell(committed(), "r04", "inquire", life("r02", 1)) == [], "not its own"


def test_a_coordinator_in_doubt_does_not_inquire() -> None:
    assert after(proposed(), LOCK_TIMEOUT_S) == []


def test_a_coordinator_does_not_take_its_own_removal_for_forgotten() -> None:
    table = proposed()
    assert tell(table, "r04", "unknown", TX) == []
    assert table.state("r04") is Link.DOUBT
    assert table.removal is not None
