"""NatNet versions and what each changes in the layout of a frame."""

import re
from typing import NamedTuple


class Version(NamedTuple):
    """``major.minor`` of a NatNet bit stream."""

    major: int
    minor: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}"


OLDEST = Version(2, 6)
NEWEST = Version(4, 3)
_MOTIVE = {
    Version(2, 9): "1.9",
    Version(2, 10): "1.10",
    Version(3, 0): "2.0",
    Version(3, 1): "2.1",
    Version(4, 0): "3.0",
    Version(4, 1): "3.1",
    Version(4, 2): "3.2",
    Version(4, 3): "3.3",
}


class UnsupportedVersion(ValueError):
    """A version whose layout is not known; the text names it and the ones that are."""

    def __init__(self, seen: object) -> None:
        old = isinstance(seen, Version) and seen < OLDEST
        super().__init__(
            f"NatNet {seen} is not supported: {OLDEST} to {NEWEST} are (Motive {_MOTIVE[NEWEST]} and older); "
            + ("update Motive" if old else "choose an older bit stream in Motive's streaming settings")
        )


class Layout(NamedTuple):
    """How one version packs its frames."""

    version: Version
    sized: bool
    """Every section carries its byte size (4.1)."""
    marker_lists: bool
    """Rigid bodies carry their markers (before 3.0)."""
    wide_timestamp: bool
    force_plates: bool
    devices: bool
    assets: bool
    residuals: bool
    ticks: bool
    """High-resolution stamps in the frame (3.0)."""


def parse(text: str) -> Version:
    """``"4.1"`` as a version.

    :raises UnsupportedVersion: not of that form.
    """
    match = re.fullmatch(r"([0-9]{1,3})\.([0-9]{1,3})", text)
    if match is None:
        raise UnsupportedVersion(repr(text))
    return Version(int(match[1]), int(match[2]))


def layout(version: Version) -> Layout:
    """Layout of a version.

    :raises UnsupportedVersion: outside :data:`OLDEST` to :data:`NEWEST`.
    """
    if not OLDEST <= version <= NEWEST:
        raise UnsupportedVersion(version)
    return Layout(
        version=version,
        sized=version >= (4, 1),
        marker_lists=version < (3, 0),
        wide_timestamp=version >= (2, 7),
        force_plates=version >= (2, 9),
        devices=version >= (2, 11),
        assets=version >= (4, 1),
        residuals=version >= (3, 0),
        ticks=version >= (3, 0),
    )
