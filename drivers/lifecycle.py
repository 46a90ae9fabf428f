"""The driver's lifecycle as the agent's orders demand it: ready, active, failed. No I/O of its own."""

from collections.abc import Mapping
from typing import Protocol

from contract.messages import WheelFeedback
from drivers.base import DriverError, LinkLost, WheelSpeeds
from drivers.gated import GatedDrive

REOPEN_NS = 250_000_000
LOOK_NS = 50_000_000
GARBLED_NS = 250_000_000
LINE_ERRORS = ("slcan_garbage", "slcan_refused", "error_frame", "bad_crc")
"""Driver counters that say the line damages bytes. A foreign frame on a shared bus is none of them, and
neither is a late or missing reply: that is silence, which the supervisor judges by the age of the feedback."""


class Listener(Protocol):
    """Who is told what the driver does (the agent)."""

    def feedback(self, sample: WheelFeedback, now_ns: int) -> None: ...
    def driver_fault(self, text: str, remedy: str, now_ns: int) -> None: ...
    def driver_active(self, active: bool, now_ns: int) -> None: ...


class LineCheck:
    """Tells a line that damages bytes all the time from one that did so once.

    A text bus has no checksum: of two wheels' commands one may get through damaged lines for ever,
    with feedback still coming. So damage in every look for ``GARBLED_NS`` is a fault of the link.
    """

    def __init__(self) -> None:
        self._errors = 0
        self._looked_ns = 0
        self._clean_ns = 0

    def due(self, now_ns: int) -> bool:
        """Whether it is time to look again."""
        return now_ns - self._looked_ns >= LOOK_NS

    def garbled(self, counters: Mapping[str, int], now_ns: int) -> int:
        """Errors so far if the line is not fit to drive on, else 0; to be called when :meth:`due`."""
        errors = sum(counters.get(name, 0) for name in LINE_ERRORS)
        if errors == self._errors or now_ns - self._looked_ns > 4 * LOOK_NS:
            self._clean_ns = now_ns
        self._errors, self._looked_ns = errors, now_ns
        return errors if now_ns - self._clean_ns > GARBLED_NS else 0


class Wheels:
    """One robot's driver. A driver that failed is opened again only while its robot is disarmed."""

    def __init__(self, driver: GatedDrive, listener: Listener) -> None:
        self.driver = driver
        self.ready = False
        self.active = False
        self._listener = listener
        self._line = LineCheck()
        self._retry_ns = 0
        self._faulty = False
        """It has failed, or named a fault, since it was opened."""
        self._again = False
        self._reported: tuple[str, ...] = ()

    def open(self, now_ns: int, again: bool = False) -> bool:
        """Configure, at intervals; a fault is told to the listener, success clears it, and the controller's errors.

        :param again: the robot was released just now: start over, also at a later call, if the controller has named a
            fault, although the port works.
        """
        self._again = self._again or (again and self._faulty)
        if self.active or (self.ready and not self._again) or now_ns < self._retry_ns:
            return self.ready
        self.ready = False
        self._retry_ns = now_ns + REOPEN_NS
        try:
            self.driver.close()
            self.driver.configure()
            if self._faulty:
                self.driver.clear_errors(now_ns)
        except DriverError as error:
            self._listener.driver_fault(str(error), error.remedy, now_ns)
            return False
        self.ready = True
        self._faulty = self._again = False
        self._reported = ()
        self._listener.driver_fault("", "", now_ns)
        return True

    def drive(self, enable: bool, speeds: WheelSpeeds, now_ns: int, stamp_ns: int | None = None) -> bool:
        """Bring the driver to what is asked and write the speeds; True if a write went out.

        :param stamp_ns: when the speeds were computed, if earlier than ``now_ns``; the gate refuses old ones.
        """
        if not self.ready or (not enable and not self.active):
            return False
        try:
            if not enable:
                self.driver.stop(now_ns)
                self.driver.deactivate(now_ns)
                self._set_active(False, now_ns)
                return False
            if not self.active:
                self.driver.activate(now_ns)
                self._set_active(True, now_ns)
                return False
            self.driver.write(speeds, now_ns, stamp_ns)
        except DriverError as error:
            self._fail(error, now_ns)
            return False
        return True

    def ask(self, now_ns: int) -> None:
        """Request telemetry where the family needs asking."""
        if self.active:
            try:
                self.driver.poll(now_ns)
            except DriverError as error:
                self._fail(error, now_ns)

    def listen(self, now_ns: int) -> None:
        """Hand the newest sample to the listener, faults it names before it."""
        if not self.ready:
            return
        try:
            sample = self.driver.read(now_ns)
            if self.active:
                self.driver.check(now_ns)
                if self._line.due(now_ns):
                    self._check_line(now_ns)
        except DriverError as error:
            self._fail(error, now_ns)
            return
        if sample is not None:
            self._name_faults(sample, now_ns)
            self._listener.feedback(sample, now_ns)

    def _name_faults(self, sample: WheelFeedback, now_ns: int) -> None:
        """What disabled motors no longer report is gone; without that, errors told once more after they were cleared,
        in a cyclic message, would stay for good."""
        if sample.faults == self._reported:
            return
        self._reported = sample.faults
        if sample.faults:
            self._faulty = True
            error = self.driver.reported(sample)
            self._listener.driver_fault(str(error), error.remedy, now_ns)
        elif not self.active:
            self._listener.driver_fault("", "", now_ns)

    def _check_line(self, now_ns: int) -> None:
        """:raises LinkLost: the line damages bytes all the time."""
        if errors := self._line.garbled(self.driver.counters, now_ns):
            raise LinkLost(
                self.driver.device,
                self.driver.port_name,
                f"the line damages bytes ({errors} errors)",
                "Check cable and termination",
            )

    def shut(self, now_ns: int) -> None:
        """Zero, disable, release the port, whatever fails on the way."""
        for action in (self.driver.stop, self.driver.deactivate):
            try:
                action(now_ns)
            except DriverError:
                continue
        self.driver.close()
        self.ready = False

    def _set_active(self, active: bool, now_ns: int) -> None:
        self.active = active
        self._listener.driver_active(active, now_ns)

    def _fail(self, error: DriverError, now_ns: int) -> None:
        for action in (self.driver.stop, self.driver.deactivate):
            try:
                action(now_ns)
            except DriverError:
                continue
        self.ready = False
        self._faulty = True
        self._retry_ns = now_ns + REOPEN_NS
        self._set_active(False, now_ns)
        self._listener.driver_fault(str(error), error.remedy, now_ns)
