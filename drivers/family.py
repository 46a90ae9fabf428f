"""What every family's driver shares: the lifecycle's small change, the feedback, the checks before opening."""

from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from contract.messages import WheelFeedback
from contract.tables import Fault, show
from drivers.bandwidth import Load
from drivers.base import STANDSTILL, Site, WheelSpeeds
from drivers.conversion import Odometer, WheelScale
from drivers.line import DeviceLine
from drivers.options import WheelOptions

MAX_RADPS = 200.0
"""No wheel here turns faster; a device that says so is not believed."""

OptionsT = TypeVar("OptionsT", bound=WheelOptions)
LineT = TypeVar("LineT", bound=DeviceLine[Any])


def pair_faults(left: int, right: int, path: str) -> list[Fault]:
    """Two wheels need two devices or channels."""
    return [Fault(f"{path}.right", show(right), "must differ from left")] if left == right else []


def undeclared(watchdog_s: float | None, path: str, text: str) -> list[Fault]:
    """A watchdog the wire cannot set must be stated."""
    return [Fault(f"{path}.watchdog_s", "", f"missing; {text}")] if watchdog_s is None else []


class WheelMotor:
    """What one wheel's controller last said."""

    def __init__(self, name: str, device: int, speed: WheelScale, position: WheelScale, bits: int | None) -> None:
        self.name = name
        self.device = device
        self.speed = speed
        self._speed_units = speed.units_per_rad
        self.position = position
        self._bits = bits
        self.forget()

    def forget(self) -> None:
        """Nothing was heard yet."""
        self.restart()
        self.radps: float | None = None
        self.moved = False

    def restart(self) -> None:
        """Angles count from the next position."""
        self._odometer = Odometer(self.position, self._bits)
        self.angle_rad = 0.0

    def take_speed(self, units: float) -> str:
        """Note a speed in device units; the counter to raise if it cannot be."""
        radps = units / self._speed_units
        if not -MAX_RADPS <= radps <= MAX_RADPS:
            return "implausible_speed"
        self.radps = radps
        return ""

    def take_motion(self, speed: float, position: float) -> str:
        """Note both, in device units, unless the speed cannot be; the counter to raise then."""
        radps = speed / self._speed_units
        if not -MAX_RADPS <= radps <= MAX_RADPS:
            return "implausible_speed"
        self.radps = radps
        self.angle_rad = self._odometer.update(position)
        self.moved = True
        return ""

    def take_position(self, units: float) -> None:
        self.angle_rad = self._odometer.update(units)
        self.moved = True


class FamilyDrive(Generic[OptionsT, LineT]):
    """Base of a :class:`drivers.base.DiffDrive`; a family adds configure, activate, write, read, deactivate."""

    def __init__(self, robot: str, options: OptionsT, site: Site, line: LineT) -> None:
        self.robot = robot
        self.options = options
        self.site = site
        self.line = line
        self.active = False
        """Between ``activate`` and ``deactivate``."""
        self.bus_v: float | None = None

    @property
    def device(self) -> str:
        return self.line.device

    @property
    def port_name(self) -> str:
        return str(self.line.port.name)

    @property
    def dead_zone_radps(self) -> float:
        return 0.0

    @property
    def counters(self) -> Mapping[str, int]:
        return self.line.total()

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        raise NotImplementedError

    def poll(self, now_ns: int) -> None:
        """Nothing: telemetry is cyclic."""

    def why_silent(self) -> str:
        return ""

    def stop(self, now_ns: int) -> None:
        self.write(STANDSTILL, now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Zero once more, after which ``write`` moves nothing."""
        self.active = False
        self.write(STANDSTILL, now_ns)

    def clear_errors(self, now_ns: int) -> None:
        """Nothing: the device latches none."""

    def close(self) -> None:
        self.active = False
        self.line.port.close()

    def fileno(self) -> int | None:
        number: int | None = self.line.port.fileno()
        return number

    def require(self, load: Load) -> None:
        """:raises Refused: the wire cannot carry a control period's traffic; with the arithmetic."""
        if not load.fits:
            raise self.line.refused(str(load), "Raise the bit rate, or control.control_period_s")

    def accept_watchdog(self, declared_s: float | None, remedy: str) -> None:
        """:raises Refused: the stated device watchdog is unknown or too long."""
        limit_s = self.site.safety.watchdog_s
        if declared_s is None:
            raise self.line.refused("the device watchdog is unknown", remedy)
        if declared_s > limit_s:
            raise self.line.refused(
                f"watchdog_s = {declared_s} s exceeds safety.watchdog_s = {limit_s:g} s; the wheels would turn on "
                f"for {declared_s * self.site.max_speed_mps:.2f} m",
                remedy,
            )

    def feedback(
        self,
        now_ns: int,
        left: tuple[float, float],
        right: tuple[float, float],
        *,
        enabled: bool = True,
        faults: tuple[str, ...] = (),
    ) -> WheelFeedback:
        """:param left: speed in rad/s and angle in rad of the wheel.
        :param right: as ``left``.
        """
        return WheelFeedback(
            robot=self.robot,
            stamp_ns=now_ns,
            left_radps=left[0],
            right_radps=right[0],
            left_rad=left[1],
            right_rad=right[1],
            bus_v=self.bus_v,
            enabled=self.active and enabled,
            faults=faults,
        )
