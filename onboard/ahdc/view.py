"""What one robot may know at one step, and what it decides. Locality ends at the fields of :class:`View`."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from contract.messages import NeighbourState
from onboard.ahdc.parameters import Vector
from onboard.ahdc.room import Motion


class Sighted(NamedTuple):
    """Another robot within sensing range, as last seen by the motion capture."""

    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float
    age_s: float
    """Since the exposure of its last valid pose."""
    valid: bool
    """Seen in the newest frame; otherwise its last valid pose stands in."""


class Heard(NamedTuple):
    """The newest state message of a robot within radio range."""

    state: NeighbourState
    age_s: float
    """Since the time the message speaks of."""
    silent: bool
    """Nothing came for longer than ``safety.neighbour_silence_s``."""


class Left(NamedTuple):
    """Where a robot was before it jumped: it may be there still, or be where it is seen since."""

    robot: str
    seen: Sighted
    """There, last."""
    linked: bool
    """A link was kept with it then."""


class View(NamedTuple):
    """Everything the law may use at one step of one robot."""

    now_s: float
    motion: Motion
    sighted: Mapping[str, Sighted]
    heard: Mapping[str, Heard]
    targets: Mapping[int, Vector]
    """Targets within sensing range."""
    start_direction_rad: float
    may_move: bool
    """The supervisor lets the wheels turn; otherwise the law only keeps links and announces itself."""
    left: Sequence[Left] = ()


class Goal(NamedTuple):
    """Where to go (algorithm 1, line 1)."""

    point: Vector
    stop_short_m: float
    """Distance from the point at which it is reached well enough."""
    why: str
    """'target', 'indicator', 'start', 'help', 'aside' or 'hold'."""


class Decision(NamedTuple):
    """Wheel rim speeds, m/s, and what bounds them."""

    left_mps: float
    right_mps: float
    waits: str
    """'', 'link', 'separation', 'brake', 'hold', 'help', 'free' or 'joining'."""
