"""A driver behind the last gate: the only form in which the registry hands one out."""

import contextlib
from collections.abc import Mapping

from contract.messages import WheelFeedback
from drivers.base import STANDSTILL, ControllerFault, DiffDrive, DriverError, LinkLost, Site, WheelSpeeds
from drivers.gate import Gate, GateLimits
from drivers.health import Health
from drivers.trim import Trim


def limits_of(site: Site) -> GateLimits:
    """Gate bounds from the arena's platform and safety tables."""
    return GateLimits(
        site.max_wheel_radps,
        site.safety.max_slew_mps2 / site.platform.wheel_radius_m,
        int(site.safety.command_age_s * 1e9),
    )


class GatedDrive:
    """:class:`drivers.base.DiffDrive` whose every motion passes :class:`drivers.gate.Gate`.

    ``poll`` also sends the gate's zero when no command came in time, so calling it on a timer
    both stops a robot whose control law went silent and feeds the device watchdog at standstill.
    """

    def __init__(self, inner: DiffDrive, gate: Gate, health: Health, trim: Trim | None = None) -> None:
        self.inner = inner
        self.trim = Trim() if trim is None else trim
        self._trimmed = not self.trim.idle
        self.gate = gate
        self.health = health

    @property
    def device(self) -> str:
        return self.inner.device

    @property
    def port_name(self) -> str:
        return self.inner.port_name

    @property
    def dead_zone_radps(self) -> float:
        return self.inner.dead_zone_radps

    @property
    def counters(self) -> Mapping[str, int]:
        """The driver's own, and the gate's as ``gate_<reason>``."""
        return {**self.inner.counters, **{f"gate_{name}": count for name, count in self.gate.counters.items()}}

    def configure(self) -> None:
        self.inner.configure()

    def activate(self, now_ns: int) -> None:
        self.inner.activate(now_ns)
        self.gate.arm(now_ns)
        self.health.start(now_ns)

    def write(self, speeds: WheelSpeeds, now_ns: int, stamp_ns: int | None = None) -> None:
        """:param stamp_ns: when the command was computed, if earlier than ``now_ns``."""
        permitted = self.gate.permit(speeds, now_ns if stamp_ns is None else stamp_ns, now_ns)
        self.inner.write(self.trim.outward(*permitted) if self._trimmed else permitted, now_ns)
        self.health.command = permitted

    def poll(self, now_ns: int) -> None:
        if self.gate.tick(now_ns) is not None:
            self.health.command = STANDSTILL
            self.inner.write(STANDSTILL, now_ns)
        self.inner.poll(now_ns)

    def read(self, now_ns: int) -> WheelFeedback | None:
        sample = self.inner.read(now_ns)
        if sample is not None:
            self.health.measured(sample, now_ns)
            if self._trimmed:
                sample = self.trim.sample(sample)
        return sample

    def why_silent(self) -> str:
        return self.inner.why_silent()

    def check(self, now_ns: int) -> None:
        """Between commands and feedback: does the drive do what it is told?

        :raises LinkLost: no telemetry although the motors are enabled.
        :raises ControllerFault: a wheel that stands or turns the other way, or under-voltage.
        """
        why = self.inner.why_silent() if self.health.quiet(now_ns) else ""
        complaint = self.health.complaint(now_ns)
        if complaint is not None:
            kind = LinkLost if complaint.silent else ControllerFault
            fault = f"{complaint.fault}; {why}" if why else complaint.fault
            raise kind(self.device, self.port_name, fault, complaint.remedy)

    def reported(self, sample: WheelFeedback) -> ControllerFault:
        """The faults a sample names, as an error of this device."""
        remedy = "Remove the cause, then release (which clears errors) and arm again"
        return ControllerFault(self.device, self.port_name, ", ".join(sample.faults), remedy)

    def stop(self, now_ns: int) -> None:
        self.gate.stop(now_ns)
        self.health.command = STANDSTILL
        self.inner.stop(now_ns)

    def deactivate(self, now_ns: int) -> None:
        self.gate.disarm(now_ns)
        self.health.rest()
        self.inner.deactivate(now_ns)

    def clear_errors(self, now_ns: int) -> None:
        self.inner.clear_errors(now_ns)

    def close(self) -> None:
        """Disables the motors if it still can."""
        if self.inner.fileno() is not None:
            with contextlib.suppress(DriverError):
                self.inner.deactivate(0)
        self.gate.disarm(0)
        self.health.rest()
        self.inner.close()

    def fileno(self) -> int | None:
        return self.inner.fileno()
