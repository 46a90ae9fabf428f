"""Proposition 1: how far a robot may go in one run-step without breaking a link (eq. 7-10, 13)."""

from collections.abc import Collection


def pair_run_step_m(distance_m: float, sensing_radius_m: float) -> float:
    """Eq. 8: both ends of a link at r_ij may each go half of what is left to r_c; never negative."""
    return max(0.0, (sensing_radius_m - distance_m) / 2)


def slack_m(critical_distances: Collection[float], sensing_radius_m: float, critical_margin_m: float) -> float:
    """epsilon_i of eq. 7 and 10: the smallest r_c - r_ij over critical robots, epsilon where there is none."""
    if not critical_distances:
        return critical_margin_m
    return min(critical_margin_m, *(2 * pair_run_step_m(d, sensing_radius_m) for d in critical_distances))


def run_step_bound_m(critical_distances: Collection[float], sensing_radius_m: float, critical_margin_m: float) -> float:
    """Eq. 7: the largest run-step that preserves every link; eq. 9 and 10 follow from it."""
    return slack_m(critical_distances, sensing_radius_m, critical_margin_m) / 2


def speed_bound_mps(
    critical_distances: Collection[float], sensing_radius_m: float, critical_margin_m: float, run_step_s: float
) -> float:
    """u_imax of eq. 13: eq. 7's run-step in the time-step delta t."""
    return run_step_bound_m(critical_distances, sensing_radius_m, critical_margin_m) / run_step_s
