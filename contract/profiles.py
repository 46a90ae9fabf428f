"""Which control laws an arena file may name: ours, and those that installed distributions bring along."""

from importlib.metadata import EntryPoint, entry_points

OURS = ("field", "paper")
LAWS = "ahdc.laws"
"""Entry point group; an entry's name is the profile that selects it (docs/testing-your-own.md)."""


def others() -> dict[str, EntryPoint]:
    """Laws of other distributions, by profile. A name of ours stays ours."""
    return {entry.name: entry for entry in entry_points(group=LAWS) if entry.name not in OURS}


def known() -> list[str]:
    """Every profile that may be named on this computer."""
    return [*OURS, *sorted(others())]
