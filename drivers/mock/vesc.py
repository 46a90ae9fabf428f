"""Two emulated VESCs on one bus (vedderb/bldc ``documentation/comm_can.md``, ``timeout.c``)."""

import math
from collections import Counter
from typing import NamedTuple

from drivers.can.frame import CanFrame
from drivers.can.vesc import Options
from drivers.mock.adapter import OnSlcan
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.motor import Shaft
from drivers.serial.vesc_uart import Options as UartOptions


class VescSettings(NamedTuple):
    """What a user sets in VESC Tool. Status messages are off by default there; 0 switches them off."""

    status_ns: int = 10_000_000
    timeout_ns: int = 1_000_000_000
    min_erpm: float = 900.0
    ramp_erpm_per_s: float = 25_000.0
    """The speed setpoint grows and falls no faster, whatever the motor can (``s_pid_ramp_erpms_s``)."""
    volts: float = 24.0


class Controller:
    """One VESC and its motor."""

    def __init__(self, name: str, device: int, pole_pairs: int, shaft: Shaft) -> None:
        self.name = name
        self.device = device
        self.pole_pairs = pole_pairs
        self.shaft = shaft
        self.fed_ns: int | None = None

    def status(self, volts: float) -> list[CanFrame]:
        """Messages 1 and 5."""
        erpm = round(self.shaft.turns_per_s * 60.0 * self.pole_pairs)
        steps = math.floor(self.shaft.turns * 6.0 * self.pole_pairs)
        first = erpm.to_bytes(4, "big", signed=True) + bytes(4)
        fifth = (steps % 2**32).to_bytes(4, "big") + round(volts * 10).to_bytes(2, "big") + bytes(2)
        return [CanFrame(256 * number + self.device, data, True) for number, data in ((9, first), (27, fifth))]


class EmulatedVescs:
    """:class:`drivers.mock.adapter.CanDevice`."""

    def __init__(self, options: Options | UartOptions, wheels: Wheels, settings: VescSettings) -> None:
        self.wheels = wheels
        self.counters: Counter[str] = Counter()
        self.log = SampleLog(wheels)
        self.hung = False
        self.browned = False
        self.settings = settings
        gear, pairs = options.gear_ratio, options.pole_pairs
        self.controllers = (
            Controller("left", options.left, pairs, Shaft(wheels.left, gear, options.left_inverted)),
            Controller("right", options.right, pairs, Shaft(wheels.right, gear, options.right_inverted)),
        )
        for controller in self.controllers:
            wheel, per_rad = controller.shaft.wheel, abs(controller.shaft.turns_per_rad)
            wheel.acceleration_radps2 = min(
                wheel.limits.acceleration_radps2, settings.ramp_erpm_per_s / (60.0 * pairs * per_rad)
            )
        self._due_ns = 0
        self._now_ns: int | None = None

    def advance(self, now_ns: int) -> list[CanFrame]:
        if self._now_ns is None:
            self._now_ns = self._due_ns = now_ns
        released_ns = None
        for controller in self.controllers:
            expiry_ns = self._expiry_ns(controller)
            if not self.hung and expiry_ns is not None and expiry_ns <= now_ns:
                self._roll(expiry_ns)
                controller.fed_ns = None
                controller.shaft.wheel.release()
                self.counters["watchdog_expired"] += 1
                released_ns = expiry_ns
        if released_ns is not None:
            self.log.both(released_ns, False, released=True)
        self._roll(now_ns)
        if self.hung or not self.settings.status_ns or now_ns < self._due_ns:
            return []
        self._due_ns += self.settings.status_ns * ((now_ns - self._due_ns) // self.settings.status_ns + 1)
        return [frame for controller in self.controllers for frame in controller.status(self.settings.volts)]

    def next_due_ns(self) -> int | None:
        if self.hung:
            return None
        times = [time for controller in self.controllers if (time := self._expiry_ns(controller)) is not None]
        return min([*times, *([self._due_ns] if self.settings.status_ns else [])], default=None)

    def set_sensor_sign(self, sign: float) -> None:
        for controller in self.controllers:
            controller.shaft.sensor_sign = sign

    def brown_out(self, on: bool) -> None:
        """Status 5 shows the voltage; the fault code is not on the CAN bus."""
        self.settings = self.settings._replace(volts=7.0 if on else 24.0)
        self.browned = on
        if on:
            for controller in self.controllers:
                controller.shaft.wheel.release()

    def take_frame(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        if self.hung:
            return []
        number, device = divmod(frame.can_id, 256)
        addressed = [entry for entry in self.controllers if device in (entry.device, 255)]
        if not frame.extended or not addressed:
            self.counters["foreign_frame"] += 1
        elif frame.remote or number not in (0, 1, 2, 3):
            self.counters["unknown_frame"] += 1
        elif len(frame.data) < 4:
            self.counters["short_frame"] += 1
        else:
            for controller in addressed:
                self._obey(controller, number, int.from_bytes(frame.data[:4], "big", signed=True))
                controller.fed_ns = now_ns
                self.log.one(controller.name, now_ns, controller.shaft.wheel.powered)
        return []

    def _obey(self, controller: Controller, number: int, value: int) -> None:
        shaft = controller.shaft
        if self.browned:
            return
        free_turns_per_s = shaft.wheel.limits.max_radps * abs(shaft.turns_per_rad)
        if number == 3 and abs(value) >= self.settings.min_erpm:
            shaft.drive(value / (60.0 * controller.pole_pairs))
        elif number == 2 and value:
            shaft.drive(0.0)
        elif number == 0 and value:
            shaft.drive(
                math.copysign(abs(value) * 1e-5 * shaft.wheel.limits.max_radps * abs(shaft.turns_per_rad), value)
            )
        elif number == 1 and value:
            shaft.drive(math.copysign(free_turns_per_s, value))
        else:
            shaft.wheel.release()

    def _expiry_ns(self, controller: Controller) -> int | None:
        if controller.fed_ns is None or not self.settings.timeout_ns or not controller.shaft.wheel.powered:
            return None
        return controller.fed_ns + self.settings.timeout_ns

    def _roll(self, now_ns: int) -> None:
        if self._now_ns is not None and now_ns > self._now_ns:
            self.wheels.advance((now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns


def emulate(options: Options, wheels: Wheels, settings: VescSettings | None = None) -> OnSlcan:
    """The controllers the options describe, status messages on, the time-out as declared."""
    if settings is None:
        settings = VescSettings(timeout_ns=int((options.watchdog_s or 0.0) * 1e9), min_erpm=options.min_erpm)
    return OnSlcan(EmulatedVescs(options, wheels, settings), options.bitrate)
