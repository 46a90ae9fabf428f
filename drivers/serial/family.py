"""What the serial families share: the port in their options, and the check whether it is fast enough."""

from collections import Counter
from collections.abc import Mapping
from typing import Annotated, ClassVar, Protocol, TypeVar

from msgspec import Meta

from drivers.bandwidth import Bandwidth
from drivers.base import Site
from drivers.family import FamilyDrive
from drivers.options import DevicePath, WheelOptions
from drivers.ports import BytePort
from drivers.serial.line import Line

Baud = Annotated[int, Meta(ge=2400, le=4_500_000, description="bit/s, as set in the device; USB ignores it")]


class SerialOptions(WheelOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The port."""

    port: DevicePath
    baud: Baud = 115200


def open_port(options: SerialOptions) -> BytePort:
    """The serial line."""
    from drivers.serial.port import SerialPort

    return SerialPort(options.port, options.baud)


class Reader(Protocol):
    """Cuts the byte stream; what it refuses it counts."""

    counters: Counter[str]


OptionsT = TypeVar("OptionsT", bound=SerialOptions)


class SerialDrive(FamilyDrive[OptionsT, Line]):
    """Base of a :class:`drivers.base.DiffDrive` on a serial line."""

    CYCLE_BYTES: ClassVar[int]
    """Of one control period, both directions."""

    def __init__(self, title: str, robot: str, options: OptionsT, site: Site, port: BytePort, reader: Reader) -> None:
        super().__init__(robot, options, site, Line(f"{title} of {robot}", port))
        self._reader_counters = reader.counters

    @property
    def counters(self) -> Mapping[str, int]:
        return self.line.total() + self._reader_counters

    def open(self) -> None:
        """Check the bandwidth, open the port.

        :raises DriverError:
        """
        self.active = False
        self.require(Bandwidth(self.CYCLE_BYTES, self.options.baud, self.site.control_period_s))
        self.line.open_port()
