"""Section III-B: network expansion by removing redundant critical links with consent (eq. 14)."""

from collections.abc import Collection, Mapping, Set

from onboard.ahdc.parameters import Vector
from onboard.ahdc.topology import Graph, is_chain, kept_link, link_angle_rad, polygon_groups


def wished_removals(
    own_name: str,
    own: Vector,
    critical: Collection[str],
    positions: Mapping[str, Vector],
    graph: Graph,
    goal_direction: Vector,
) -> set[str]:
    """The critical links a robot would give up: every one of each polygon group but the kept one (eq. 11)."""
    wished: set[str] = set()
    for group in polygon_groups(own_name, critical, graph):
        if not is_chain(group):
            angles = {name: link_angle_rad(own, positions[name], goal_direction) for name in group}
            wished |= group - {kept_link(angles)}
    return wished


def consent(own_name: str, wished: Set[str], other_wishes: Mapping[str, Set[str]]) -> set[str]:
    """The links with rho_ij = rho_ji = 1: both ends wish the removal."""
    return {name for name in wished if own_name in other_wishes.get(name, ())}


def removable_links(own_name: str, wished: Set[str], other_wishes: Mapping[str, Set[str]]) -> set[str]:
    """E_i^R of eq. 14: theta_ij above the group's minimum and mutual consent."""
    return consent(own_name, wished, other_wishes) & wished
