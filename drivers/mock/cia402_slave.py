"""One emulated CANopen CiA 402 drive: objects, NMT, SDO server, process data, state machine, heartbeat consumer.

Written from CiA 301 and CiA 402-2, apart from the driver's codec: process data is read and laid out by the objects the
master mapped. Out of the box nothing is mapped as the driver needs it, no transmit PDO is timed, and 1016h is off.
"""

import math
import struct
from typing import NamedTuple

from drivers.can.frame import CanFrame
from drivers.mock.motor import Shaft

NO_OBJECT, READ_ONLY, BAD_LENGTH, BAD_VALUE, BAD_COMMAND = 0x06020000, 0x06010002, 0x06070010, 0x06090030, 0x05040001
DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08
READ_ONLY_OBJECTS = {0x1000, 0x1001, 0x603F, 0x6041, 0x6061, 0x6064, 0x606C, 0x6079, 0x6502}


class DriveSettings(NamedTuple):
    """Of the device."""

    profile: int = 402
    bus_volts: float = 24.0


def _objects(settings: DriveSettings, node: int) -> dict[tuple[int, int], tuple[int, int]]:
    """Size in bytes and value at power-up, by index and subindex."""
    entries: dict[tuple[int, int], tuple[int, int]] = {
        (0x1000, 0): (4, 0x00020000 | settings.profile),
        (0x1001, 0): (1, 0),
        (0x1016, 0): (1, 1),
        (0x1016, 1): (4, 0),
        (0x1017, 0): (2, 100),
        (0x6007, 0): (2, 0),
        (0x603F, 0): (2, 0),
        (0x6040, 0): (2, 0),
        (0x6041, 0): (2, DISABLED),
        (0x6060, 0): (1, 0),
        (0x6061, 0): (1, 0),
        (0x6064, 0): (4, 0),
        (0x606C, 0): (4, 0),
        (0x6079, 0): (4, round(settings.bus_volts * 1000)),
        (0x60FF, 0): (4, 0),
        (0x6502, 0): (4, 0x104),
    }
    for record, cob, mapped in ((0x1400, 0x200, 0x60400010), (0x1800, 0x180, 0x60410010), (0x1801, 0x280, 0)):
        entries |= {(record, 1): (4, cob + node), (record, 2): (1, 0xFF), (record + 0x200, 0): (1, 1 if mapped else 0)}
        entries |= {(record + 0x200, place): (4, mapped if place == 1 else 0) for place in range(1, 5)}
        if record >= 0x1800:
            entries[record, 5] = (2, 0)
    return entries


class Slave:
    """One drive: object dictionary, communication state, power state machine."""

    def __init__(self, name: str, node: int, shaft: Shaft, counts: float, speed: float, settings: DriveSettings):
        self.name = name
        self.node = node
        self.shaft = shaft
        self.counts = counts
        self.speed = speed
        self.objects = _objects(settings, node)
        self.nmt = 0x7F
        self.heard_ns: int | None = None
        """Last heartbeat of the producer watched; None: monitoring has not begun."""
        self.outbox: list[CanFrame] = []
        self._due = {0x1017: 0, 0x1800: 0, 0x1801: 0}

    def get(self, index: int, subindex: int = 0) -> int:
        return self.objects[index, subindex][1]

    def put(self, index: int, value: int, subindex: int = 0) -> None:
        size = self.objects[index, subindex][0]
        self.objects[index, subindex] = (size, value % (1 << 8 * size))

    def measure(self) -> None:
        """Position and speed from the shaft."""
        self.put(0x6064, math.floor(self.shaft.turns * self.counts))
        self.put(0x606C, round(self.shaft.turns_per_s * self.speed))

    def expiry_ns(self) -> int | None:
        timeout_ms = self.get(0x1016, 1) & 0xFFFF
        return None if self.heard_ns is None or not timeout_ms else self.heard_ns + timeout_ms * 1_000_000

    def expire(self) -> bool:
        """The heartbeat stayed away: emergency 8130h, then what 6007h says; True if a motor was let go."""
        self.heard_ns = None
        powered = self.get(0x6041) & 0x6F == ENABLED
        reaction = self.get(0x6007)
        if reaction == 0:
            return False
        self.outbox.append(CanFrame(0x80 + self.node, struct.pack("<HB5x", 0x8130, 0x11)))
        if reaction == 3:
            self.shaft.drive(0.0)
            self._enter(QUICK_STOP)
        elif reaction == 2:
            self._enter(DISABLED)
        else:
            self.fault(0x8130)
        return powered and reaction != 3

    def fault(self, code: int) -> None:
        self.put(0x603F, code)
        self.put(0x1001, 1)
        self._enter(FAULT)

    def control(self, word: int) -> None:
        """Controlword: one transition of the power state machine."""
        edge = word & 0x80 and not self.get(0x6040) & 0x80
        self.put(0x6040, word)
        state = self.get(0x6041) & 0x6F
        if self.get(0x6041) & 0x4F == FAULT:
            if edge:
                self.put(0x603F, 0)
                self.put(0x1001, 0)
                self.outbox.append(CanFrame(0x80 + self.node, bytes(8)))
                self._enter(DISABLED)
        elif not word & 0x02:
            self._enter(DISABLED)
        elif not word & 0x04:
            if state == ENABLED:
                self.shaft.drive(0.0)
                self._enter(QUICK_STOP)
        elif word & 0x07 == 0x06 and self.get(0x6041) & 0x4F != QUICK_STOP:
            self._enter(READY)
        elif word & 0x0F == 0x07 and state in (READY, ENABLED):
            self._enter(SWITCHED_ON)
        elif word & 0x0F == 0x0F and state == SWITCHED_ON:
            self._enter(ENABLED)
        if self.get(0x6041) & 0x6F == ENABLED:
            self.move()

    def move(self) -> None:
        """Follow the target velocity in the two velocity modes."""
        target = self.get(0x60FF)
        target -= (target >> 31) << 32
        if self.get(0x6061) in (3, 9):
            self.shaft.drive(target / self.speed)

    def _enter(self, state: int) -> None:
        if state not in (ENABLED, QUICK_STOP):
            self.shaft.wheel.release()
        if self.get(0x6041) != state:
            self.put(0x6041, state)
            self._due[0x1800] = 0

    def order(self, command: int) -> bool:
        """NMT; False for an unknown command."""
        states = {1: 0x05, 2: 0x04, 0x80: 0x7F, 0x81: 0x7F, 0x82: 0x7F}
        if command not in states:
            return False
        self.nmt = states[command]
        if command in (0x81, 0x82):
            self.outbox.append(CanFrame(0x700 + self.node, b"\0"))
        return True

    def transfer(self, data: bytes) -> CanFrame:
        """One SDO request, expedited only."""
        command = data[0]
        index, subindex = struct.unpack_from("<HB", data, 1)
        code = 0
        entry = self.objects.get((index, subindex))
        answer = bytes(8)
        if entry is None:
            code = NO_OBJECT
        elif command == 0x40:
            self.measure()
            size, value = self.objects[index, subindex]
            answer = struct.pack("<BHBI", 0x43 | (4 - size) << 2, index, subindex, value)
        elif command & 0xE3 == 0x23:
            size = 4 - (command >> 2 & 3)
            code = self._store(index, subindex, entry[0], data[4 : 4 + size])
            answer = struct.pack("<BHBI", 0x60, index, subindex, 0)
        elif command != 0x80:
            code = BAD_COMMAND
        if code:
            answer = struct.pack("<BHBI", 0x80, index, subindex, code)
        return CanFrame(0x580 + self.node, answer)

    def _store(self, index: int, subindex: int, size: int, data: bytes) -> int:
        """The abort code, 0 for accepted."""
        value = int.from_bytes(data, "little")
        if index in READ_ONLY_OBJECTS:
            return READ_ONLY
        if len(data) != size:
            return BAD_LENGTH
        if index & 0xFE00 in (0x1600, 0x1A00) and self._active_pdo(index - 0x200):
            return BAD_VALUE
        if index & 0xFE00 in (0x1600, 0x1A00) and subindex and self.get(index):
            return BAD_VALUE
        if index == 0x6060 and value not in (3, 9):
            return BAD_VALUE
        if index == 0x6040:
            self.control(value)
            return 0
        self.put(index, value, subindex)
        if index == 0x6060:
            self.put(0x6061, value)
        elif index == 0x1016:
            self.heard_ns = None
        return 0

    def _active_pdo(self, record: int) -> bool:
        return not self.get(record, 1) & 0x80000000

    def mapped(self, record: int) -> list[int]:
        """Objects of a PDO, in order."""
        return [self.get(record + 0x200, place) for place in range(1, self.get(record + 0x200) + 1)]

    def take_process_data(self, data: bytes) -> bool:
        """A receive PDO; False if it is shorter than its map."""
        entries = self.mapped(0x1400)
        if len(data) < sum(entry & 0xFF for entry in entries) // 8:
            return False
        word = None
        for entry in entries:
            size = (entry & 0xFF) // 8
            value, data = int.from_bytes(data[:size], "little"), data[size:]
            if entry >> 16 == 0x6040:
                word = value
            elif (entry >> 16, 0) in self.objects:
                self.put(entry >> 16, value)
        if word is not None:
            self.control(word)
        elif self.get(0x6041) & 0x6F == ENABLED:
            self.move()
        return True

    def listens_to(self, can_id: int) -> bool:
        return self.nmt == 0x05 and self.get(0x1400, 1) == can_id

    def cyclic(self, now_ns: int) -> list[CanFrame]:
        """Messages due by now."""
        frames, self.outbox = self.outbox, []
        for index, period_ms in self._periods():
            if not period_ms or now_ns < self._due[index]:
                continue
            self._due[index] = now_ns + period_ms * 1_000_000
            if index == 0x1017:
                frames.append(CanFrame(0x700 + self.node, bytes((self.nmt,))))
            else:
                self.measure()
                entries = self.mapped(index)
                data = b"".join(self.get(e >> 16).to_bytes((e & 0xFF) // 8, "little") for e in entries)
                frames.append(CanFrame(self.get(index, 1) & 0x7FF, data))
        return frames

    def next_due_ns(self) -> int | None:
        times = [self._due[index] for index, period_ms in self._periods() if period_ms]
        expiry_ns = self.expiry_ns()
        return min(times if expiry_ns is None else [*times, expiry_ns], default=None)

    def _periods(self) -> list[tuple[int, int]]:
        periods = [(0x1017, self.get(0x1017))]
        if self.nmt == 0x05:
            periods += [(record, self.get(record, 5)) for record in (0x1800, 0x1801) if self._active_pdo(record)]
        return periods
