"""One end of its links, alone with what it is told: for the tests of single rules of the link protocol."""

from typing import Literal

from contract.messages import LinkMessage, TransactionId
from onboard.ahdc.links import Link, LinkTable

Kind = Literal["lock", "nack", "yes", "commit", "abort", "ack", "inquire", "unknown", "add", "accept", "confirm"]


def life(robot: str, number: int, boot: int = 1) -> TransactionId:
    return TransactionId(coordinator=robot, boot=boot, number=number)


PATH = ("r01", "r02", "r03", "r04")
"""The detour of the tests: r01 asks for the end of its link to r04."""
TX = life("r01", 1)


def message(to: str, kind: Kind, tx: TransactionId | None, path: tuple[str, ...] = (), hop: int = 0) -> LinkMessage:
    return LinkMessage(to=to, kind=kind, tx=tx, path=path, hop=hop)


def sent(table: LinkTable) -> list[LinkMessage]:
    """What it has to say since it was last asked."""
    messages = list(table.outbox)
    table.outbox.clear()
    return messages


def tell(
    table: LinkTable,
    sender: str,
    kind: Kind,
    tx: TransactionId | None,
    now_s: float = 0.0,
    path: tuple[str, ...] = (),
    hop: int = 0,
) -> list[LinkMessage]:
    """The table hears one message; what it says to that."""
    table.hear(sender, message(table.robot, kind, tx, path, hop), now_s)
    return sent(table)


def after(table: LinkTable, now_s: float) -> list[LinkMessage]:
    """What it says when time passes."""
    table.tick(now_s)
    return sent(table)


def linked(robot: str, *others: str, number: int = 5) -> LinkTable:
    """A table whose links to ``others`` are ON by their own offers ``number``; removals of the tests have others."""
    table = LinkTable(robot, boot=1)
    for other in others:
        tell(table, other, "add", life(other, number))
        tell(table, other, "confirm", life(other, number))
        assert table.state(other) is Link.ON
    return table
