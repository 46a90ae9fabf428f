"""What the CAN families share: the bus in their options, two motors, frames dealt out by device.

A family says which device a frame is from (``sender``), what it means (``take``), which frames one
control period carries (``cycle``), and how it enables, drives and releases.
"""

from collections.abc import Sequence
from typing import Annotated, Generic, Literal, TypeVar

from msgspec import Meta

from contract.messages import WheelFeedback
from drivers.base import Site
from drivers.can.bandwidth import BusLoad
from drivers.can.frame import CanFrame
from drivers.can.line import CanLine
from drivers.family import FamilyDrive, WheelMotor
from drivers.options import WheelOptions
from drivers.ports import FramePort


class CanOptions(WheelOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The bus."""

    channel: Annotated[
        str, Meta(min_length=1, max_length=200, description="CAN interface (can0), or the adapter's tty for slcan")
    ]
    interface: Annotated[Literal["socketcan", "slcan"], Meta(description="python-can interface")] = "socketcan"
    bitrate: Annotated[
        int,
        Meta(ge=10_000, le=1_000_000, description="bit/s of the bus; a socketcan link must have been set to the same"),
    ] = 500_000


def open_port(options: CanOptions) -> FramePort:
    """The bus by its python-can interface."""
    from drivers.can.bus import can_port

    return can_port(options.interface, options.channel, options.bitrate)


OptionsT = TypeVar("OptionsT", bound=CanOptions)
MotorT = TypeVar("MotorT", bound=WheelMotor)


class CanDrive(FamilyDrive[OptionsT, CanLine], Generic[OptionsT, MotorT]):
    """Base of a :class:`drivers.base.DiffDrive` with one CAN device a wheel."""

    EXTENDED = False
    """29-bit identifiers."""
    POSITION_EACH_SAMPLE = True
    """A sample needs a new position of both wheels, not only a new speed."""

    def __init__(
        self, title: str, robot: str, options: OptionsT, site: Site, port: FramePort, left: MotorT, right: MotorT
    ) -> None:
        super().__init__(robot, options, site, CanLine(f"{title} of {robot}", port, self._deal))
        self.motors = (left, right)
        self._by_device = {motor.device: motor for motor in self.motors}

    def sender(self, can_id: int) -> int:
        """Device a frame came from."""
        raise NotImplementedError

    def take(self, motor: MotorT, frame: CanFrame) -> str:
        """Believe one frame of a motor's; the counter to raise if it was refused."""
        raise NotImplementedError

    def cycle(self) -> Sequence[CanFrame]:
        """Frames one control period puts on the bus, telemetry included."""
        raise NotImplementedError

    def enabled(self) -> bool:
        """The devices say that they follow setpoints."""
        return True

    def faults(self) -> tuple[str, ...]:
        """The devices' own, in words."""
        return ()

    def open(self) -> None:
        """Check the bus load, open the bus, believe nothing heard before.

        :raises DriverError:
        """
        self.active = False
        self.require(BusLoad(self.cycle(), self.options.bitrate, self.site.control_period_s))
        self.line.open_port()
        for motor in self.motors:
            motor.forget()

    def read(self, now_ns: int) -> WheelFeedback | None:
        self.line.drain()
        left, right = self.motors
        if left.radps is None or right.radps is None or not (left.moved and right.moved):
            return None
        sample = self.feedback(
            now_ns,
            (left.radps, left.angle_rad),
            (right.radps, right.angle_rad),
            enabled=self.enabled(),
            faults=self.faults(),
        )
        left.radps = right.radps = None
        if self.POSITION_EACH_SAMPLE:
            left.moved = right.moved = False
        return sample

    def why_silent(self) -> str:
        return self.line.port.inquire()

    def _deal(self, frame: CanFrame) -> str:
        motor = self._by_device.get(self.sender(frame.can_id))
        if motor is None or frame.extended != self.EXTENDED:
            return "foreign_frame"
        if frame.remote:
            return "remote_frame"
        return self.take(motor, frame)
