"""Two CANopen CiA 402 drives on one bus, profile or cyclic synchronous velocity.

Configuration is by SDO (``canopen`` library): profile and mode checked, PDOs laid out, the heartbeat
consumer 1016h set to ``safety.watchdog_s`` and read back. Monitoring starts with the first heartbeat,
so this computer's heartbeat leaves with every setpoint of an active driver, and with nothing else.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from contract.tables import Fault, show
from drivers.base import STANDSTILL, ControllerFault, Site, WheelSpeeds
from drivers.can import cia402_codec as codec
from drivers.can.family import CanDrive, CanOptions, open_port
from drivers.can.frame import CanFrame
from drivers.conversion import WheelScale
from drivers.family import WheelMotor, pair_faults
from drivers.ports import FramePort

if TYPE_CHECKING:
    from drivers.can.canopen_master import LineNetwork, Slave

__all__ = ["Drive", "Options", "check", "open_port"]

Node = Annotated[int, Meta(ge=1, le=codec.MAX_NODE, description="CANopen node id of the drive")]
VelocityUnits = Annotated[
    float,
    Meta(
        ge=0.0,
        le=1e9,
        description="velocity (60FFh, 606Ch) of one motor turn per second; 0: counts_per_revolution. "
        "Vendors differ: 60 where it counts in rpm, 60 x 512 x counts / 1875 for Kinco",
    ),
]
MODES = {"pv": 3, "csv": 9}
REACTIONS = {"fault": 1, "disable": 2, "quick_stop": 3}


class Options(CanOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "cia402", ... }``"""

    kind: Literal["cia402"]
    left: Node
    right: Node
    master: Annotated[int, Meta(ge=1, le=codec.MAX_NODE, description="node id this computer's heartbeat carries")] = 127
    counts_per_revolution: Annotated[
        int, Meta(ge=1, le=100_000_000, description="position (6064h) per turn of the motor")
    ]
    velocity_per_revps: VelocityUnits = 0.0
    mode: Annotated[
        Literal["pv", "csv"], Meta(description="profile velocity (3) or cyclic synchronous velocity (9)")
    ] = "pv"
    silence_reaction: Annotated[
        Literal["fault", "disable", "quick_stop", "device"],
        Meta(
            description="6007h, what the drive does when the heartbeat stays away; "
            '"device" keeps its own setting and accepts the risk that this is nothing'
        ),
    ] = "fault"


def check(options: Options, path: str) -> list[Fault]:
    """What no single key shows."""
    faults = pair_faults(options.left, options.right, path)
    if options.master in (options.left, options.right):
        faults.append(Fault(f"{path}.master", show(options.master), "must differ from left and right"))
    return faults


class _Axis(WheelMotor):
    """What one wheel's drive last said."""

    def __init__(self, name: str, node: int, options: Options, inverted: bool) -> None:
        counts, gear = float(options.counts_per_revolution), options.gear_ratio
        speed = WheelScale.of(options.velocity_per_revps or counts, gear, inverted)
        super().__init__(name, node, speed, WheelScale.of(counts, gear, inverted), 32)

    def forget(self) -> None:
        super().forget()
        self.state = ""
        self.emergency = 0


class Drive(CanDrive[Options, _Axis]):
    """:class:`drivers.base.DiffDrive` for two CiA 402 drives."""

    ANSWER_S = 0.3
    ENABLE_S = 0.6
    STEP_S = 0.01
    BUS_PERIOD_NS = 1_000_000_000

    def __init__(self, robot: str, options: Options, site: Site, port: FramePort) -> None:
        left = _Axis("left", options.left, options, options.left_inverted)
        right = _Axis("right", options.right, options, options.right_inverted)
        super().__init__("CiA 402 drives", robot, options, site, port, left, right)
        self._network: LineNetwork | None = None
        self._slaves: list[Slave] = []
        self._bus_asked_ns = 0

    def cycle(self) -> Sequence[CanFrame]:
        """Setpoints and our heartbeat, statuswords with speeds, positions."""
        frames = [codec.heartbeat(self.options.master)]
        for axis in self.motors:
            frames += [codec.setpoint(axis.device, 0, 0), CanFrame(codec.TPDO_1 + axis.device, bytes(6))]
            frames.append(CanFrame(codec.TPDO_2 + axis.device, bytes(4)))
        return frames

    def configure(self) -> None:
        try:
            from drivers.can.canopen_master import LineNetwork, Slave
        except ImportError as error:
            raise self.line.refused(
                f"the canopen library is missing ({error})", "Install it: pip install 'ahdc-fieldkit[canopen]'"
            ) from error
        self.open()
        self._network = LineNetwork(self.line)
        self._slaves = [Slave(self._network, axis.device, axis.name) for axis in self.motors]
        try:
            for slave in self._slaves:
                self._set_up(slave, self._by_device[slave.node])
            self._hear_motion()
        except Exception:
            self.close()
            raise

    def activate(self, now_ns: int) -> None:
        for axis in self.motors:
            axis.restart()
            axis.state = ""
        port = self.line.port
        deadline_ns = port.now_ns() + int(self.ENABLE_S * 1e9)
        step = 0
        while not self.enabled() and port.now_ns() < deadline_ns:
            self._raise_foreign_faults(now_ns)
            left, right = [self._next_step(axis, step) for axis in self.motors]
            self.line.send([left, codec.heartbeat(self.options.master), right])
            self.line.wait_until(self.enabled, self.STEP_S)
            step += 1
        if not self.enabled():
            self.deactivate(now_ns)
            raise self._fault("operation enabled not reached: " + ", ".join(self._states()))
        for axis in self.motors:
            axis.emergency = 0
        self.active = True
        self.write(STANDSTILL, now_ns)

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        if self.active:
            left, right = self.motors
            self.line.send(
                (
                    codec.setpoint(left.device, codec.ENABLE, _units(left, speeds.left_radps)),
                    codec.heartbeat(self.options.master),
                    codec.setpoint(right.device, codec.ENABLE, _units(right, speeds.right_radps)),
                )
            )
        else:
            self.line.send([codec.setpoint(axis.device, codec.DISABLE_VOLTAGE, 0) for axis in self.motors])

    def poll(self, now_ns: int) -> None:
        """Process data is cyclic; the bus voltage is asked for once a second. Feeds no watchdog."""
        if now_ns - self._bus_asked_ns > self.BUS_PERIOD_NS:
            self._bus_asked_ns = now_ns
            self.line.send([codec.ask_bus_voltage(self.motors[0].device)])

    def clear_errors(self, now_ns: int) -> None:
        """The rising edge of bit 7 resets a fault; the drive ends in switch-on disabled."""
        for controlword in (codec.DISABLE_VOLTAGE, codec.RESET):
            self.line.send([codec.setpoint(axis.device, controlword, 0) for axis in self.motors])
        for axis in self.motors:
            axis.emergency = 0

    def _set_up(self, slave: "Slave", axis: _Axis) -> None:
        axis.forget()
        slave.order("PRE-OPERATIONAL")
        profile = slave.read(0x1000) & 0xFFFF
        if profile != codec.DRIVE_PROFILE:
            raise self.line.refused(
                f"{slave.name} follows device profile {profile}, not {codec.DRIVE_PROFILE}",
                "Check the node ids: this is no CiA 402 drive",
            )
        mode = MODES[self.options.mode]
        self._set(slave, codec.Write(0x6060, 0, 1, mode), "mode of operation")
        period_ms = max(1, round(self.site.control_period_s * 1e3))
        for order in codec.mapping(axis.device, period_ms):
            slave.write(order)
        timeout_ms = round(self.site.safety.watchdog_s * 1e3)
        self._set(slave, codec.consumer_heartbeat(self.options.master, timeout_ms), "heartbeat consumer")
        if self.options.silence_reaction != "device":
            self._set(slave, codec.Write(0x6007, 0, 2, REACTIONS[self.options.silence_reaction]), "reaction to silence")
        slave.order("OPERATIONAL")

    def _set(self, slave: "Slave", order: codec.Write, what: str) -> None:
        """Write and read back."""
        slave.write(order)
        value = slave.read(order.item, order.subindex)
        if value != order.value:
            raise self.line.refused(
                f"{what} ({order.item:04X}h:{order.subindex}) of {slave.name} set to 0x{order.value:X} "
                f"reads back 0x{value:X}",
                "The drive does not support this setting; without it a hung computer leaves the wheels turning",
            )

    def _hear_motion(self) -> None:
        """:raises LinkLost: a drive sends no process data."""
        self.line.wait_until(lambda: all(axis.state and axis.moved for axis in self.motors), self.ANSWER_S)
        silent = [f"{axis.name} (node {axis.device})" for axis in self.motors if not (axis.state and axis.moved)]
        if silent:
            raise self.line.lost(
                f"no process data from {' and '.join(silent)}",
                "Check the drive's PDO settings: TPDO 1 and 2 must be event driven (type 255) with an event timer",
            )

    def _next_step(self, axis: _Axis, step: int) -> CanFrame:
        """Controlword by the table; out of our own silence's fault by the edge of bit 7."""
        controlword = codec.TO_ENABLED.get(axis.state, codec.DISABLE_VOLTAGE)
        if axis.state == "fault" and step % 2:
            controlword = codec.RESET
        return codec.setpoint(axis.device, controlword, 0)

    def _raise_foreign_faults(self, now_ns: int) -> None:
        """:raises ControllerFault: a fault other than that of our own heartbeat, which activation resets."""
        for slave, axis in zip(self._slaves, self.motors, strict=True):
            if axis.state in ("fault", "fault reaction") and not axis.emergency:
                axis.emergency = slave.read(0x603F) or 0xFFFF
            if axis.state in ("fault", "fault reaction") and axis.emergency != codec.LIFE_GUARD:
                self.deactivate(now_ns)
                raise self._fault(", ".join(self.faults()))

    def _fault(self, fault: str) -> ControllerFault:
        remedy = "Find the cause (603Fh), check supply and encoder, clear the errors, then activate again"
        return self.line.faulty(fault, remedy)

    def enabled(self) -> bool:
        return all(axis.state == codec.ENABLED for axis in self.motors)

    def _states(self) -> list[str]:
        return [f"{axis.name} {axis.state or 'silent'}" for axis in self.motors]

    def faults(self) -> tuple[str, ...]:
        """In words. The heartbeat rests with the driver, too: its absence is no fault before activation."""
        names = []
        for axis in self.motors:
            ours = axis.emergency == codec.LIFE_GUARD and not self.active
            if axis.emergency and not ours:
                names.append(f"{axis.name} {codec.error_name(axis.emergency)}")
            if self.active and axis.state != codec.ENABLED:
                names.append(f"{axis.name} {axis.state}")
        return tuple(names)

    def sender(self, can_id: int) -> int:
        return can_id & 0x7F

    def take(self, motor: _Axis, frame: CanFrame) -> str:
        base = frame.can_id & 0x780
        if base == codec.TPDO_1:
            return self._take_motion(motor, frame.data)
        if base == codec.TPDO_2:
            position = codec.decode_position(frame.data)
            if position is None:
                return "bad_position"
            motor.take_position(position)
        elif base == codec.EMERGENCY:
            code = codec.decode_emergency(frame.data)
            if code is None:
                return "bad_emergency"
            motor.emergency = code or motor.emergency
        elif base == codec.SDO_REPLY:
            return self._take_sdo(frame)
        elif base != codec.HEARTBEAT:
            return "unused_frame"
        return ""

    def _take_motion(self, axis: _Axis, data: bytes) -> str:
        motion = codec.decode_motion(data)
        if motion is None:
            return "bad_motion"
        refusal = axis.take_speed(motion.velocity)
        if not refusal:
            axis.state = codec.state_of(motion.statusword)
        return refusal

    def _take_sdo(self, frame: CanFrame) -> str:
        answer = codec.decode_sdo(frame.data)
        if answer is not None and (answer.item, answer.subindex) == (0x6079, 0):
            if answer.value > 100_000:
                return "bad_bus"
            self.bus_v = answer.value * 1e-3
        elif self._network is not None and len(frame.data) == 8:
            self._network.notify(frame.can_id, bytearray(frame.data), 0.0)
        return ""


def _units(axis: _Axis, radps: float) -> int:
    return round(max(-(2.0**31) + 1, min(2.0**31 - 1, axis.speed.to_device(radps))))
