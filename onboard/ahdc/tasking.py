"""COTR at work: algorithm 2 on what one robot knows, with the field profile's additions.

The ``paper`` profile uses algorithm 2 alone: targets in sight, the nearest one, indicators in sight.
The ``field`` profile adds memory, choice by reachability, yielding, the hop gradient and HELP.
"""

import math
from collections.abc import Iterator
from typing import Final

from contract.messages import Help, NeighbourState
from onboard.ahdc.assist import SKIP_S, Assist
from onboard.ahdc.claims import ClaimBook
from onboard.ahdc.cotr import (
    Event,
    Task,
    is_indicator,
    nearest_target,
    reachable_target,
    transition,
    yields,
)
from onboard.ahdc.memory import TargetMemory, from_hex
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.relay import linked, relay_point
from onboard.ahdc.view import Goal, View

NO_HOPS: Final = 1000
STAND_OFF_M: Final = 0.4
"""A follower stops this far from the one it follows."""
HELP_STAND_OFF_M: Final = 0.6
IN_THE_WAY_M, ASIDE_M = 0.3, 0.35
"""A robot without a target keeps out of so much room around a target that another tracks, and goes that far away."""
LOCKOUT_S: Final = 0.5
"""After yielding a target it is not chosen again for this long."""
RETHINK_S: Final = 0.1
"""How often a robot without a target looks for one."""
REACHED_SPEED_MPS: Final = 0.05
LEAD_M: Final = 2.0
"""A start direction is a goal this far ahead."""
RELAY_STOP_M: Final = 0.05
"""A relay is in its place this near to it."""
TAUT_SHARE: Final = 0.82
"""A link longer than this share of r_c' may hold its robots back."""


class Tasking:
    """Task, target and goal of one robot."""

    def __init__(self, robot: str, parameters: Parameters) -> None:
        self.robot = robot
        self._parameters = parameters
        self._field = parameters.profile == "field"
        self._too_far = min(parameters.robots, NO_HOPS)
        self.task = Task.FREE
        self.target: int | None = None
        """Tracked or occupied target."""
        self.next_target: int | None = None
        """Chosen while still holding the present one (field)."""
        self.memory = TargetMemory()
        self.assist = Assist(robot, min(parameters.robots, NO_HOPS + 1))
        self.book = ClaimBook(robot, parameters.max_speed_mps)
        self.cloud_seen = False
        self.hops = NO_HOPS
        self.indicator = False
        self.helping = False
        self.occupied_count = 0
        self._visible: dict[int, Vector] = {}
        self._learned: dict[str, NeighbourState] = {}
        """Newest message learned from, by robot: the next step need not learn from it again."""
        self._held_from_s = 0.0
        self._blocked_until: dict[int, float] = {}
        self._rethink_s = -1.0

    @property
    def claim(self) -> int | None:
        """The target others should leave to this robot."""
        if self.task is Task.OCCUPIED and self.next_target is not None:
            return self.next_target
        return self.target

    def claim_at(self) -> Vector | None:
        return None if self.claim is None else self.memory.known.get(self.claim)

    def hold_left_s(self, now_s: float) -> float:
        """How long it must still hold its target before it may set out for the next one."""
        if self.task is not Task.OCCUPIED:
            return 0.0
        return max(0.0, self._held_from_s + self._parameters.occupying_time_s - now_s)

    def _left_m(self, view: View) -> float:
        """Way to the tracked target, infinite where there is none."""
        if self.task is not Task.TRACKING or self.target is None:
            return math.inf
        return math.dist(view.motion[:2], self.memory.known[self.target])

    def update(self, view: View) -> Goal | None:
        """One run of algorithm 2; the goal, or None to stop."""
        self._learn(view)
        own = view.motion[:2]
        if not view.may_move:
            return None
        self._advance(view, own)
        return self._goal(view, own)

    def leave(self) -> None:
        """Out of the network: claim no target, lead and call nobody; what is occupied stays known."""
        self.task, self.target, self.next_target = Task.FREE, None, None
        self.assist.stop_tracking()
        self.assist.heard = None
        self.hops, self.indicator, self.helping = NO_HOPS, False, False

    def _learn(self, view: View) -> None:
        memory, too_far, learned = self.memory, self._too_far, self._learned
        memory.see_all(view.targets)
        requests: list[tuple[str, Help]] = []
        nearest = too_far
        for name, (state, _, silent) in view.heard.items():
            if learned.get(name) is not state:
                learned[name] = state
                self._learn_from(name, state, view.now_s)
            if not silent:
                hops, help_ = state.hops, state.help
                if hops < nearest:
                    nearest = hops
                if help_ is not None:
                    requests.append((name, help_))
        if view.targets:
            self.cloud_seen = True
        if self._field:
            self._visible = memory.open
            if requests or self.assist.heard is not None:
                taut = [name for name, _ in requests if self._taut(view, name)]
                self.assist.listen(requests, self._left_m(view), view.now_s, taut)
        else:
            self._visible = {k: p for k, p in view.targets.items() if memory.is_open(k)}
        self.indicator = is_indicator(self.task, self.target, self._visible)
        leads = self.indicator or (self._field and self.task is Task.TRACKING)
        self.hops = 0 if leads else nearest + 1
        if self.hops >= too_far:
            self.hops = NO_HOPS

    def _taut(self, view: View, name: str) -> bool:
        """Whether that neighbour keeps a link with this robot, and its length may hold either back."""
        place = view.sighted.get(name)
        if place is None or not linked(view.heard[name].state, self.robot):
            return False
        return math.dist(view.motion[:2], place[:2]) > TAUT_SHARE * self._parameters.link_radius_m

    def _learn_from(self, name: str, state: NeighbourState, now_s: float) -> None:
        """A neighbour's new message: occupied targets, sightings and claims."""
        memory, known = self.memory, self.memory.known
        if state.occupied:
            memory.merge(from_hex(state.occupied))
        for target in state.sightings:
            index, place = target.index, (target.x_m, target.y_m)
            if known.get(index) != place:
                memory.see(index, place)
        if state.cloud_seen:
            self.cloud_seen = True
        if self._field:
            self.book.learn(name, state, now_s)

    def _advance(self, view: View, own: Vector) -> None:
        now_s = view.now_s
        if self.task is Task.OCCUPIED:
            if self._field and now_s >= self._rethink_s:
                self._rethink_s = now_s + RETHINK_S
                self.next_target = self._choose(view, own)
            if now_s - self._held_from_s >= self._parameters.occupying_time_s:
                self._become(Event.HELD, now_s)
        if self.task is Task.TRACKING:
            self._track(view, own)
        self.helping = self._field and self.task is not Task.OCCUPIED and self.assist.heard is not None
        if self.helping and self.task is Task.TRACKING:
            self._become(Event.LOST, now_s)
        if self.task is Task.FREE and now_s >= self._rethink_s:
            heard = self.assist.heard if self.helping else None
            chosen = self._choose(view, own, math.inf if heard is None else heard.left_m)
            if chosen is not None:
                self.target = chosen
                self.helping = False
                self._become(Event.OBSERVED, now_s)
            elif self._field:
                self._rethink_s = now_s + RETHINK_S

    def _track(self, view: View, own: Vector) -> None:
        assert self.target is not None
        place = self.memory.known[self.target]
        distance_m = math.dist(own, place)
        now_s = view.now_s
        speed = abs(view.motion.left_mps + view.motion.right_mps) / 2
        if not self.memory.is_open(self.target):
            self._become(Event.LOST, now_s)
        elif distance_m <= self._parameters.reach_m and (speed < REACHED_SPEED_MPS or not self._field):
            self.memory.occupy(self.target)
            self.occupied_count += 1
            self._become(Event.REACHED, now_s)
        elif self._field:
            if yields(
                self.robot, distance_m, self.book.claims(view.heard, view.sighted, now_s, self.target), self.target
            ):
                self._blocked_until[self.target] = now_s + LOCKOUT_S
                self._become(Event.LOST, now_s)
            elif self.assist.track(distance_m, now_s):
                self._blocked_until[self.target] = now_s + SKIP_S
                self._become(Event.LOST, now_s)
        elif self.target not in self._visible:
            self._become(Event.LOST, now_s)

    def _become(self, event: Event, now_s: float) -> None:
        self.task = transition(self.task, event)
        self._rethink_s = now_s
        if event is Event.OBSERVED:
            self.assist.start_tracking(now_s)
        elif event is Event.REACHED:
            self._held_from_s = now_s
            self.next_target = None
            self.assist.stop_tracking()
        else:
            self.target = self.next_target = None
            self.assist.stop_tracking()

    def _choose(self, view: View, own: Vector, within_m: float = math.inf) -> int | None:
        """The target to go for; a helper may take one nearer than ``within_m``, the way left to the one that asks."""
        if not self._field:
            return nearest_target(own, self._visible)
        if not self._visible:
            return None
        anchors = []
        for name, sighted in view.sighted.items():
            heard = view.heard.get(name)
            claim_at = None if heard is None else heard.state.claim_at
            anchors.append(sighted[:2] if claim_at is None else claim_at)
        options, middle = self._options(view, own, within_m), self.memory.middle()
        return reachable_target(own, self._visible, options, anchors, self._parameters.link_radius_m, middle)

    def _options(self, view: View, own: Vector, within_m: float) -> Iterator[tuple[float, int]]:
        """Distance and index of the open targets that are neither given up for a while nor better left to another."""
        now_s, claims = view.now_s, self.book.claims(view.heard, view.sighted, view.now_s)
        claimed = {claim.target for claim in claims}
        wait_m = self.hold_left_s(now_s) * self._parameters.max_speed_mps
        for distance_m, index in self.memory.nearest(own):
            if distance_m >= within_m:
                return
            if self._blocked_until.get(index, -1.0) <= now_s and not (
                index in claimed and yields(self.robot, distance_m + wait_m, claims, index)
            ):
                yield distance_m, index

    def _goal(self, view: View, own: Vector) -> Goal | None:
        if self.task is Task.TRACKING:
            assert self.target is not None
            return Goal(self.memory.known[self.target], 0.0, "target")
        if self.task is Task.OCCUPIED:
            return None
        if self._field and (aside := self._aside(view, own)) is not None:
            return aside
        if self.helping:
            return self._towards(view, self.assist.via, HELP_STAND_OFF_M, "help")
        if self._field and not self.memory.occupied:
            return self._start(view, own)
        leader = self._leader(view)
        if leader is not None:
            between = relay_point(view, self.robot, self.hops) if self._field else None
            if between is not None:
                return Goal(between, RELAY_STOP_M, "indicator")
            return self._towards(view, leader, STAND_OFF_M, "indicator")
        return None if self.cloud_seen else self._start(view, own)

    @staticmethod
    def _start(view: View, own: Vector) -> Goal:
        """On into the start direction: until a target is seen (paper), until one is occupied (field)."""
        angle = view.start_direction_rad
        return Goal((own[0] + LEAD_M * math.cos(angle), own[1] + LEAD_M * math.sin(angle)), 0.0, "start")

    def _aside(self, view: View, own: Vector) -> Goal | None:
        """Away from a target that a neighbour tracks, where this robot stands in front of it; None elsewhere."""
        nearest, nearest_m = None, IN_THE_WAY_M
        for state, _, silent in view.heard.values():
            place = state.claim_at
            if place is not None and state.task == "tracking" and not silent:
                distance_m = math.dist(own, place)
                if distance_m < nearest_m:
                    nearest, nearest_m = place, distance_m
        if nearest is None:
            return None
        (x, y), away_m = nearest, max(nearest_m, 1e-9)
        away = ((own[0] - x) / away_m, (own[1] - y) / away_m) if nearest_m > 1e-9 else (1.0, 0.0)
        return Goal((x + ASIDE_M * away[0], y + ASIDE_M * away[1]), 0.0, "aside")

    def _leader(self, view: View) -> str | None:
        """The indicator to follow: the nearest in sight (paper), the neighbour with fewest hops to one (field)."""
        own, sighted, field, own_hops = view.motion[:2], view.sighted, self._field, self.hops
        leaders = [
            (state.hops if field else 0, math.dist(own, sighted[name][:2]), name)
            for name, (state, _, silent) in view.heard.items()
            if (state.hops < own_hops if field else state.indicator) and not silent and name in sighted
        ]
        return min(leaders)[2] if leaders else None

    @staticmethod
    def _towards(view: View, name: str, stand_off_m: float, why: str) -> Goal | None:
        sighted = view.sighted.get(name)
        return None if sighted is None else Goal((sighted.x_m, sighted.y_m), stand_off_m, why)
