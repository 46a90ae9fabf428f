"""What a lockstep mission tells of itself beside its messages: status and truth to a recording, its result. Pure."""

import math
from collections.abc import Iterable
from typing import Literal

from contract.arena import Arena
from contract.messages import MotorBatch, RunStatus
from contract.units import Point, metres, radians
from groundstation.connectivity import summary
from groundstation.referee import Referee
from groundstation.result import Result, TimeBook
from groundstation.targets import Scenario, lower_bound_s

MISSION = "simulate"

Phase = Literal["ready", "armed", "running", "completed", "failed"]


class Score:
    """One mission's scenario and referee, and what the station has heard of it."""

    def __init__(self, arena: Arena, scenario: Scenario, seed: int, referee: Referee) -> None:
        self.told_occupied = 0
        """Bitmap of the targets that robots have said to be occupied."""
        self.book: TimeBook | None = None
        """From the start of the mission on."""
        self._arena = arena
        self._scenario = scenario
        self._seed = seed
        self._referee = referee
        self._done: list[int] = []
        """Targets in the order in which the station heard of them."""

    def status(
        self, now_ns: int, phase: Phase, detail: str, elapsed_s: float, crew: list[Point], excluded: Iterable[str]
    ) -> RunStatus:
        """The mission as the station sees it; ``crew``: where the robots that belong to it are."""
        heard = (k for k in range(len(self._scenario.targets)) if self.told_occupied >> k & 1)
        self._done += [k for k in heard if k not in self._done]
        value, pieces = summary(crew, self._arena.control.sensing_radius_m)
        return RunStatus(
            stamp_ns=now_ns,
            mission=MISSION,
            phase=phase,
            detail=detail,
            elapsed_s=round(elapsed_s, 6),
            targets=len(self._scenario.targets),
            occupied=tuple(self._done),
            lambda2=round(value, 6),
            components=pieces,
            excluded=tuple(sorted(excluded)),
            min_distance_m=metres(min(self._referee.min_distance_m, 1000.0)),
        )

    def result(
        self, completed: bool, now_ns: int, mission_s: float, occupied: int, period_s: float, why: str
    ) -> Result:
        """What became of the mission so far; ``period_s``: of a control step, ``why``: it is not complete."""
        control, scenario, referee = self._arena.control, self._scenario, self._referee
        speed_mps, hold_s, reach_m = control.max_speed_mps, control.occupying_time_s, control.reach_m
        bound_s = lower_bound_s(scenario.starts, scenario.targets, speed_mps, hold_s, reach_m)
        return Result(
            seed=self._seed,
            robots=len(scenario.starts),
            targets=len(scenario.targets),
            completed=completed,
            occupied=occupied,
            mission_s=round(mission_s, 4),
            disconnected_steps=referee.disconnected,
            collisions=referee.collisions,
            min_distance_m=round(referee.min_distance_m, 5) if math.isfinite(referee.min_distance_m) else 0.0,
            lower_bound_s=round(bound_s, 4),
            ratio_to_lower_bound=round(mission_s / bound_s, 4) if completed and bound_s > 0 else None,
            run_steps=round(mission_s / period_s),
            ending="completed" if completed else "time up",
            why="" if completed else why,
            time_s=self.book.close(now_ns) if self.book is not None else {},
        )


def truth(name: str, now_ns: int, pose: tuple[float, float, float]) -> MotorBatch:
    """Where a body really is: x and y, m, heading, rad."""
    x, y, heading = pose
    return MotorBatch(
        robot=name,
        samples=(),
        true_ns=now_ns,
        true_x_m=metres(x),
        true_y_m=metres(y),
        true_heading_rad=radians(math.remainder(heading, math.tau)),
        true_speed_mps=0.0,
    )
