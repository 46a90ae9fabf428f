"""RoboClaw over packet serial: both channels in one packet, reads pipelined behind it.

The device has no enable: any speed command drives, duty zero releases. Its serial time-out
(command 14, default off) is set to the largest whole 100 ms within ``safety.watchdog_s`` and read
back before anything may move.
"""

from itertools import cycle
from typing import Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault
from drivers.base import Site, WheelSpeeds
from drivers.conversion import Odometer, WheelScale
from drivers.family import MAX_RADPS, pair_faults
from drivers.ports import BytePort
from drivers.serial import roboclaw_codec as codec
from drivers.serial.family import SerialDrive, SerialOptions, open_port
from drivers.serial.roboclaw_codec import GET_ENCODERS, GET_SPEEDS, SPEED_BOTH

__all__ = ["Drive", "Options", "check", "open_port"]

Channel = Annotated[int, Meta(ge=1, le=2, description="motor output: 1 for M1, 2 for M2")]

SETPOINT = (SPEED_BOTH,)
MOTION = (GET_ENCODERS, GET_SPEEDS)
STATUS_EVERY, BATTERY_EVERY = 10, 50
"""In polls."""


class Options(SerialOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "roboclaw", ... }``"""

    kind: Literal["roboclaw"]
    address: Annotated[int, Meta(ge=0x80, le=0x87, description="packet serial address")] = 0x80
    left: Channel = 1
    right: Channel = 2
    counts_per_revolution: Annotated[
        int, Meta(ge=1, le=10_000_000, description="quadrature counts per turn of the motor shaft, 4 x lines")
    ]


def check(options: Options, path: str) -> list[Fault]:
    """What no single key shows."""
    return pair_faults(options.left, options.right, path)


class Drive(SerialDrive[Options]):
    """:class:`drivers.base.DiffDrive` for one two-channel RoboClaw."""

    CYCLE_BYTES = 12 + 1 + (2 + 10) + (2 + 10)
    """37 with its acknowledgement, 78 and 79 with their replies."""
    ANSWER_S = 0.25
    ACK_NS = 60_000_000
    """Setpoints unacknowledged for longer have not reached the controller."""

    def __init__(self, robot: str, options: Options, site: Site, port: BytePort) -> None:
        self._replies = codec.Replies(options.address)
        super().__init__("RoboClaw", robot, options, site, port, self._replies)
        self.firmware: tuple[int, ...] = ()
        counts, gear = float(options.counts_per_revolution), options.gear_ratio
        self._left = WheelScale.of(counts, gear, options.left_inverted)
        self._right = WheelScale.of(counts, gear, options.right_inverted)
        self._left_odometer = Odometer(self._left, 32)
        self._right_odometer = Odometer(self._right, 32)
        self._left_units, self._right_units = self._left.units_per_rad, self._right.units_per_rad
        self._swapped = options.left == 2
        self._setpoint = codec.SpeedWriter(options.address, self._swapped).packet
        self._counts: tuple[int, ...] | None = None
        self._speeds: tuple[int, ...] | None = None
        """Of both channels, since the last sample."""
        self._faults: tuple[str, ...] = ()
        self._questions = cycle(_questions(options.address))
        self._acked_ns = 0
        """When a setpoint was last acknowledged."""

    def configure(self) -> None:
        tenths = int(self.site.safety.watchdog_s * 10.0 + 1e-9)
        if tenths < 1:
            raise self.line.refused(
                f"safety.watchdog_s = {self.site.safety.watchdog_s:g} s; the device counts in 0.1 s",
                "Raise safety.watchdog_s to at least 0.1",
            )
        self.open()
        self._replies.reset()
        self._counts = self._speeds = None
        try:
            self._identify(tenths)
        except Exception:
            self.close()
            raise

    def activate(self, now_ns: int) -> None:
        self._left_odometer = Odometer(self._left, 32)
        self._right_odometer = Odometer(self._right, 32)
        if self._ask(codec.speed_both(self.options.address, 0, 0), SPEED_BOTH) is None:
            raise self.line.lost("the zero setpoint is not acknowledged")
        self._acked_ns = self.line.port.now_ns()
        status = self._ask(codec.read_packet(self.options.address, codec.GET_STATUS), codec.GET_STATUS)
        self._faults = codec.decode_status(status or b"")
        if self._faults:
            self.deactivate(now_ns)
            raise self.line.faulty(", ".join(self._faults), "Remove the cause, clear errors, activate again")
        self.active = True

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        if not self.active:
            self._release(now_ns)
            return
        left, right = speeds
        if self.line.send(self._setpoint(left * self._left_units, right * self._right_units)):
            self._replies.expect(now_ns, SETPOINT)

    def poll(self, now_ns: int) -> None:
        """Ask for telemetry; not while setpoints go unacknowledged, for a read feeds the time-out as well
        as a setpoint does and would keep the last setpoint turning."""
        deaf = self.active and now_ns - self._acked_ns > self.ACK_NS
        if deaf or not self._replies.ready(now_ns):
            return
        commands, packets = next(self._questions)
        if self.line.send(packets):
            self._replies.expect(now_ns, commands)

    def read(self, now_ns: int) -> WheelFeedback | None:
        for command, data in self._replies.feed(self.line.receive(), now_ns):
            if command == SPEED_BOTH:
                self._acked_ns = now_ns
            elif command == GET_ENCODERS:
                self._counts = codec.decode_encoders(data)
            elif command == GET_SPEEDS:
                self._speeds = codec.decode_speeds(data)
            else:
                self._take(command, data)
        if self._counts is None or self._speeds is None:
            return None
        (left, right), (left_speed, right_speed) = self._counts, self._speeds
        self._counts = self._speeds = None
        if self._swapped:
            left, right, left_speed, right_speed = right, left, right_speed, left_speed
        left_radps, right_radps = left_speed / self._left_units, right_speed / self._right_units
        if abs(left_radps) > MAX_RADPS or abs(right_radps) > MAX_RADPS:
            self.line.counters["implausible_speed"] += 1
            return None
        return self.feedback(
            now_ns,
            (left_radps, self._left_odometer.update(left)),
            (right_radps, self._right_odometer.update(right)),
            enabled="estop" not in self._faults,
            faults=self._faults,
        )

    def deactivate(self, now_ns: int) -> None:
        self.active = False
        self._release(now_ns)

    def clear_errors(self, now_ns: int) -> None:
        packet = codec.write_packet(self.options.address, codec.RESET_ESTOP)
        self._send(packet, codec.RESET_ESTOP, now_ns)

    def _identify(self, tenths: int) -> None:
        address = self.options.address
        version = self._ask(codec.read_packet(address, codec.GET_VERSION), codec.GET_VERSION)
        if version is None:
            raise self.line.lost(f"no answer at address 0x{address:02X} and {self.options.baud} baud")
        self.firmware = codec.firmware(version.decode("ascii", "replace"))
        if self._ask(codec.read_packet(address, codec.GET_STATUS), codec.GET_STATUS) is None:
            raise self.line.refused("the status reply is not 32 bits wide", "Update the controller firmware")
        self._ask(codec.set_timeout(address, tenths), codec.SET_TIMEOUT)
        readback = self._ask(codec.read_packet(address, codec.GET_TIMEOUT), codec.GET_TIMEOUT)
        if readback != bytes((tenths,)):
            seen = "nothing" if readback is None else f"{readback[0] / 10:g} s"
            raise self.line.refused(
                f"serial time-out set to {tenths / 10:g} s reads back {seen}",
                "Check the firmware version; without the time-out a hung computer leaves the wheels turning",
            )

    def _ask(self, packet: bytes, command: int) -> bytes | None:
        """The reply within ``ANSWER_S``, tried twice."""
        for _ in range(2):
            start_ns = self.line.port.now_ns()
            self._replies.reset()
            self.line.receive()
            self._send(packet, command, start_ns)
            while (left_s := self.ANSWER_S - (self.line.port.now_ns() - start_ns) * 1e-9) > 0.0:
                self.line.port.wait(left_s)
                for answered, data in self._replies.feed(self.line.receive(), self.line.port.now_ns()):
                    if answered == command:
                        return data
                if self._replies.waiting == 0:
                    break
        return None

    def _release(self, now_ns: int) -> None:
        self._send(codec.duty_both(self.options.address, 0, 0), codec.DUTY_BOTH, now_ns)

    def _send(self, packet: bytes, command: int, now_ns: int) -> None:
        if self.line.send(packet):
            self._replies.expect(now_ns, (command,))

    def _take(self, command: int, data: bytes) -> None:
        if command == codec.GET_STATUS:
            self._faults = codec.decode_status(data)
        elif command == codec.GET_MAIN_BATTERY:
            volts = codec.decode_battery(data)
            if volts <= 100.0:
                self.bus_v = volts


def _questions(address: int) -> list[tuple[tuple[int, ...], bytes]]:
    """Commands and packets of ``BATTERY_EVERY`` polls in turn: motion each time, status and battery now and then."""
    turns: list[tuple[int, ...]] = [MOTION] * BATTERY_EVERY
    turns[::STATUS_EVERY] = [(*MOTION, codec.GET_STATUS)] * (BATTERY_EVERY // STATUS_EVERY)
    turns[1] = (*MOTION, codec.GET_MAIN_BATTERY)
    return [(commands, b"".join(codec.read_packet(address, command) for command in commands)) for commands in turns]
