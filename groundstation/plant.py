"""A robot's motors and body in virtual time, advanced in closed form. Pure."""

from dataclasses import dataclass, field
from math import cos, sin
from typing import NamedTuple

from onboard.ahdc.parameters import Vector
from onboard.ahdc.stopping import Brake, rim_after
from onboard.odometry import Pose
from onboard.record import record

REST = (0.0, 0.0)
COAST = Brake(0.6, 0.0)
"""How released motors roll on unless an arena file says otherwise."""
AT_REST_MPS = 1e-7
"""Wheels slower than this together stand."""


class Plant(NamedTuple):
    """One robot's body and motors at the start of a mission."""

    pose: Pose
    brake: Brake


@dataclass(slots=True)
class Body:
    """One robot's motors and body."""

    start: Pose
    brake: Brake
    left_mps: float = 0.0
    right_mps: float = 0.0
    command: Vector = REST
    """Rim speeds asked of the motors, m/s."""
    time_ns: int = 0
    release_ns: int | None = None
    """When the device watchdog lets go of the motors, unless it is fed before."""
    coast: Brake = COAST
    x_m: float = field(init=False)
    y_m: float = field(init=False)
    heading_rad: float = field(init=False)

    def __post_init__(self) -> None:
        self.place(self.start)

    @property
    def pose(self) -> Pose:
        return record(Pose, (self.x_m, self.y_m, self.heading_rad))

    def place(self, pose: Pose) -> None:
        """Put it there."""
        self.x_m, self.y_m, self.heading_rad = pose

    def advance(self, now_ns: int, wheel_separation_m: float) -> None:
        """Come to that time, each rim by :func:`rim_after`, the body on the arc of both ways; never back."""
        command, brake, release_ns = self.command, self.brake, self.release_ns
        if release_ns is not None:
            if self.time_ns < release_ns < now_ns:
                self.advance(release_ns, wheel_separation_m)
            if self.time_ns >= release_ns:
                command, brake = REST, self.coast
        duration_s = (now_ns - self.time_ns) * 1e-9
        if duration_s <= 0:
            return
        self.time_ns = now_ns
        left, right = self.left_mps, self.right_mps
        to_left, to_right = command
        if left == right == to_left == to_right == 0.0:
            return
        if left == to_left:
            left_m = left * duration_s
        else:
            left, left_m = rim_after(left, to_left, brake, duration_s)
        if right == to_right:
            right_m = right * duration_s
        else:
            right, right_m = rim_after(right, to_right, brake, duration_s)
        if -AT_REST_MPS < left < AT_REST_MPS and abs(left) + abs(right) < AT_REST_MPS:
            left = right = 0.0
        self.left_mps, self.right_mps = left, right
        if left_m == 0.0 == right_m:
            return
        turn = (right_m - left_m) / wheel_separation_m
        chord, half = (left_m + right_m) / 2, turn / 2
        if not -1e-6 < turn < 1e-6:
            chord = chord * sin(half) / half
        middle = self.heading_rad + half
        self.x_m += chord * cos(middle)
        self.y_m += chord * sin(middle)
        self.heading_rad += turn
