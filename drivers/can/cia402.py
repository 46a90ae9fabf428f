"""Two CANopen CiA 402 drives on one bus, profile or cyclic synchronous velocity.

Configuration is by SDO (``canopen`` library): profile and mode checked, PDOs laid out, the heartbeat
consumer 1016h set to ``safety.watchdog_s`` and read back. Monitoring starts with the first heartbeat,
so this computer's heartbeat leaves with every setpoint of an active driver, and with nothing else.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from contract.messages import WheelFeedback
from contract.tables import Fault, show
from drivers.base import STANDSTILL, ControllerFault, Site, WheelSpeeds
from drivers.can import cia402_codec as codec
from drivers.can.frame import CanFrame
from drivers.can.line import CanLine
from drivers.conversion import Odometer, WheelScale
from drivers.options import WheelOptions
from drivers.ports import FramePort

if TYPE_CHECKING:
    from drivers.can.canopen_master import LineNetwork, Slave

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


class Options(WheelOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``wheels = { kind = "cia402", ... }``"""

    kind: Literal["cia402"]
    channel: Annotated[
        str, Meta(min_length=1, max_length=200, description="CAN interface (can0), or the adapter's tty for slcan")
    ]
    interface: Annotated[Literal["socketcan", "slcan"], Meta(description="python-can interface")] = "socketcan"
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000, description="bit/s; slcan only, else set it on the link")] = (
        500_000
    )
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
    faults = []
    if options.left == options.right:
        faults.append(Fault(f"{path}.right", show(options.right), "must differ from left"))
    if options.master in (options.left, options.right):
        faults.append(Fault(f"{path}.master", show(options.master), "must differ from left and right"))
    return faults


def open_port(options: Options) -> FramePort:
    """The bus by its python-can interface."""
    from drivers.can.bus import can_port

    return can_port(options.interface, options.channel, options.bitrate)


class _Axis:
    """What one wheel's drive last said."""

    def __init__(self, name: str, node: int, options: Options, inverted: bool) -> None:
        counts, gear = float(options.counts_per_revolution), options.gear_ratio
        self.name = name
        self.node = node
        self.speed = WheelScale.of(options.velocity_per_revps or counts, gear, inverted)
        self.position = WheelScale.of(counts, gear, inverted)
        self.forget()

    def forget(self) -> None:
        self.odometer = Odometer(self.position, 32)
        self.state = ""
        self.emergency = 0
        self.radps: float | None = None
        self.moved = False


class Drive:
    """:class:`drivers.base.DiffDrive` for two CiA 402 drives."""

    ANSWER_S = 0.3
    ENABLE_S = 0.6
    STEP_S = 0.01
    BUS_PERIOD_NS = 1_000_000_000

    def __init__(self, robot: str, options: Options, site: Site, port: FramePort) -> None:
        self.robot = robot
        self.options = options
        self._site = site
        self._line = CanLine(f"CiA 402 drives of {robot}", port, self._take)
        self._axes = (
            _Axis("left", options.left, options, options.left_inverted),
            _Axis("right", options.right, options, options.right_inverted),
        )
        self._by_node = {axis.node: axis for axis in self._axes}
        self._network: LineNetwork | None = None
        self._slaves: list[Slave] = []
        self._bus_v: float | None = None
        self._bus_asked_ns = 0
        self._active = False

    @property
    def counters(self) -> Mapping[str, int]:
        return self._line.total()

    def configure(self) -> None:
        try:
            from drivers.can.canopen_master import LineNetwork, Slave
        except ImportError as error:
            raise self._line.refused(
                f"the canopen library is missing ({error})", "Install it: pip install 'ahdc-fieldkit[canopen]'"
            ) from error
        self._active = False
        self._line.open()
        self._network = LineNetwork(self._line)
        self._slaves = [Slave(self._network, axis.node, axis.name) for axis in self._axes]
        try:
            for slave in self._slaves:
                self._set_up(slave, self._by_node[slave.node])
            self._hear_motion()
        except Exception:
            self.close()
            raise

    def activate(self, now_ns: int) -> None:
        for axis in self._axes:
            axis.odometer = Odometer(axis.position, 32)
            axis.state = ""
        port = self._line.port
        deadline_ns = port.now_ns() + int(self.ENABLE_S * 1e9)
        step = 0
        while not self._enabled() and port.now_ns() < deadline_ns:
            self._raise_foreign_faults(now_ns)
            left, right = [self._next_step(axis, step) for axis in self._axes]
            self._line.send([left, codec.heartbeat(self.options.master), right])
            self._line.wait_until(self._enabled, self.STEP_S)
            step += 1
        if not self._enabled():
            self.deactivate(now_ns)
            raise self._fault("operation enabled not reached: " + ", ".join(self._states()))
        for axis in self._axes:
            axis.emergency = 0
        self._active = True
        self.write(STANDSTILL, now_ns)

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        if self._active:
            left, right = self._axes
            self._line.send(
                (
                    codec.setpoint(left.node, codec.ENABLE, _units(left, speeds.left_radps)),
                    codec.heartbeat(self.options.master),
                    codec.setpoint(right.node, codec.ENABLE, _units(right, speeds.right_radps)),
                )
            )
        else:
            self._line.send([codec.setpoint(axis.node, codec.DISABLE_VOLTAGE, 0) for axis in self._axes])

    def poll(self, now_ns: int) -> None:
        """Process data is cyclic; the bus voltage is asked for once a second. Feeds no watchdog."""
        if now_ns - self._bus_asked_ns > self.BUS_PERIOD_NS:
            self._bus_asked_ns = now_ns
            self._line.send([codec.ask_bus_voltage(self._axes[0].node)])

    def read(self, now_ns: int) -> WheelFeedback | None:
        self._line.drain()
        left, right = self._axes
        if left.radps is None or right.radps is None or not (left.moved and right.moved):
            return None
        feedback = WheelFeedback(
            robot=self.robot,
            stamp_ns=now_ns,
            left_radps=left.radps,
            right_radps=right.radps,
            left_rad=left.odometer.angle_rad,
            right_rad=right.odometer.angle_rad,
            bus_v=self._bus_v,
            enabled=self._active and self._enabled(),
            faults=self._faults(),
        )
        for axis in self._axes:
            axis.radps, axis.moved = None, False
        return feedback

    def stop(self, now_ns: int) -> None:
        self.write(STANDSTILL, now_ns)

    def deactivate(self, now_ns: int) -> None:
        self._active = False
        self.write(STANDSTILL, now_ns)

    def clear_errors(self, now_ns: int) -> None:
        """The rising edge of bit 7 resets a fault; the drive ends in switch-on disabled."""
        for controlword in (codec.DISABLE_VOLTAGE, codec.RESET):
            self._line.send([codec.setpoint(axis.node, controlword, 0) for axis in self._axes])
        for axis in self._axes:
            axis.emergency = 0

    def close(self) -> None:
        self._active = False
        self._line.port.close()

    def fileno(self) -> int | None:
        return self._line.port.fileno()

    def _set_up(self, slave: "Slave", axis: _Axis) -> None:
        axis.forget()
        slave.order("PRE-OPERATIONAL")
        profile = slave.read(0x1000) & 0xFFFF
        if profile != codec.DRIVE_PROFILE:
            raise self._line.refused(
                f"{slave.name} follows device profile {profile}, not {codec.DRIVE_PROFILE}",
                "Check the node ids: this is no CiA 402 drive",
            )
        mode = MODES[self.options.mode]
        self._set(slave, codec.Write(0x6060, 0, 1, mode), "mode of operation")
        period_ms = max(1, round(self._site.control_period_s * 1e3))
        for order in codec.mapping(axis.node, period_ms):
            slave.write(order)
        timeout_ms = round(self._site.safety.watchdog_s * 1e3)
        self._set(slave, codec.consumer_heartbeat(self.options.master, timeout_ms), "heartbeat consumer")
        if self.options.silence_reaction != "device":
            self._set(slave, codec.Write(0x6007, 0, 2, REACTIONS[self.options.silence_reaction]), "reaction to silence")
        slave.order("OPERATIONAL")

    def _set(self, slave: "Slave", order: codec.Write, what: str) -> None:
        """Write and read back."""
        slave.write(order)
        value = slave.read(order.item, order.subindex)
        if value != order.value:
            raise self._line.refused(
                f"{what} ({order.item:04X}h:{order.subindex}) of {slave.name} set to 0x{order.value:X} "
                f"reads back 0x{value:X}",
                "The drive does not support this setting; without it a hung computer leaves the wheels turning",
            )

    def _hear_motion(self) -> None:
        """:raises LinkLost: a drive sends no process data."""
        self._line.wait_until(lambda: all(axis.state and axis.moved for axis in self._axes), self.ANSWER_S)
        silent = [f"{axis.name} (node {axis.node})" for axis in self._axes if not (axis.state and axis.moved)]
        if silent:
            raise self._line.lost(
                f"no process data from {' and '.join(silent)}",
                "Check the drive's PDO settings: TPDO 1 and 2 must be event driven (type 255) with an event timer",
            )

    def _next_step(self, axis: _Axis, step: int) -> CanFrame:
        """Controlword by the table; out of our own silence's fault by the edge of bit 7."""
        controlword = codec.TO_ENABLED.get(axis.state, codec.DISABLE_VOLTAGE)
        if axis.state == "fault" and step % 2:
            controlword = codec.RESET
        return codec.setpoint(axis.node, controlword, 0)

    def _raise_foreign_faults(self, now_ns: int) -> None:
        """:raises ControllerFault: a fault other than that of our own heartbeat, which activation resets."""
        for slave, axis in zip(self._slaves, self._axes, strict=True):
            if axis.state in ("fault", "fault reaction") and not axis.emergency:
                axis.emergency = slave.read(0x603F) or 0xFFFF
            if axis.state in ("fault", "fault reaction") and axis.emergency != codec.LIFE_GUARD:
                self.deactivate(now_ns)
                raise self._fault(", ".join(self._faults()))

    def _fault(self, fault: str) -> ControllerFault:
        return ControllerFault(
            self._line.device,
            self._line.port.name,
            fault,
            "Find the cause (603Fh), check supply and encoder, clear the errors, then activate again",
        )

    def _enabled(self) -> bool:
        return all(axis.state == codec.ENABLED for axis in self._axes)

    def _states(self) -> list[str]:
        return [f"{axis.name} {axis.state or 'silent'}" for axis in self._axes]

    def _faults(self) -> tuple[str, ...]:
        """In words. The heartbeat rests with the driver, too: its absence is no fault before activation."""
        names = []
        for axis in self._axes:
            ours = axis.emergency == codec.LIFE_GUARD and not self._active
            if axis.emergency and not ours:
                names.append(f"{axis.name} {codec.error_name(axis.emergency)}")
            if self._active and axis.state != codec.ENABLED:
                names.append(f"{axis.name} {axis.state}")
        return tuple(names)

    def _take(self, frame: CanFrame) -> str:
        """Handle one frame; the counter to raise if it was refused."""
        base, node = frame.can_id & 0x780, frame.can_id & 0x7F
        axis = self._by_node.get(node)
        if axis is None or frame.extended:
            return "foreign_frame"
        if frame.remote:
            return "remote_frame"
        if base == codec.TPDO_1:
            return self._take_motion(axis, frame.data)
        if base == codec.TPDO_2:
            position = codec.decode_position(frame.data)
            if position is None:
                return "bad_position"
            axis.odometer.update(position)
            axis.moved = True
        elif base == codec.EMERGENCY:
            code = codec.decode_emergency(frame.data)
            if code is None:
                return "bad_emergency"
            axis.emergency = code or axis.emergency
        elif base == codec.SDO_REPLY:
            return self._take_sdo(frame)
        elif base != codec.HEARTBEAT:
            return "unused_frame"
        return ""

    def _take_motion(self, axis: _Axis, data: bytes) -> str:
        motion = codec.decode_motion(data)
        if motion is None:
            return "bad_motion"
        radps = axis.speed.to_wheel(motion.velocity)
        if abs(radps) > 200.0:
            return "implausible_speed"
        axis.radps = radps
        axis.state = codec.state_of(motion.statusword)
        return ""

    def _take_sdo(self, frame: CanFrame) -> str:
        answer = codec.decode_sdo(frame.data)
        if answer is not None and (answer.item, answer.subindex) == (0x6079, 0):
            if answer.value > 100_000:
                return "bad_bus"
            self._bus_v = answer.value * 1e-3
        elif self._network is not None and len(frame.data) == 8:
            self._network.notify(frame.can_id, bytearray(frame.data), 0.0)
        return ""


def _units(axis: _Axis, radps: float) -> int:
    return round(max(-(2.0**31) + 1, min(2.0**31 - 1, axis.speed.to_device(radps))))
