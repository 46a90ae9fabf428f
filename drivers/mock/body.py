"""A virtual robot body: a differential drive rolling without slip on measured wheel angles."""

import math

from contract.arena import Platform
from contract.units import Point


class Body:
    """Pose in the arena frame, integrated as exact arcs of wheel-angle differences."""

    def __init__(self, platform: Platform, start: Point, heading_rad: float) -> None:
        self.left_radius_m = platform.wheel_radius_m
        self.right_radius_m = platform.wheel_radius_m
        self.separation_m = platform.wheel_separation_m
        """True dimensions: a calibration test makes them differ from the nominal ones."""
        self.x_m, self.y_m = start
        self.heading_rad = heading_rad
        self._left_rad = 0.0
        self._right_rad = 0.0
        self._rolled = False
        """The heading is a remainder already."""

    def roll(self, left_rad: float, right_rad: float) -> None:
        """Move to these total wheel angles."""
        if left_rad == self._left_rad and right_rad == self._right_rad and self._rolled:
            return
        left, right = left_rad - self._left_rad, right_rad - self._right_rad
        self._left_rad, self._right_rad, self._rolled = left_rad, right_rad, True
        self.x_m, self.y_m, self.heading_rad = self.ahead(left, right)

    def ahead(self, left_rad: float, right_rad: float) -> tuple[float, float, float]:
        """x in m, y in m, heading in rad, were the wheels turned on by these angles."""
        left_m, right_m = left_rad * self.left_radius_m, right_rad * self.right_radius_m
        distance_m, turn_rad = 0.5 * (left_m + right_m), (right_m - left_m) / self.separation_m
        half = 0.5 * turn_rad
        chord_m = distance_m * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
        return (
            self.x_m + chord_m * math.cos(self.heading_rad + half),
            self.y_m + chord_m * math.sin(self.heading_rad + half),
            math.remainder(self.heading_rad + turn_rad, 2.0 * math.pi),
        )

    def place(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Carry the robot somewhere by hand."""
        self.x_m, self.y_m, self.heading_rad, self._rolled = x_m, y_m, heading_rad, False

    def speed_mps(self, left_radps: float, right_radps: float) -> float:
        """Forward speed at these wheel speeds."""
        return 0.5 * (left_radps * self.left_radius_m + right_radps * self.right_radius_m)
