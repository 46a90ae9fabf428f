"""One emulated CANopen CiA 402 drive: objects, NMT, SDO server, process data, state machine, heartbeat consumer.

Written from CiA 301 and CiA 402-2, apart from the driver's codec: process data is read and laid out by the objects the
master mapped. Out of the box nothing is mapped as the driver needs it, no transmit PDO is timed, and 1016h is off.
"""

import math
import struct

from drivers.can.frame import CanFrame
from drivers.mock.cia402_objects import DISABLED, EVENT_DRIVEN, READ_ONLY_OBJECTS, DriveSettings, map_fault, objects
from drivers.mock.motor import Shaft

NO_OBJECT, READ_ONLY, BAD_LENGTH, BAD_VALUE, BAD_COMMAND = 0x06020000, 0x06010002, 0x06070010, 0x06090030, 0x05040001
READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = 0x21, 0x23, 0x27, 0x07, 0x08


class Slave:
    """One drive: object dictionary, communication state, power state machine."""

    def __init__(self, name: str, node: int, shaft: Shaft, counts: float, speed: float, settings: DriveSettings):
        self.name = name
        self.node = node
        self.shaft = shaft
        self.counts = counts
        self.speed = speed
        self._new = objects(settings, node)
        self.objects = dict(self._new)
        self.nmt = 0x7F
        self.heard_ns: int | None = None
        """Last heartbeat of the producer watched; None: monitoring has not begun."""
        self.outbox: list[CanFrame] = []
        self._due = {0x1017: 0, 0x1800: 0, 0x1801: 0}
        self._changed = False
        """The statusword has, since it was last told."""

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
        self.move()

    def move(self) -> None:
        """Follow the target velocity if enabled in one of the two velocity modes."""
        target = self.get(0x60FF)
        target -= (target >> 31) << 32
        if self.get(0x6041) & 0x6F == ENABLED and self.get(0x6061) in (3, 9):
            self.shaft.drive(target / self.speed)

    def _enter(self, state: int) -> None:
        if state not in (ENABLED, QUICK_STOP):
            self.shaft.wheel.release()
        if self.get(0x6041) != state:
            self.put(0x6041, state)
            self._due[0x1800] = 0
            self._changed = True

    def order(self, command: int) -> bool:
        """NMT; False for an unknown command."""
        states = {1: 0x05, 2: 0x04, 0x80: 0x7F, 0x81: 0x7F, 0x82: 0x7F}
        if command not in states:
            return False
        self.nmt = states[command]
        self._changed = True
        if command in (0x81, 0x82):
            self._reset(everything=command == 0x81)
        return True

    def _reset(self, everything: bool) -> None:
        """Objects as at power-up, those of the drive only if ``everything`` is reset; then the boot-up message."""
        if everything:
            self.shaft.wheel.release()
        kept = {} if everything else {key: entry for key, entry in self.objects.items() if key[0] >= 0x2000}
        self.objects = self._new | kept
        self.heard_ns = None
        self.outbox.append(CanFrame(0x700 + self.node, b"\0"))

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
        if index & 0xFE00 in (0x1600, 0x1A00) and not subindex and (code := map_fault(self.objects, index, value)):
            return code
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
        self.move()
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
        else:
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
                frames.append(self._process_data(index))
        if self._changed and self.nmt == 0x05:
            self._changed = False
            frames += [self._process_data(record) for record in (0x1800, 0x1801) if self._tells_changes(record)]
        return frames

    def _process_data(self, record: int) -> CanFrame:
        """A transmit PDO as it is mapped."""
        self.measure()
        data = b"".join(self.get(e >> 16).to_bytes((e & 0xFF) // 8, "little") for e in self.mapped(record))
        return CanFrame(self.get(record, 1) & 0x7FF, data)

    def _tells_changes(self, record: int) -> bool:
        """Event driven, without a timer that will tell anyway, with the statusword in it."""
        if not self._active_pdo(record) or self.get(record, 5) or self.get(record, 2) not in EVENT_DRIVEN:
            return False
        return any(entry >> 16 == 0x6041 for entry in self.mapped(record))

    def next_due_ns(self) -> int | None:
        times = [self._due[index] for index, period_ms in self._periods() if period_ms]
        expiry_ns = self.expiry_ns()
        return min(times if expiry_ns is None else [*times, expiry_ns], default=None)

    def _periods(self) -> list[tuple[int, int]]:
        periods = [(0x1017, self.get(0x1017))]
        if self.nmt == 0x05:
            periods += [(record, self.get(record, 5)) for record in (0x1800, 0x1801) if self._active_pdo(record)]
        return periods
