"""What the world does to robots in lockstep missions: two presets, and every number settable. Pure."""

from typing import NamedTuple

Interval = tuple[float, float]
"""(low, high)."""


class Conditions(NamedTuple):
    """Ages, noise, losses and motors. Intervals are drawn from per robot or per message."""

    pose_age_s: Interval = (0.0, 0.0)
    """Exposure to arrival of frames: a base drawn per robot, so that loops run out of step, and jitter of a quarter."""
    message_age_s: Interval = (0.0, 0.0)
    """Sending to arrival, drawn per neighbour message and receiver; messages overtake each other."""
    position_noise_m: float = 0.0
    """Standard deviation in each axis."""
    heading_noise_rad: float = 0.0
    """Standard deviation."""
    loss: float = 0.0
    """Share of neighbour messages lost, per receiver."""
    frame_loss: float = 0.0
    """Share of frames lost, per receiver."""
    lag_s: Interval = (0.0, 0.0)
    """First-order lag from command to rim speed, drawn per robot."""
    deceleration_mps2: Interval = (1e6, 1e6)
    """Of the rims, acceleration alike, drawn per robot."""


IDEAL = Conditions()
FIELD = Conditions(
    pose_age_s=(0.020, 0.080),
    message_age_s=(0.020, 0.080),
    position_noise_m=0.0025,
    heading_noise_rad=0.015,
    loss=0.10,
    lag_s=(0.060, 0.150),
    deceleration_mps2=(1.6, 2.4),
)
PRESETS = {"ideal": IDEAL, "field": FIELD}
