"""An emulated ODrive: two axes on a CAN bus behind an slcan adapter.

Written from the protocol table of the ODrive manual ("CAN Protocol"), apart from the driver's
codec. Both firmware lines; 0.5 feeds the watchdog on any frame for the axis and lets it expire in
any state. 0.6 feeds it on setpoints and on entering closed loop (ODriveResources,
``examples/can_watchdog.py``); that nothing else feeds it and that it rests while idle is unverified.
"""

import math
import struct
from collections import Counter
from typing import NamedTuple

from drivers.can.frame import CanFrame
from drivers.can.odrive import Options
from drivers.mock.adapter import OnSlcan
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.motor import Shaft

ESTOP_ERROR = {"0.5": 0x4000, "0.6": 0x02000000}
WATCHDOG_ERROR = {"0.5": 0x800, "0.6": 0x01000000}
INVALID_STATE = 0x1
UNDER_VOLTAGE = {"0.5": 0, "0.6": 0x200}


VERSION = bytes((2, 4, 4, 58, 0, 6, 10, 0))
"""0.6 only: protocol, hardware major, minor, variant, firmware major, minor, revision, unreleased."""
POLLED = {
    "0.5": (0x01, 0x03, 0x04, 0x05, 0x09, 0x0A, 0x14, 0x15, 0x17, 0x1C, 0x1D),
    "0.6": (0x00, 0x01, 0x03, 0x09, 0x14, 0x15, 0x17, 0x1C, 0x1D),
}
"""What each firmware answers, as ODrive's DBC files of 0.5.6 and 0.6.10 have it."""
TAKEN = (0x0C, 0x0E, 0x11, 0x12, 0x13, 0x19, 0x1A, 0x1B)
"""Other set points, trajectory limits and gains: taken, of no effect here."""


class AxisSettings(NamedTuple):
    """What a user sets over USB. A period of 0 switches the message off."""

    heartbeat_ns: int = 100_000_000
    encoder_ns: int = 10_000_000
    bus_ns: int = 0
    watchdog_ns: int = 0
    """``enable_watchdog`` is false by default."""
    bus_volts: float = 24.0
    velocity_limit: float = 100.0
    """turns/s"""


class Axis:
    """One axis: state machine, watchdog, cyclic messages."""

    def __init__(self, name: str, node: int, dialect: str, shaft: Shaft, settings: AxisSettings) -> None:
        self.name = name
        self.node = node
        self.dialect = dialect
        self.shaft = shaft
        self.settings = settings
        self.error = 0
        self.state = 1
        self.control_mode = 3
        """Position control until told otherwise."""
        self.input_mode = 1
        self.fed_ns = 0
        self.procedure_result = 0
        self._due = {0x01: 0, 0x09: 0, 0x17: 0}

    @property
    def expiry_ns(self) -> int | None:
        """When the watchdog lets go, unless fed."""
        if not self.settings.watchdog_ns or self.error & WATCHDOG_ERROR[self.dialect]:
            return None
        if self.dialect == "0.6" and self.state != 8:
            return None
        return self.fed_ns + self.settings.watchdog_ns

    def disarm(self, error: int = 0) -> None:
        self.error |= error
        self.state = 1
        self.shaft.wheel.release()

    def cyclic(self, now_ns: int) -> list[CanFrame]:
        """Messages due by now, each at most once."""
        frames, due = [], self._due
        for command, period_ns in self._periods():
            if period_ns and now_ns >= due[command]:
                due[command] = now_ns + period_ns - (now_ns - due[command]) % period_ns
                frames.append(self.message(command))
        return frames

    def next_due_ns(self) -> int | None:
        return min((self._due[command] for command, period_ns in self._periods() if period_ns), default=None)

    def message(self, command: int) -> CanFrame:
        """The telemetry message of this number; the error word for the unknown."""
        if command == 0x01:
            tail = bytes((self.procedure_result, 0, 0)) if self.dialect == "0.6" else bytes(3)
            data = struct.pack("<IB", self.error, self.state) + tail
        elif command == 0x09:
            data = struct.pack("<ff", self.shaft.turns, self.shaft.turns_per_s)
        elif command == 0x00:
            data = VERSION
        elif command == 0x0A:
            data = struct.pack("<ii", round(self.shaft.turns * 8192), round(self.shaft.turns * 8192) % 8192)
        elif command == 0x15 and self.dialect == "0.6":
            data = struct.pack("<ff", 30.0, 30.0)
        elif command in (0x14, 0x15, 0x1C, 0x1D):
            data = bytes(8)
        elif command == 0x17:
            data = struct.pack("<ff", self.settings.bus_volts, 0.1)
        else:
            data = struct.pack("<II", self.error, 0)
        return CanFrame(self.node * 32 + command, data)

    def _periods(self) -> tuple[tuple[int, int], ...]:
        settings = self.settings
        return ((0x01, settings.heartbeat_ns), (0x09, settings.encoder_ns), (0x17, settings.bus_ns))


class EmulatedOdrive:
    """Both axes, as :class:`drivers.mock.slcan.Node`."""

    def __init__(self, options: Options, wheels: Wheels, settings: AxisSettings) -> None:
        self.wheels = wheels
        self.counters: Counter[str] = Counter()
        self.log = SampleLog(wheels)
        self.hung = False
        gear = options.gear_ratio
        self.axes = (
            Axis("left", options.left, options.dialect, Shaft(wheels.left, gear, options.left_inverted), settings),
            Axis("right", options.right, options.dialect, Shaft(wheels.right, gear, options.right_inverted), settings),
        )
        self._now_ns: int | None = None

    def advance(self, now_ns: int) -> list[CanFrame]:
        if self._now_ns is None:
            self._now_ns = now_ns
            for axis in self.axes:
                axis.fed_ns = now_ns
        if self.hung:
            self._roll(now_ns)
            return []
        self._expire(now_ns)
        self._roll(now_ns)
        return [frame for axis in self.axes for frame in axis.cyclic(now_ns)]

    def _expire(self, now_ns: int) -> None:
        """Let the watchdogs due by now release their motors, each at its own time."""
        left, right = self.axes[0].expiry_ns, self.axes[1].expiry_ns
        if (left is None or left > now_ns) and (right is None or right > now_ns):
            return
        released_ns = None
        for axis in sorted(self.axes, key=lambda entry: entry.expiry_ns or 0):
            expiry_ns = axis.expiry_ns
            if expiry_ns is not None and expiry_ns <= now_ns:
                self._roll(expiry_ns)
                released_ns = expiry_ns if axis.state == 8 else released_ns
                axis.disarm(WATCHDOG_ERROR[axis.dialect])
                self.counters["watchdog_expired"] += 1
        if released_ns is not None:
            self.log.both(released_ns, False, released=True)

    def next_due_ns(self) -> int | None:
        if self.hung:
            return None
        times = [time for axis in self.axes for time in (axis.next_due_ns(), axis.expiry_ns) if time is not None]
        return min(times, default=None)

    def set_sensor_sign(self, sign: float) -> None:
        for axis in self.axes:
            axis.shaft.sensor_sign = sign

    def brown_out(self, on: bool) -> None:
        """Disarmed; 0.6 has a bit for it, 0.5 tells only that the axis has left closed loop."""
        for axis in self.axes:
            axis.settings = axis.settings._replace(bus_volts=8.0 if on else 24.0)
            if on:
                axis.disarm(UNDER_VOLTAGE[axis.dialect])

    def take_frame(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        if self.hung:
            return []
        if frame.extended:
            self.counters["foreign_frame"] += 1
            return []
        node, command = frame.can_id // 32, frame.can_id % 32
        axis = next((entry for entry in self.axes if entry.node == node), None)
        if axis is None:
            self.counters["foreign_frame"] += 1
            return []
        if axis.dialect == "0.5":
            axis.fed_ns = now_ns
        polled = frame.remote or (axis.dialect == "0.5" and not frame.data)
        if polled and command in POLLED[axis.dialect]:
            return [axis.message(command)]
        if frame.remote:
            self.counters["unknown_poll"] += 1
            return []
        refusal = self._obey(axis, command, frame.data, now_ns)
        if refusal:
            self.counters[refusal] += 1
        return []

    def _obey(self, axis: Axis, command: int, data: bytes, now_ns: int) -> str:
        if command == 0x02:
            axis.disarm(ESTOP_ERROR[axis.dialect])
        elif command == 0x18:
            axis.error = 0
        elif command == 0x16:
            axis.disarm()
            axis.error = 0
        elif len(data) < 8:
            return "short_frame"
        elif command == 0x07:
            self._request(axis, int.from_bytes(data[:4], "little"), now_ns)
        elif command == 0x0B:
            axis.control_mode, axis.input_mode = struct.unpack("<II", data)
        elif command == 0x0D:
            return self._setpoint(axis, struct.unpack("<f", data[:4])[0], now_ns)
        elif command == 0x0F:
            (limit,) = struct.unpack("<f", data[:4])
            if not math.isfinite(limit):
                return "nonfinite_limit"
            axis.settings = axis.settings._replace(velocity_limit=abs(limit))
        elif command not in TAKEN:
            return "unknown_frame"
        return ""

    def _request(self, axis: Axis, state: int, now_ns: int) -> None:
        if state == 1:
            axis.disarm()
        elif state == 8 and not axis.error:
            axis.state = 8
            axis.fed_ns = now_ns
            axis.shaft.drive(0.0)
        elif state == 8:
            axis.procedure_result = 7
        else:
            axis.error |= INVALID_STATE

    def _setpoint(self, axis: Axis, turns_per_s: float, now_ns: int) -> str:
        if not math.isfinite(turns_per_s):
            return "nonfinite_setpoint"
        axis.fed_ns = now_ns
        refusal = ""
        if axis.state != 8:
            refusal = "setpoint_while_idle" if turns_per_s else ""
        elif axis.control_mode != 2:
            refusal = "wrong_control_mode"
        else:
            limit = axis.settings.velocity_limit
            axis.shaft.drive(max(-limit, min(limit, turns_per_s)))
        self.log.one(axis.name, now_ns, axis.state == 8)
        return refusal

    def _roll(self, now_ns: int) -> None:
        if self._now_ns is not None and now_ns > self._now_ns:
            self.wheels.advance((now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns


def emulate(options: Options, wheels: Wheels, settings: AxisSettings | None = None) -> OnSlcan:
    """The device the options describe, its watchdog set to what they declare."""
    if settings is None:
        settings = AxisSettings(watchdog_ns=int((options.watchdog_s or 0.0) * 1e9))
    return OnSlcan(EmulatedOdrive(options, wheels, settings), options.bitrate)
