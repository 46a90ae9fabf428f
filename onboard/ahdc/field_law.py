"""The ``field`` profile: verified links, stop-point plan, and a velocity that already respects both."""

import math
from collections.abc import Sequence
from typing import Final, Protocol

from onboard.ahdc.behaviour import alignment, saturate, separation, velocity
from onboard.ahdc.links import OFF, ON, Link, LinkTable
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.plan import (
    CONTACT_M,
    LOOK_AHEAD_S,
    TURNING_STOP_MPS,
    YIELD_RANGE_M,
    Command,
    Partner,
    Planner,
    Room,
    make_disc,
)
from onboard.ahdc.stopping import Brake, speed_for_stop_mps, stop_distance_m, stop_tables
from onboard.ahdc.view import Goal, Left, View
from onboard.record import record
from onboard.unicycle import TURN_GAIN_PER_S, turn_gain_per_s

ADD_SHARE: Final = 0.8
"""Links are offered up to this share of what is left of r_c' after half a robot's longest way to rest."""
REMOVE_SHARE: Final = 0.82
"""Removal is tried beyond this share of it, where a detour of shorter links exists: before the bound makes wait, which
looks at where both come to rest, and while the messages of a removal are under way."""
LISTEN_S: Final = 0.3
"""A robot that has just come hears everybody around within this time, ten state messages long."""
CLOSING_TIME_S: Final = 0.25
MAX_AGE_S: Final = 0.5
"""A stop point is not carried on for longer than this."""
REMOVAL_PAUSE_S: Final = 0.1
ON_THE_SPOT_RADPS: Final = 6.0
INSIDE_M: Final = 0.01
"""A robot brakes once it will come to rest this far within reach of its target."""
REACTION_S: Final = 0.25
"""A robot that is not seen, or not where it was, holds within this."""
SAME_PLACE_M: Final = 1e-4
"""Stop points nearer to each other than this are one hypothesis."""
FACED_RADPS: Final = 0.1
"""A robot at rest that would turn slower than this faces its next target well enough."""


class Steer(Protocol):
    """The platform's way from a velocity vector to (speed_mps, turn_rate_radps)."""

    def __call__(
        self, velocity: Vector, heading_rad: float, gain_per_s: float = TURN_GAIN_PER_S
    ) -> tuple[float, float]: ...


class FieldLaw:
    """Links, bound and velocity of one robot."""

    def __init__(self, robot: str, boot: int, parameters: Parameters, period_s: float, steer: Steer) -> None:
        self.robot = robot
        self.links = LinkTable(robot, boot)
        self.planner = Planner(parameters, stop_tables(parameters), period_s)
        self.joined = False
        """Every robot within r_c has been linked since it came: rule 8."""
        self.excluded: frozenset[str] = frozenset()
        """Robots the operator has taken out of the network."""
        self._came_s: float | None = None
        self._met: set[str] = set()
        """Robots that have been linked since it came, while it has not joined: where such a link has been removed, a
        verified detour stands for it."""
        self._parameters = parameters
        self._steer = steer
        (weak, _), (quick, slow) = parameters.brake_deceleration_mps2, parameters.motor_lag_s
        self._approach = Brake(weak, (quick + slow) / 2 + 2 * period_s)
        self._turn_gain_per_s = turn_gain_per_s(slow + 2 * period_s)
        self._approach_m = 1.01 * stop_distance_m(parameters.max_speed_mps, self._approach)
        """Nearer to its goal than this a robot may have to be slower than u_max."""
        rest_m = stop_distance_m(parameters.max_speed_mps, Brake(weak, slow))
        self._spacious_m = max(parameters.link_radius_m / 2, parameters.link_radius_m - rest_m / 2)
        """Links shorter than about this hold nobody back."""
        self._next_removal_s = 0.0

    def keep_links(self, view: View) -> None:
        """Run the link protocol: silence, boots, offers, at most one removal, repetitions."""
        links, now_s, sighted = self.links, view.now_s, view.sighted
        entries = links.entries
        p = self._parameters
        own = view.motion[:2]
        joined_reach_m = ADD_SHARE * self._spacious_m
        reach_m = joined_reach_m if self.joined else p.sensing_radius_m
        silent = []
        if self._came_s is None:
            self._came_s = now_s
        waiting = now_s - self._came_s < LISTEN_S
        boots = links.boots
        for name, (state, _, is_silent) in view.heard.items():
            if boots.get(name) != state.boot:
                links.note_boot(name, state.boot)
                self._met.discard(name)
            if is_silent:
                silent.append(name)
                continue
            entry = entries.get(name)
            link = OFF if entry is None else entry.state
            if name not in sighted or name in self.excluded:
                continue
            if link is ON:
                if self.robot not in state.links_on and self.robot not in state.links_kept:
                    links.renew(name, now_s)
                    self._met.discard(name)
                elif not self.joined:
                    self._met.add(name)
                continue
            distance = math.dist(own, sighted[name][:2])
            if distance > joined_reach_m and name in self._met:
                continue
            if distance <= reach_m and (link is OFF or link is Link.DOUBT) and (self.robot < name or not self.joined):
                links.offer(name, now_s)
            waiting |= distance <= p.sensing_radius_m
        links.note_silence([*silent, *(left.robot for left in view.left)])
        if not waiting:
            self.joined = True
            self._met.clear()
        if self.joined and now_s >= self._next_removal_s and links.removal is None:
            self._try_removal(view, own)
        links.tick(now_s)

    def release(self) -> None:
        """Without links, as at the start: it moves again only once linked to every robot within r_c."""
        self.links.release()
        self.rejoin()
        self._came_s = None

    def rejoin(self) -> None:
        """As at the start it moves only once linked to every robot within r_c; the links that there are stay."""
        self.joined = False
        self._met.clear()

    def forget(self, other: str) -> None:
        """End one link without the other's consent: a detour may have led along it."""
        self.links.forget(other)
        self._met.clear()

    def exclude(self, robots: frozenset[str]) -> None:
        """Take robots out of the network: their links end without their consent; readmitted, they are offered anew."""
        for name in robots - self.excluded:
            self.forget(name)
        self.excluded = robots

    def _try_removal(self, view: View, own: Vector) -> None:
        """Propose giving up the longest link for which a common neighbour offers two shorter ones."""
        links, sighted, robot = self.links, view.sighted, self.robot
        removable_m, (own_x, own_y) = REMOVE_SHARE * self._spacious_m, own
        long = []
        for name, seen in sighted.items():
            if robot < name:
                distance = math.hypot(seen[0] - own_x, seen[1] - own_y)
                if distance > removable_m and links.vouches(name):
                    long.append((distance, name))
        long.sort(reverse=True)
        for distance, other in long:
            middle = self._middle(view, own, other, distance)
            if middle is not None and links.propose_removal([robot, middle, other], view.now_s):
                self._next_removal_s = view.now_s + REMOVAL_PAUSE_S
                return

    def _middle(self, view: View, own: Vector, other: str, distance_m: float) -> str | None:
        """The common neighbour whose longer link to the two ends is shortest, if shorter than theirs."""
        links, sighted, heard = self.links, view.sighted, view.heard
        end = sighted[other][:2]
        best, best_m = None, distance_m
        for name in links.entries:
            if name != other and name in sighted and links.vouches(name) and other in heard[name].state.links_on:
                place = sighted[name][:2]
                longer_m = max(math.dist(own, place), math.dist(place, end))
                if longer_m < best_m:
                    best, best_m = name, longer_m
        return best

    def partners(self, view: View) -> list[Partner]:
        """Every robot the plan must respect, with its stop points as announced or, unheard, as seen."""
        partners = []
        entries, messages = self.links.entries, view.heard
        for name, (seen_x, seen_y, vx, vy, seen_age_s, _) in view.sighted.items():
            ahead_s = seen_age_s if seen_age_s < MAX_AGE_S else MAX_AGE_S
            x, y = seen_x + vx * ahead_s, seen_y + vy * ahead_s
            entry = entries.get(name)
            enforced = entry is not None and entry.state is not OFF
            if name not in messages:
                stops = self._unheard_stops((x, y), (vx, vy))
                partners.append(Partner(name, enforced, (x, y), stops, stops, seen_age_s, False))
                continue
            state, age_s, silent = messages[name]
            carry_s = age_s if age_s < MAX_AGE_S else MAX_AGE_S
            dx, dy = state.vx_mps * carry_s, state.vy_mps * carry_s
            long, short = state.stop_long, state.stop_short
            long_stops: tuple[Vector, ...] = (long,)
            short_stops: tuple[Vector, ...] = (short,)
            if abs(dx) + abs(dy) > SAME_PLACE_M:
                long_stops = (long, (long[0] + dx, long[1] + dy))
                short_stops = (short, (short[0] + dx, short[1] + dy))
            resting = not state.moving and not silent
            partners.append(record(Partner, (name, enforced, (x, y), long_stops, short_stops, age_s, resting)))
        if view.left:
            partners += self._left_partners(view.left)
        return partners

    def _left_partners(self, places: Sequence[Left]) -> list[Partner]:
        """Linked robots that have jumped, where they were: each has held since, within what a pose may be old."""
        partners = []
        for name, (x, y, vx, vy, seen_age_s, _), linked in places:
            if linked and self.links.enforces(name):
                age_s = min(seen_age_s, REACTION_S)
                ahead = (x + vx * age_s, y + vy * age_s)
                stops = ((x, y), self._unheard_stops(ahead, (vx, vy))[-1])
                partners.append(Partner(name, True, (x, y), stops, stops, age_s, False))
        return partners

    def _unheard_stops(self, place: Vector, v: Vector) -> tuple[Vector, ...]:
        speed = math.hypot(*v)
        if speed < 1e-3:
            return (place,)
        brake = self.planner.weak_brake
        way = (speed * brake.lag_s + speed * speed / (2 * brake.deceleration_mps2)) / speed
        return (place, (place[0] + v[0] * way, place[1] + v[1] * way))

    def command(self, view: View, goal: Goal | None, facing: Vector | None) -> Command:
        """Rim speeds towards the goal; without one, rest, and once at rest turn towards ``facing``."""
        motion = view.motion
        if goal is None or not self.joined:
            slow = abs(motion.left_mps + motion.right_mps) / 2 < TURNING_STOP_MPS
            if facing is None or not slow:
                return Command(0.0, 0.0, "")
            own = (motion.x_m, motion.y_m)
            _, turn = self._steer((facing[0] - own[0], facing[1] - own[1]), motion.heading_rad, self._turn_gain_per_s)
            if abs(turn) < FACED_RADPS:
                return Command(0.0, 0.0, "")
            return self.planner.choose(self.planner.room(motion, self.partners(view)), 0.0, clip(turn))
        room = self.planner.room(motion, self.partners(view))
        u = self.velocity(goal, room)
        if u == (0.0, 0.0):
            return Command(0.0, 0.0, "")
        speed, turn = self._steer(u, motion.heading_rad, self._turn_gain_per_s)
        return self.planner.choose(room, speed, clip(turn))

    def velocity(self, goal: Goal, room: Room) -> Vector:
        """Eq. 12 without cohesion, kept out of head-on courses and inside the link discs."""
        p = self._parameters
        own = room.motion[:2]
        left_m = math.dist(own, goal.point) - goal.stop_short_m
        if left_m <= 0.0 or (goal.why == "target" and self._rests_on(goal.point, room)):
            return (0.0, 0.0)
        aligned = wanted = alignment(own, goal.point)
        if left_m < self._approach_m:
            share = speed_for_stop_mps(left_m, self._approach) / p.max_speed_mps
            if share < 1.0:
                aligned = (wanted[0] * share, wanted[1] * share)
        apart = (0.0, 0.0)
        if room.near:
            others = [partner.place for _, partner in room.near]
            apart = separation(own, others, wanted, p.avoidance_radius_m)
        parts = ((0.0, 0.0), apart, aligned)
        u = velocity(parts, (0.0, p.separation_weight, p.alignment_weight), p.max_speed_mps)
        if room.near:
            u = keep_closing_slow(u, own, room.near)
        return into_discs(u, room)

    def _rests_on(self, target: Vector, room: Room) -> bool:
        """Whether braking at once, with any calibrated brake, ends near enough to the target."""
        near_m = self._parameters.reach_m - INSIDE_M
        return all(math.dist(place, target) <= near_m for place in room.brakes)


def into_discs(u: Vector, room: Room) -> Vector:
    """The velocity nearest to ``u`` whose way in T_p stays in every link disc, by cyclic projection."""
    ux, uy = u
    speed = math.hypot(ux, uy)
    way_m = 2 * (speed * LOOK_AHEAD_S)
    start = room.brakes[0]
    discs = [disc for disc in room.long if disc.gap_m + way_m > 2 * disc.radius_m] if room.long else []
    for gap, diameter, point in room.far:
        if gap + way_m > diameter:
            discs.append(make_disc(start, point, diameter))
    x, y = start[0] + ux * LOOK_AHEAD_S, start[1] + uy * LOOK_AHEAD_S
    for _ in range(4 if discs else 0):
        moved = False
        for _, partner, radius, middle, gap, inside in discs:
            (cx, cy), radius = (middle, radius) if inside else (partner, gap)
            distance = math.hypot(x - cx, y - cy)
            if distance > radius:
                x, y = cx + (x - cx) * radius / distance, cy + (y - cy) * radius / distance
                moved = True
        if not moved:
            break
    new_x, new_y = (x - start[0]) / LOOK_AHEAD_S, (y - start[1]) / LOOK_AHEAD_S
    if new_x * ux + new_y * uy <= 0.0:
        return (0.0, 0.0)
    return saturate((new_x, new_y), speed)


def keep_closing_slow(u: Vector, own: Vector, near: Sequence[tuple[float, Partner]]) -> Vector:
    """Half-planes u.n <= k (d - contact) / T towards near robots; part of what is cut becomes a side-step."""
    ux, uy = u
    own_x, own_y = own
    for distance, partner in near:
        if not 1e-9 < distance < YIELD_RANGE_M:
            continue
        x, y = partner.place
        nx, ny = (x - own_x) / distance, (y - own_y) / distance
        share = 1.0 if partner.resting else 0.5
        excess = ux * nx + uy * ny - share * max(0.0, distance - CONTACT_M) / CLOSING_TIME_S
        if excess > 0:
            ux, uy = ux - excess * nx + 0.3 * excess * ny, uy - excess * ny - 0.3 * excess * nx
    return (ux, uy)


def clip(turn_rate_radps: float) -> float:
    """Limited to what a robot turns on the spot."""
    if turn_rate_radps > ON_THE_SPOT_RADPS:
        return ON_THE_SPOT_RADPS
    return turn_rate_radps if turn_rate_radps > -ON_THE_SPOT_RADPS else -ON_THE_SPOT_RADPS
