"""One emulated Dynamixel X-series servo: its control table and its motor (ROBOTIS e-Manual, XL330 control table)."""

import math
import struct
from collections.abc import Sequence

from drivers.mock.motor import Shaft

RPM_PER_UNIT = 0.229
VELOCITY_LIMIT = 1620
"""Of a new XL330-M077; an M288 comes with 445, an XL430 with 265. A goal beyond is a Data Limit Error."""


def _new_table(model: int, device: int) -> bytearray:
    table = bytearray(256)
    table[0:2] = struct.pack("<H", model)
    table[6] = 45
    table[7] = device
    table[9] = 250
    table[11] = 3
    table[44:48] = struct.pack("<I", VELOCITY_LIMIT)
    table[68] = 2
    return table


class Servo:
    """One servo's control table and motor."""

    def __init__(self, name: str, device: int, shaft: Shaft, model: int = 1190) -> None:
        self.name = name
        self.device = device
        self.shaft = shaft
        self._new = bytes(_new_table(model, device))
        self.table = bytearray(self._new)
        self._backup = bytes(self._new[:64])
        self.fed_ns = 0
        self.tripped = False
        self.registered: tuple[int, bytes] | None = None
        """Of REG WRITE, until ACTION."""
        self.cleared_turns = 0
        self.decivolts = 50

    @property
    def expiry_ns(self) -> int | None:
        counts = self.table[98]
        return None if self.tripped or not counts or not self.table[64] else self.fed_ns + counts * 20_000_000

    @property
    def alert(self) -> int:
        """Bit of every status packet: there is a hardware error."""
        return 0x80 if self.table[70] else 0

    def reset(self, kept: Sequence[int]) -> None:
        """To the registers of a new servo, but for those kept; it starts anew.

        The id of an emulated servo is that of its arena file, not 1.
        """
        saved = {address: self.table[address] for address in kept}
        self.table[:] = self._new
        for address, value in saved.items():
            self.table[address] = value
        self.tripped, self.registered = False, None
        self.shaft.wheel.release()

    def back_up(self, restore: bool) -> int:
        """Keep the settings that outlive power-off, or take those kept; refused while torque is on."""
        if self.table[64]:
            return 1
        if restore:
            self.table[:64] = self._backup
        else:
            self._backup = bytes(self.table[:64])
        return 0

    def refresh(self) -> None:
        """Bring the read-only registers up to date."""
        speed = round(self.shaft.turns_per_s * 60.0 / RPM_PER_UNIT)
        counts = math.floor((self.shaft.turns - self.cleared_turns) * 4096)
        position = (counts + 2**31) % 2**32 - 2**31
        self.table[128:136] = struct.pack("<ii", speed, position)
        self.table[144:146] = struct.pack("<H", self.decivolts)
        self.table[146] = 30
        if self.tripped:
            self.table[98] = 0xFF

    def write(self, address: int, data: bytes) -> int:
        """The error number of the status packet, 0 for accepted."""
        if address + len(data) > 146 or 70 <= address < 72 or address >= 120:
            return 7
        if address < 64 and self.table[64]:
            return 7
        if address == 98 and len(data) == 1:
            if data[0] > 127:
                return 4
            self.tripped = False
        elif self.tripped and 100 <= address < 120:
            return 4
        elif address == 104 and len(data) == 4:
            (goal,) = struct.unpack("<i", data)
            if abs(goal) > struct.unpack("<I", self.table[44:48])[0]:
                return 6
        self.table[address : address + len(data)] = data
        self._act(address)
        return 0

    def _act(self, address: int) -> None:
        if not self.table[64]:
            self.shaft.wheel.release()
        elif self.table[11] == 1 and (address in (64, 104)):
            goal = struct.unpack("<i", self.table[104:108])[0]
            self.shaft.drive(goal * RPM_PER_UNIT / 60.0)
