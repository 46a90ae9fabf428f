"""From the motion-capture system's axes to the arena frame and back. Pure.

The wire has no up axis: it is configuration. Y-up becomes z-up by p' = (x, -z, y),
q' = (qx, -qz, qy, qw); then origin and rotation of the arena file apply. A body's heading is the
direction of its x axis seen from above.
"""

import math
from math import atan2, pi

from msgspec import Struct

from contract.arena import Mocap

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Pose(Struct, frozen=True, gc=False):
    """A body in the arena frame; ``up`` is the cosine of its tilt."""

    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    up: float


class ArenaFrame:
    """The arena frame as seen by one motion-capture system."""

    def __init__(self, mocap: Mocap) -> None:
        self.y_up = mocap.up_axis == "y"
        self.origin_m = mocap.origin_m
        self.rotation_rad = mocap.rotation_rad
        self.cosine, self.sine = math.cos(mocap.rotation_rad), math.sin(mocap.rotation_rad)

    def pose(self, position: Vector, rotation: Quaternion, offset_rad: float = 0.0) -> Pose:
        """A body's pose from the source's coordinates; ``rotation`` (x, y, z, w) need not have norm 1.

        ``offset_rad`` is the robot's heading minus its body's. A zero quaternion gives no tilt to
        trust: check the norm first.
        """
        return self.pose_of(*position, *rotation, offset_rad)

    def pose_of(
        self, x: float, y: float, z: float, qx: float, qy: float, qz: float, qw: float, offset_rad: float
    ) -> Pose:
        """:meth:`pose`, number by number."""
        if self.y_up:
            y, z = -z, y
            qy, qz = -qz, qy
        ox, oy = self.origin_m
        x -= ox
        y -= oy
        xx, yy, zz = qx * qx, qy * qy, qz * qz
        norm = xx + yy + zz + qw * qw
        heading = atan2(2.0 * (qx * qy + qz * qw), norm - 2.0 * (yy + zz)) - self.rotation_rad + offset_rad
        if not -pi <= heading <= pi:
            heading = math.remainder(heading, math.tau)
        cosine, sine = self.cosine, self.sine
        return Pose(cosine * x + sine * y, cosine * y - sine * x, z, heading, 1.0 - 2.0 * (xx + yy) / norm)

    def source(
        self, x_m: float, y_m: float, heading_rad: float, z_m: float = 0.0, offset_rad: float = 0.0
    ) -> tuple[Vector, Quaternion]:
        """The inverse for an upright body: position and rotation in the source's coordinates."""
        x = self.cosine * x_m - self.sine * y_m + self.origin_m[0]
        y = self.sine * x_m + self.cosine * y_m + self.origin_m[1]
        half = 0.5 * (heading_rad - offset_rad + self.rotation_rad)
        sine, cosine = math.sin(half), math.cos(half)
        if self.y_up:
            return (x, z_m, -y), (0.0, sine, 0.0, cosine)
        return (x, y, z_m), (0.0, 0.0, sine, cosine)
