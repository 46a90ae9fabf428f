"""Objects of an emulated CiA 402 drive as it comes out of the box (CiA 301 and CiA 402-2)."""

from collections.abc import Mapping
from typing import NamedTuple

NOT_MAPPABLE, TOO_LONG = 0x06040041, 0x06040042
MAX_ENTRIES = 4
"""Of a PDO map of this drive."""
DISABLED = 0x40
"""Statusword of "switch-on disabled"."""
EVENT_DRIVEN = (0xFE, 0xFF)
"""Transmission types of a PDO that leaves when something changes, and by its event timer."""
READ_ONLY_OBJECTS = {0x1000, 0x1001, 0x1018, 0x603F, 0x6041, 0x6061, 0x6064, 0x606C, 0x6079, 0x6502}


class DriveSettings(NamedTuple):
    """Of the device."""

    profile: int = 402
    bus_volts: float = 24.0


def objects(settings: DriveSettings, node: int) -> dict[tuple[int, int], tuple[int, int]]:
    """Size in bytes and value at power-up, by index and subindex."""
    entries: dict[tuple[int, int], tuple[int, int]] = {
        (0x1000, 0): (4, 0x00020000 | settings.profile),
        (0x1001, 0): (1, 0),
        (0x1016, 0): (1, 1),
        (0x1016, 1): (4, 0),
        (0x1017, 0): (2, 100),
        (0x1018, 0): (1, 4),
        (0x6007, 0): (2, 0),
        (0x603F, 0): (2, 0),
        (0x6040, 0): (2, 0),
        (0x6041, 0): (2, DISABLED),
        (0x605A, 0): (2, 2),
        (0x6060, 0): (1, 0),
        (0x6061, 0): (1, 0),
        (0x6064, 0): (4, 0),
        (0x606C, 0): (4, 0),
        (0x6079, 0): (4, round(settings.bus_volts * 1000)),
        (0x607F, 0): (4, 0),
        (0x6083, 0): (4, 0),
        (0x6084, 0): (4, 0),
        (0x60FF, 0): (4, 0),
        (0x6502, 0): (4, 0x104),
    }
    entries |= {(0x1018, place): (4, 0) for place in range(1, 5)}
    for record, cob, mapped in ((0x1400, 0x200, 0x60400010), (0x1800, 0x180, 0x60410010), (0x1801, 0x280, 0)):
        entries |= {(record, 1): (4, cob + node), (record, 2): (1, 0xFF), (record + 0x200, 0): (1, 1 if mapped else 0)}
        entries |= {(record + 0x200, place): (4, mapped if place == 1 else 0) for place in range(1, 5)}
        entries[record, 0] = (1, 5 if record >= 0x1800 else 2)
        if record >= 0x1800:
            entries |= {(record, 3): (2, 0), (record, 5): (2, 0)}
    return entries


def map_fault(table: Mapping[tuple[int, int], tuple[int, int]], index: int, count: int) -> int:
    """Abort code of a PDO map of so many entries, 0 if it can be mapped."""
    entries = [table.get((index, place), (0, 0))[1] for place in range(1, count + 1)]
    if count > MAX_ENTRIES or sum(entry & 0xFF for entry in entries) > 64:
        return TOO_LONG
    known = all(table.get((entry >> 16, entry >> 8 & 0xFF), (0, 0))[0] * 8 == entry & 0xFF for entry in entries)
    return 0 if known and all(entries) else NOT_MAPPABLE
