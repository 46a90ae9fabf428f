"""Velocity vector to wheel speeds for a differential drive (the platform, not the paper).

Eq. 1 asks for a single integrator; the body realises it along its heading and turns towards the rest.
"""

import math
from typing import Final

TURN_GAIN_PER_S: Final = 6.0
"""Turn rate per radian of heading error: what every calibrated motor follows."""
FAST_TURN_GAIN_PER_S: Final = 9.0
"""The most, for motors that follow at once."""


def fold(angle_rad: float) -> float:
    """The angle in (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % (2 * math.pi)


def turn_gain_per_s(delay_s: float) -> float:
    """Gain for wheels that follow within ``delay_s``: at most one radian of turn is under way per radian of error."""
    return min(FAST_TURN_GAIN_PER_S, max(TURN_GAIN_PER_S, 1 / max(delay_s, 1e-3)))


def steer(
    velocity: tuple[float, float], heading_rad: float, gain_per_s: float = TURN_GAIN_PER_S
) -> tuple[float, float]:
    """(speed_mps, turn_rate_radps) that follows a velocity vector (m/s, arena frame), reversing where nearer.

    The heading error is folded to +-90 degrees; a zero vector gives zero turn.
    """
    x, y = velocity
    length = math.hypot(x, y)
    if length == 0.0:
        return (0.0, 0.0)
    error = fold(math.atan2(y, x) - heading_rad)
    sign = 1.0
    if abs(error) > math.pi / 2:
        error, sign = fold(error - math.pi), -1.0
    return (sign * length * math.cos(error), gain_per_s * error)


def rims(speed_mps: float, turn_rate_radps: float, wheel_separation_m: float, limit_mps: float) -> tuple[float, float]:
    """(left, right) rim speeds, m/s; beyond the limit both shrink alike, which keeps the curvature."""
    half = turn_rate_radps * wheel_separation_m / 2
    left, right = speed_mps - half, speed_mps + half
    if -limit_mps <= left <= limit_mps and -limit_mps <= right <= limit_mps:
        return (left, right)
    excess = max(abs(left), abs(right)) / limit_mps
    return (left, right) if excess <= 1 else (left / excess, right / excess)


def body(left_mps: float, right_mps: float, wheel_separation_m: float) -> tuple[float, float]:
    """(speed_mps, turn_rate_radps) of the body from rim speeds."""
    return ((left_mps + right_mps) / 2, (right_mps - left_mps) / wheel_separation_m)
