"""What a RoboClaw keeps for those who configure it (User Manual, command tables). None of it moves an emulated motor.

A program that reads or sets limits, modes or gains finds them as on the device: a setting is stored as it came, and
read as it was stored.
"""

import struct
from typing import NamedTuple


class Setting(NamedTuple):
    """One value or group of values."""

    writes: tuple[int, ...]
    """Command that sets all of it, or one for each value."""
    read: int | None
    layout: str
    """Of the whole, big-endian."""
    new: tuple[int, ...]
    order: tuple[int, ...] = ()
    """Where the values of a write stand in the reply, if elsewhere: gains are set as D, P, I and read as P, I, D."""


SETTINGS = (
    Setting((2,), None, "B", (0,)),
    Setting((3,), None, "B", (150,)),
    Setting((26,), None, "B", (0,)),
    Setting((27,), None, "B", (150,)),
    Setting((57,), 59, "HH", (60, 340)),
    Setting((58,), 60, "HH", (55, 340)),
    Setting((61,), 63, "IIIIIII", (0,) * 7, (2, 0, 1, 3, 4, 5, 6)),
    Setting((62,), 64, "IIIIIII", (0,) * 7, (2, 0, 1, 3, 4, 5, 6)),
    Setting((68, 69), 81, "II", (655_360, 655_360)),
    Setting((70, 71), 72, "HH", (32_767, 32_767)),
    Setting((74,), 75, "BBB", (0, 0, 0)),
    Setting((76,), 77, "BB", (3, 3)),
    Setting((92, 93), 91, "BB", (0, 0)),
    Setting((98,), 99, "H", (0,)),
    Setting((100,), 101, "BB", (0, 0)),
    Setting((102, 103), 104, "HH", (0, 0)),
    Setting((109,), 110, "II", (0, 0)),
    Setting((112,), 113, "II", (0, 0)),
    Setting((115,), 116, "bb", (0, 0)),
    Setting((117,), 118, "HH", (0, 0)),
    Setting((133,), 135, "II", (3000, 0)),
    Setting((134,), 136, "II", (3000, 0)),
    Setting((148,), 149, "B", (0,)),
)
RESTORE, STORE, RECALL = 80, 94, 95
STORE_KEY = 0xE22EAB7A
"""Data of 94."""


def _layouts() -> dict[int, str]:
    found = {RESTORE: "", STORE: ">I", RECALL: ""}
    for setting in SETTINGS:
        parts = [setting.layout] if len(setting.writes) == 1 else list(setting.layout)
        found |= {command: f">{part}" for command, part in zip(setting.writes, parts, strict=True)}
    return found


WRITE_LAYOUTS = _layouts()
"""Data of every command that sets one of them."""
READ_COMMANDS = frozenset(setting.read for setting in SETTINGS if setting.read is not None)


class Settings:
    """One device's, and what it would wake up with."""

    def __init__(self) -> None:
        self._values = {setting.writes: setting.new for setting in SETTINGS}
        self._stored = dict(self._values)

    def write(self, command: int, values: tuple[int, ...]) -> None:
        """Take a command of :data:`WRITE_LAYOUTS`."""
        if command == RESTORE:
            self._values = {setting.writes: setting.new for setting in SETTINGS}
        elif command == STORE:
            if values == (STORE_KEY,):
                self._stored = dict(self._values)
        elif command == RECALL:
            self._values = dict(self._stored)
        else:
            setting = next(entry for entry in SETTINGS if command in entry.writes)
            if len(setting.writes) > 1:
                kept = list(self._values[setting.writes])
                kept[setting.writes.index(command)] = values[0]
                values = tuple(kept)
            elif setting.order:
                kept = [0] * len(values)
                for place, value in zip(setting.order, values, strict=True):
                    kept[place] = value
                values = tuple(kept)
            self._values[setting.writes] = values

    def read(self, command: int) -> bytes:
        """Data of a reply of :data:`READ_COMMANDS`."""
        setting = next(entry for entry in SETTINGS if entry.read == command)
        return struct.pack(f">{setting.layout}", *self._values[setting.writes])
