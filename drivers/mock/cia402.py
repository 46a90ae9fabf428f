"""Two emulated CANopen CiA 402 drives on one bus."""

import struct
from collections import Counter

from drivers.can.cia402 import Options
from drivers.can.frame import CanFrame
from drivers.mock.adapter import OnSlcan
from drivers.mock.cia402_objects import DriveSettings
from drivers.mock.cia402_slave import ENABLED, Slave
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.motor import Shaft


class EmulatedDrives:
    """:class:`drivers.mock.adapter.CanDevice`."""

    def __init__(self, options: Options, wheels: Wheels, settings: DriveSettings) -> None:
        self.wheels = wheels
        self.counters: Counter[str] = Counter()
        self.log = SampleLog(wheels)
        self.hung = False
        counts = float(options.counts_per_revolution)
        speed = options.velocity_per_revps or counts
        left = Shaft(wheels.left, options.gear_ratio, options.left_inverted)
        right = Shaft(wheels.right, options.gear_ratio, options.right_inverted)
        self.slaves = (
            Slave("left", options.left, left, counts, speed, settings),
            Slave("right", options.right, right, counts, speed, settings),
        )
        self._now_ns: int | None = None

    def advance(self, now_ns: int) -> list[CanFrame]:
        if self._now_ns is None:
            self._now_ns = now_ns
        if not self.hung:
            self._expire(now_ns)
        self._roll(now_ns)
        return [] if self.hung else [frame for slave in self.slaves for frame in slave.cyclic(now_ns)]

    def next_due_ns(self) -> int | None:
        if self.hung:
            return None
        return min((time for slave in self.slaves if (time := slave.next_due_ns()) is not None), default=None)

    def set_sensor_sign(self, sign: float) -> None:
        for slave in self.slaves:
            slave.shaft.sensor_sign = sign

    def brown_out(self, on: bool) -> None:
        """Fault 3220h with its emergency; lasts until reset."""
        for slave in self.slaves:
            slave.put(0x6079, 12_000 if on else 24_000)
            if on:
                slave.outbox.append(CanFrame(0x80 + slave.node, struct.pack("<HB5x", 0x3220, 0x05)))
                slave.fault(0x3220)

    def take_frame(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        if self.hung:
            return []
        if frame.extended or frame.remote:
            self.counters["foreign_frame"] += 1
            return []
        base, node = frame.can_id & 0x780, frame.can_id & 0x7F
        if frame.can_id == 0:
            self._order(frame.data)
        elif base == 0x600 and len(frame.data) == 8:
            return [slave.transfer(frame.data) for slave in self.slaves if slave.node == node]
        elif base == 0x700:
            for slave in self.slaves:
                if slave.get(0x1016, 1) >> 16 == node:
                    slave.heard_ns = now_ns
        else:
            self._process(frame, now_ns)
        return []

    def _order(self, data: bytes) -> None:
        addressed = [slave for slave in self.slaves if len(data) == 2 and data[1] in (0, slave.node)]
        if not addressed or not all(slave.order(data[0]) for slave in addressed):
            self.counters["unknown_frame"] += 1

    def _process(self, frame: CanFrame, now_ns: int) -> None:
        slave = next((entry for entry in self.slaves if entry.listens_to(frame.can_id)), None)
        if slave is None:
            self.counters["foreign_frame"] += 1
        elif not slave.take_process_data(frame.data):
            self.counters["short_frame"] += 1
        else:
            self.log.one(slave.name, now_ns, slave.get(0x6041) & 0x6F == ENABLED)

    def _expire(self, now_ns: int) -> None:
        released_ns = None
        for slave in sorted(self.slaves, key=lambda entry: entry.expiry_ns() or 0):
            expiry_ns = slave.expiry_ns()
            if expiry_ns is not None and expiry_ns <= now_ns:
                self._roll(expiry_ns)
                released_ns = expiry_ns if slave.expire() else released_ns
                self.counters["watchdog_expired"] += 1
        if released_ns is not None:
            self.log.both(released_ns, False, released=True)

    def _roll(self, now_ns: int) -> None:
        if self._now_ns is not None and now_ns > self._now_ns:
            self.wheels.advance((now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns


def emulate(options: Options, wheels: Wheels, settings: DriveSettings | None = None) -> OnSlcan:
    """The drives the options describe, as they come out of the box."""
    return OnSlcan(EmulatedDrives(options, wheels, settings or DriveSettings()), options.bitrate)
