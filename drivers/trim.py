"""A robot's calibration between the speeds the control law means and those its own wheels must turn at. Pure.

Names as in ros2_control's ``diff_drive_controller``: the multipliers scale the nominal wheel radii and
wheel separation of the platform to those of this robot.
"""

from typing import NamedTuple

import msgspec

from contract.messages import WheelFeedback
from drivers.base import WheelSpeeds


class Trim(NamedTuple):
    """Real over nominal dimension."""

    left_radius: float = 1.0
    right_radius: float = 1.0
    separation: float = 1.0

    @property
    def idle(self) -> bool:
        return self == (1.0, 1.0, 1.0)

    def outward(self, left: float, right: float) -> WheelSpeeds:
        """Nominal wheel speeds to those that move this robot alike."""
        mean, half = 0.5 * (left + right), 0.5 * (right - left) * self.separation
        return WheelSpeeds((mean - half) / self.left_radius, (mean + half) / self.right_radius)

    def inward(self, left: float, right: float) -> WheelSpeeds:
        """Measured wheel speeds or angles to those a nominal robot would have."""
        left, right = left * self.left_radius, right * self.right_radius
        mean, half = 0.5 * (left + right), 0.5 * (right - left) / self.separation
        return WheelSpeeds(mean - half, mean + half)

    def sample(self, measured: WheelFeedback) -> WheelFeedback:
        """Feedback of a nominal robot."""
        if self.idle:
            return measured
        left_radps, right_radps = self.inward(measured.left_radps, measured.right_radps)
        left_rad, right_rad = self.inward(measured.left_rad, measured.right_rad)
        return msgspec.structs.replace(
            measured, left_radps=left_radps, right_radps=right_radps, left_rad=left_rad, right_rad=right_rad
        )
