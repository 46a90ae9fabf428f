"""What every emulated controller is: bytes in, bytes out, motors behind, time from outside."""

from collections import Counter
from typing import NamedTuple, Protocol

from contract.messages import MotorSample
from drivers.mock.motor import Motor, MotorLimits


class Wheels(NamedTuple):
    """The robot's two wheels, forward positive."""

    left: Motor
    right: Motor

    @classmethod
    def of(cls, limits: MotorLimits) -> "Wheels":
        return cls(Motor(limits), Motor(limits))

    def advance(self, dt_s: float) -> None:
        self.left.advance(dt_s)
        self.right.advance(dt_s)


class SampleLog:
    """Commands as decoded: both wheels of one command merged, until taken."""

    PAIR_NS = 5_000_000
    """A partner's command later than this does not belong to the same pair."""

    def __init__(self, wheels: Wheels) -> None:
        self._wheels = wheels
        self._samples: list[MotorSample] = []
        self._half: tuple[str, int, bool] | None = None

    def both(self, now_ns: int, enabled: bool, released: bool = False) -> None:
        """One sample of the present setpoints."""
        self._half = None
        left, right = self._wheels
        self._samples.append(
            MotorSample(
                stamp_ns=now_ns,
                left_radps=left.command_radps,
                right_radps=right.command_radps,
                enabled=enabled,
                released=released,
            )
        )

    def one(self, wheel: str, now_ns: int, enabled: bool) -> None:
        """One wheel's command; a sample is made once its partner's came, too."""
        half = self._half
        if half is None:
            self._half = (wheel, now_ns, enabled)
        elif half[0] != wheel and now_ns - half[1] <= self.PAIR_NS:
            self.both(now_ns, enabled and half[2])
        else:
            self.both(half[1], half[2])
            self._half = (wheel, now_ns, enabled)

    def take(self) -> list[MotorSample]:
        taken, self._samples = self._samples, []
        return taken


class EmulatedController(Protocol):
    """One device (or one adapter with its bus), driven by whoever owns the clock."""

    wheels: Wheels
    counters: Counter[str]
    """Bytes and frames it refused, by name."""
    hung: bool
    """Firmware frozen: takes no bytes, sends none, the watchdog is dead, the motors keep their setpoint."""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Advance to ``now_ns``, then take bytes; whatever it sends back at once."""

    def advance(self, now_ns: int) -> bytes:
        """Let time pass: motors, watchdog, cyclic telemetry; whatever it sends."""

    def next_due_ns(self) -> int | None:
        """When ``advance`` is next needed for telemetry or watchdog."""

    def take_samples(self) -> list[MotorSample]: ...

    def brown_out(self, on: bool) -> None:
        """The supply sags below what the device needs; it lets go of the motors and tells it its own way."""

    def set_sensor_sign(self, sign: float) -> None:
        """-1: both encoders count backwards."""
