"""Bounded scalar types; the name carries the unit, the bound says what is believable in an arena.

Frames: the arena frame is right-handed, x along the first side of ``arena.size_m``, y along the
second, z up; headings are counter-clockwise from x in (-pi, pi].
Time: every ``*_ns`` is site time, nanoseconds of the monotonic clock of the computer that runs the
motion-capture bridge; everybody else asks the bridge for it (:mod:`contract.site_clock`).
"""

from typing import Annotated

from msgspec import Meta

RobotId = Annotated[str, Meta(pattern="^[a-z][a-z0-9_]{0,15}$", description="robot id, such as r06")]
RobotName = Annotated[str, Meta(min_length=1, max_length=16, description="robot id of the arena file")]
"""In messages. The arena file holds ids to their pattern; on the wire a pattern would cost more than all else."""
Metres = Annotated[float, Meta(ge=-1000.0, le=1000.0, description="m")]
Distance = Annotated[float, Meta(ge=0.0, le=1000.0, description="m, not negative")]
Radians = Annotated[float, Meta(ge=-3.1416, le=3.1416, description="rad, (-pi, pi]")]
Speed = Annotated[float, Meta(ge=-20.0, le=20.0, description="m/s")]
TurnRate = Annotated[float, Meta(ge=-200.0, le=200.0, description="rad/s")]
Nanoseconds = Annotated[int, Meta(ge=0, le=(1 << 63) - 1, description="ns of site time")]
Count = Annotated[int, Meta(ge=0, le=(1 << 53) - 1, description="count or sequence number")]
Index = Annotated[int, Meta(ge=0, le=9999, description="index of a target in its cloud")]
Volts = Annotated[float, Meta(ge=0.0, le=100.0, description="V")]
Text = Annotated[str, Meta(max_length=400)]
Name = Annotated[str, Meta(max_length=64)]
Point = tuple[Metres, Metres]


_WHOLE = 1.5 * 2.0**52
"""Added to a number and taken off again it leaves the nearest whole one."""


def fifth(value: float) -> float:
    """``round(value, 5)``, bit for bit, in a third of the time: some hundred numbers a control step are told."""
    scaled = value * 1e5
    whole = scaled + _WHOLE - _WHOLE
    if whole and -0.499 < scaled - whole < 0.499 and -1e12 < whole < 1e12:
        return whole / 1e5
    return round(value, 5)


metres = fifth
"""Rounds to the wire's 0.01 mm."""
radians = fifth
"""Rounds to the wire's 0.01 mrad."""
