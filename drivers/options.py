"""Options every controller family shares; a family's own Struct adds to them.

Each field carries its own explanation (``Meta.description``), which ``ahdc-drivers list`` prints.
"""

from typing import Annotated

from msgspec import Meta, Struct

DevicePath = Annotated[
    str,
    Meta(min_length=1, max_length=200, description="serial device; prefer the stable /dev/serial/by-id/... name"),
]
GearRatio = Annotated[float, Meta(gt=0.0, le=1000.0, description="motor turns per wheel turn")]
Inverted = Annotated[bool, Meta(description="this motor turns backwards for forward motion")]


Multiplier = Annotated[float, Meta(ge=0.5, le=2.0, description="real over nominal dimension, from calibration")]


class WheelOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Common to all families."""

    gear_ratio: GearRatio = 1.0
    left_inverted: Inverted = False
    right_inverted: Inverted = False
    left_wheel_radius_multiplier: Multiplier = 1.0
    right_wheel_radius_multiplier: Multiplier = 1.0
    wheel_separation_multiplier: Multiplier = 1.0
