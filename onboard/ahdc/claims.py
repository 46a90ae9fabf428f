"""Claims on targets, passed on from robot to robot: two robots that do not hear each other still yield.

A robot tells its own claim with every state message and passes on what it has heard, a few hops far. The state
message's number dates a claim: the newest word on each robot counts, and a claim not told anew is forgotten.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import msgspec

from contract.messages import NeighbourState, ToldClaim
from contract.units import metres
from onboard.ahdc.cotr import Claim
from onboard.ahdc.view import Heard, Sighted
from onboard.record import record

CLAIM_HOPS: Final = 4
"""Farther from its owner a claim is not passed on."""
CLAIM_LIFE_S: Final = 0.5
"""A claim not told anew for this long is forgotten."""
CLAIMS_A_MESSAGE: Final = 8


class Rumour(NamedTuple):
    """A claim as heard, and when a newer word on its owner last came."""

    told: ToldClaim
    heard_s: float


@dataclass
class ClaimBook:
    """What one robot has heard of all others' claims."""

    robot: str
    max_speed_mps: float
    _rumours: dict[str, Rumour] = field(default_factory=dict)

    def learn(self, neighbour: str, state: NeighbourState, now_s: float) -> None:
        """A neighbour's own claim and those it passes on."""
        rumours, number, me = self._rumours, state.seq, self.robot
        known = rumours.get(neighbour)
        if known is not None and known[0].number == number:
            return
        way_m = 0.0 if state.claim_at is None else self._way_m((state.x_m, state.y_m), state)
        own = ToldClaim(robot=neighbour, number=number, target=state.claim, left_m=metres(way_m), hops=1)
        for told in (own, *state.claims):
            robot = told.robot
            if robot == me or told.hops > CLAIM_HOPS:
                continue
            known = rumours.get(robot)
            if known is None or told.number > known[0].number or now_s - known[1] >= CLAIM_LIFE_S:
                rumours[robot] = record(Rumour, (told, now_s))

    def to_tell(self, now_s: float) -> tuple[ToldClaim, ...]:
        """What to pass on: claims that may still go a hop, the nearest owners first."""
        fresh = [r.told for r in self._fresh(now_s) if r.told.hops < CLAIM_HOPS]
        fresh.sort(key=lambda told: (told.hops, told.robot))
        return tuple(msgspec.structs.replace(told, hops=told.hops + 1) for told in fresh[:CLAIMS_A_MESSAGE])

    def claims(
        self, heard: Mapping[str, Heard], sighted: Mapping[str, Sighted], now_s: float, target: int | None = None
    ) -> list[Claim]:
        """Claims, or those on one target: of neighbours from where they are seen, of robots farther off as told.

        One that has fallen silent claims nothing any more.
        """
        found = []
        for name, (state, _, silent) in heard.items():
            claim = state.claim
            if (claim == target or (target is None and claim >= 0)) and not silent and state.claim_at is not None:
                seen = sighted.get(name)
                place = (seen.x_m, seen.y_m) if seen else (state.x_m, state.y_m)
                found.append(Claim(name, claim, self._way_m(place, state)))
        for told, _ in self._fresh(now_s):
            claim = told.target
            if (claim == target or (target is None and claim >= 0)) and told.robot not in heard:
                found.append(Claim(told.robot, claim, told.left_m))
        return found

    def _fresh(self, now_s: float) -> Iterator[Rumour]:
        return (rumour for rumour in self._rumours.values() if now_s - rumour.heard_s < CLAIM_LIFE_S)

    def _way_m(self, place: tuple[float, float], state: NeighbourState) -> float:
        assert state.claim_at is not None
        return math.dist(place, state.claim_at) + state.claim_wait_s * self.max_speed_mps
