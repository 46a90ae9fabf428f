"""The ``paper`` profile: algorithm 1 to the letter, isotropic eq. 13 and removal by consent (eq. 14)."""

import math

from onboard.ahdc.behaviour import alignment, cohesion, saturate, separation, velocity
from onboard.ahdc.expansion import removable_links, wished_removals
from onboard.ahdc.neighbours import critical_robots, neighbours
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.preservation import speed_bound_mps
from onboard.ahdc.view import Goal, View


class PaperLaw:
    """Velocity of one robot; remembers only the wishes it announces for consent."""

    def __init__(self, robot: str, parameters: Parameters) -> None:
        self.robot = robot
        self._parameters = parameters
        self.wishes: set[str] = set()
        """Links it would remove: its half of rho_ij."""
        self.kept: set[str] = set()
        """N_i^c after network expansion."""
        self.neighbours: set[str] = set()

    def velocity(self, view: View, goal: Goal | None) -> Vector:
        """Algorithm 1: u_i in m/s, arena frame."""
        p = self._parameters
        own = (view.motion.x_m, view.motion.y_m)
        others = {name: (s.x_m, s.y_m) for name, s in view.sighted.items()}
        distances = neighbours(own, others, p.sensing_radius_m)
        critical = critical_robots(distances, others, p.noncritical_radius_m)
        self.neighbours = set(distances)
        self.wishes = set()
        if goal is None or math.dist(own, goal.point) <= goal.stop_short_m:
            self.kept = critical
            return (0.0, 0.0)
        wanted = alignment(own, goal.point)
        if len(critical) > 1:
            graph = {name: set(heard.state.links_on) for name, heard in view.heard.items()}
            self.wishes = wished_removals(self.robot, own, critical, others, graph, wanted)
            other_wishes = {name: set(heard.state.wishes) for name, heard in view.heard.items()}
            critical -= removable_links(self.robot, self.wishes, other_wishes)
        self.kept = critical
        parts = (
            cohesion(own, [others[name] for name in distances], p.sensing_radius_m),
            separation(own, others.values(), wanted, p.avoidance_radius_m),
            wanted,
        )
        u = velocity(parts, (p.cohesion_weight, p.separation_weight, p.alignment_weight), p.max_speed_mps)
        if not critical:
            return u
        bound = speed_bound_mps(
            [distances[name] for name in critical], p.sensing_radius_m, p.critical_margin_m, p.run_step_s
        )
        return saturate(u, bound)
