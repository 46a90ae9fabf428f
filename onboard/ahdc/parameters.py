"""Section IV-A's parameters under their code names, taken from a checked arena file."""

from dataclasses import dataclass, field

from contract.arena import Arena

Vector = tuple[float, float]
"""(x, y), arena frame."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """Constants of the law; the paper's symbol stands behind each name. Lengths m, times s."""

    profile: str
    robots: int
    """N: no path has more hops."""
    sensing_radius_m: float
    """r_c"""
    noncritical_radius_m: float
    """r_n = r_c - epsilon"""
    avoidance_radius_m: float
    """r_a"""
    cohesion_weight: float
    """alpha"""
    separation_weight: float
    """beta"""
    alignment_weight: float
    """gamma"""
    max_speed_mps: float
    """u_max"""
    run_step_s: float
    """delta t of eq. 13"""
    occupying_time_s: float
    reach_m: float
    diameter_m: float
    wheel_separation_m: float
    brake_deceleration_mps2: Vector
    """Weakest, strongest."""
    motor_lag_s: Vector
    """Shortest, longest."""
    link_margin_m: float
    neighbour_silence_s: float
    share_sightings: bool

    critical_margin_m: float = field(init=False)
    """epsilon"""
    link_radius_m: float = field(init=False)
    """r_c' = r_c - margin: what the field profile plans with."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "critical_margin_m", self.sensing_radius_m - self.noncritical_radius_m)
        object.__setattr__(self, "link_radius_m", self.sensing_radius_m - self.link_margin_m)


def from_arena(arena: Arena) -> Parameters:
    """The parameters of a checked arena file."""
    control = arena.control
    return Parameters(
        profile=control.profile,
        robots=len(arena.robots),
        sensing_radius_m=control.sensing_radius_m,
        noncritical_radius_m=control.noncritical_radius_m,
        avoidance_radius_m=control.avoidance_radius_m,
        cohesion_weight=control.paper.cohesion_weight,
        separation_weight=control.separation_weight,
        alignment_weight=control.alignment_weight,
        max_speed_mps=control.max_speed_mps,
        run_step_s=control.paper.run_step_s,
        occupying_time_s=control.occupying_time_s,
        reach_m=control.reach_m,
        diameter_m=arena.platform.diameter_m,
        wheel_separation_m=arena.platform.wheel_separation_m,
        brake_deceleration_mps2=control.field.brake_deceleration_mps2,
        motor_lag_s=control.field.motor_lag_s,
        link_margin_m=control.field.link_margin_m,
        neighbour_silence_s=arena.safety.neighbour_silence_s,
        share_sightings=control.field.target_knowledge == "shared",
    )
