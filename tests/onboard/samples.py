"""Ready-made pieces for the onboard tests."""

from typing import Any

from contract.arena import Arena, parse
from contract.messages import NeighbourState
from onboard.ahdc.parameters import Parameters, from_arena


def arena(profile: str = "field", robots: int = 3) -> Arena:
    """A small arena: robots r01, r02, ... 0.4 m apart."""
    return parse(
        {
            "arena": {"name": "test", "size_m": [4.0, 5.0]},
            "control": {"profile": profile},
            "robots": {
                f"r{k + 1:02d}": {
                    "body": f"b{k + 1}",
                    "start": [0.5 + 0.4 * (k % 6), 0.5 + 0.4 * (k // 6)],
                    "wheels": {"kind": "odrive"},
                }
                for k in range(robots)
            },
        },
        "test arena",
    )


def paper_parameters() -> Parameters:
    return from_arena(arena("paper"))


def field_parameters(robots: int = 3) -> Parameters:
    return from_arena(arena("field", robots))


def state(robot: str, x_m: float = 0.0, y_m: float = 0.0, **changes: Any) -> NeighbourState:
    """A resting neighbour's message."""
    fields: dict[str, Any] = {
        "robot": robot,
        "boot": 1,
        "seq": 1,
        "stamp_ns": 0,
        "x_m": x_m,
        "y_m": y_m,
        "heading_rad": 0.0,
        "vx_mps": 0.0,
        "vy_mps": 0.0,
        "stop_long": (x_m, y_m),
        "stop_short": (x_m, y_m),
    }
    return NeighbourState(**(fields | changes))
