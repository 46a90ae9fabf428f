"""What every wheel driver is: one lifecycle, one feedback type, typed errors.

The lifecycle is that of ros2_control hardware components::

    configure -> activate -> (write | poll | read)* -> stop -> deactivate -> close

A driver never re-enables motors by itself: after any :class:`DriverError` the way back is
``close``, ``configure``, ``activate``.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from contract.arena import Platform, Safety
from contract.messages import WheelFeedback


class WheelSpeeds(NamedTuple):
    """Wheel speeds of a differential drive, rad/s of the *wheel*, forward positive."""

    left_radps: float
    right_radps: float


STANDSTILL = WheelSpeeds(0.0, 0.0)


class Site(NamedTuple):
    """What a driver must know about the robot it sits in."""

    platform: Platform = Platform()
    safety: Safety = Safety()
    max_speed_mps: float = 0.8
    control_period_s: float = 0.01

    @property
    def max_wheel_radps(self) -> float:
        """Wheel speed at the platform's greatest rim speed."""
        return self.max_speed_mps / self.platform.wheel_radius_m


class DriverError(Exception):
    """A wheel controller cannot do what is asked; ``remedy`` says what a person can do."""

    def __init__(self, device: str, port: str, fault: str, remedy: str) -> None:
        self.device = device
        self.port = port
        self.fault = fault
        self.remedy = remedy
        super().__init__(f"{device} on {port}: {fault}. {remedy}")


class LinkLost(DriverError):
    """The port or bus is gone, silent, or no longer takes bytes."""


class Refused(DriverError):
    """The configuration is unsafe or impossible; nothing was enabled."""


class ControllerFault(DriverError):
    """The controller answers and reports a fault of its own."""


class DiffDrive(Protocol):
    """Two wheels, one controller (or one bus). All calls but configure and activate return at once."""

    @property
    def device(self) -> str:
        """What errors call it, such as ``ODrive of r06``."""

    @property
    def port_name(self) -> str:
        """Device path or bus."""

    @property
    def dead_zone_radps(self) -> float:
        """Commands slower than this do not turn the wheels."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Everything refused or lost so far, by name."""

    def configure(self) -> None:
        """Open the port, identify the device, check bandwidth, set and read back its watchdog.

        Bounded by about a second. Enables nothing.

        :raises DriverError:
        """

    def activate(self, now_ns: int) -> None:
        """Clear the setpoint, enable the motors at zero speed and confirm it; bounded by a second.

        :raises DriverError:
        """

    def write(self, speeds: WheelSpeeds, now_ns: int) -> None:
        """Send both wheel speeds in one bus write; never waits.

        :raises LinkLost: the port is gone.
        """

    def poll(self, now_ns: int) -> None:
        """Ask for telemetry where the family needs asking. Call once per control step, after ``write``."""

    def read(self, now_ns: int) -> WheelFeedback | None:
        """Drain the port; the newest complete sample, or None if nothing new arrived.

        :raises LinkLost: the port is gone.
        """

    def why_silent(self) -> str:
        """Ask the port, without waiting, why nothing arrives; what it last answered, '' if it does not know."""

    def stop(self, now_ns: int) -> None:
        """Zero setpoint now. Never refused; nothing but ``activate`` lets the wheels turn again."""

    def deactivate(self, now_ns: int) -> None:
        """Disable the motors."""

    def clear_errors(self, now_ns: int) -> None:
        """Reset the controller's latched faults; enables nothing."""

    def close(self) -> None:
        """Release the port; callable in any state, any number of times."""

    def fileno(self) -> int | None:
        """Descriptor that becomes readable with new telemetry; None while closed."""
