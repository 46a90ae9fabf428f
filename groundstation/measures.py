"""The measurements behind :mod:`groundstation.metrics`, one function each. Pure.

Arrays follow :mod:`groundstation.history`: times in ns of site time, positions in metres, NaN for unknown.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.connectivity import components, disk_graph, lambda2, mutual
from groundstation.history import Floats, History, Integers, Mission, RobotTrack

Mask = NDArray[np.bool_]
STAMP_SLACK_NS = 2_000_000
VISIT_SLACK_M = 0.02


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """Percentiles of a set of numbers, null where it is empty."""

    p50: float | None
    p99: float | None
    max: float | None


class Loop(msgspec.Struct, frozen=True, kw_only=True):
    """One robot's control loop within the mission."""

    nominal_hz: float
    rate_hz: float
    p99_jitter_ms: float | None
    deadline_misses: int
    steps: int


def within(stamps: Integers, first_ns: int, last_ns: int) -> Mask:
    return (stamps >= first_ns) & (stamps <= last_ns)


def spread(values: Sequence[float]) -> Spread:
    if not len(values):
        return Spread(p50=None, p99=None, max=None)
    p50, p99, top = (round(float(value), 3) for value in np.percentile(values, (50, 99, 100)))
    return Spread(p50=p50, p99=p99, max=top)


def graphs(history: History, known: Floats, exposure_ns: Integers) -> list[tuple[float, bool, bool]]:
    """(lambda_2, disk graph in pieces, enforced graph in pieces) of every frame."""
    n = len(history.robots)
    field = history.arena.control.profile == "field"
    found = []
    for positions, stamp_ns in zip(known, exposure_ns, strict=True):
        disk = disk_graph([(x, y) for x, y in positions.tolist()], history.arena.control.sensing_radius_m)
        split = len(components(n, disk)) > 1
        kept = enforced(history, int(stamp_ns)) & disk if field else disk
        found.append((lambda2(n, disk), split, field and len(components(n, kept)) > 1))
    return found


def enforced(history: History, exposure_ns: int) -> frozenset[tuple[int, int]]:
    entries = [history.tracks[name].links_at(exposure_ns) for name in history.robots]
    return mutual([entry.enforced if entry else () for entry in entries])


def links_removed(history: History, exposure_ns: Integers) -> int:
    if not len(exposure_ns):
        return 0
    first, last = int(exposure_ns[0]), int(exposure_ns[-1])
    changes = {e.exposure_ns for track in history.tracks.values() for e in track.links if first < e.exposure_ns <= last}
    graphs = [enforced(history, stamp_ns) for stamp_ns in (first, *sorted(changes))]
    return sum(len(before - after) for before, after in pairwise(graphs))


def distances(positions: Floats) -> Floats:
    """Centre distances, shape (frames, robots, robots), NaN on the diagonal and where unknown."""
    gaps: Floats = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3)
    each = np.arange(positions.shape[1])
    gaps[:, each, each] = np.nan
    return gaps


def least(gaps: Floats) -> float | None:
    return None if not gaps.size or np.isnan(gaps).all() else round(float(np.nanmin(gaps)), 5)


def collisions(gaps: Floats, diameter_m: float) -> int:
    touching = np.triu(gaps < diameter_m, 1)
    before = np.concatenate([np.zeros_like(touching[:1]), touching[:-1]])
    return int((touching & ~before).sum())


def occupied(history: History, mission: Mission) -> dict[int, str]:
    """Target to the robot that told first, of the targets occupied within the mission."""
    known = {target.index for target in history.cloud.targets} if history.cloud else set()
    return {
        entry.target: entry.robot
        for entry in history.occupations.values()
        if entry.target in known and mission.start_ns <= entry.stamp_ns <= mission.end_ns + STAMP_SLACK_NS
    }


def visited(history: History, occupied: dict[int, str], inside: Mask) -> int:
    if history.cloud is None:
        return 0
    positions = history.true_positions()[inside].reshape(-1, 2)
    reach_m = history.arena.control.reach_m + VISIT_SLACK_M
    targets = [t for t in history.cloud.targets if t.index in occupied]
    return sum(bool((np.hypot(positions[:, 0] - t.x_m, positions[:, 1] - t.y_m) <= reach_m).any()) for t in targets)


def frame_rate(exposure_ns: Integers) -> float:
    span_ns = int(exposure_ns[-1] - exposure_ns[0]) if len(exposure_ns) > 1 else 0
    return (len(exposure_ns) - 1) / span_ns * 1e9 if span_ns else 0.0


def loop(track: RobotTrack, mission: Mission, frame_rate_hz: float, period_s: float) -> Loop:
    stamps = np.array(track.step_ns, dtype=np.int64)
    stamps = stamps[within(stamps, mission.start_ns, mission.end_ns)]
    nominal_hz = frame_rate_hz / max(1, round(period_s * frame_rate_hz))
    rate_hz, jitter, misses = frame_rate(stamps), None, 0
    if len(stamps) > 1 and nominal_hz:
        periods = np.diff(stamps) * 1e-9 * nominal_hz
        jitter = round(float(np.percentile(np.abs(periods - 1), 99)) / nominal_hz * 1e3, 3)
        misses = int(np.maximum(1, np.round(periods[periods > 1.5]) - 1).sum())
    return Loop(
        nominal_hz=round(nominal_hz, 3),
        rate_hz=round(rate_hz, 3),
        p99_jitter_ms=jitter,
        deadline_misses=misses,
        steps=len(stamps),
    )


def pose_to_wheel(history: History, mission: Mission) -> tuple[list[float], str]:
    transmit_ns = dict(zip(history.exposure_ns.tolist(), history.transmit_ns.tolist(), strict=True))
    latencies: list[float] = []
    ends = set()
    for track in history.tracks.values():
        motor_ns = np.array(track.motor_ns, dtype=np.int64)
        ends.add("motor" if len(motor_ns) else "write")
        for step_ns, write_ns, exposure_ns in zip(track.step_ns, track.write_ns, track.exposure_ns, strict=True):
            sent_ns = transmit_ns.get(exposure_ns)
            if sent_ns is None or not mission.start_ns <= step_ns <= mission.end_ns:
                continue
            if not len(motor_ns):
                latencies.append((write_ns - sent_ns) / 1e6)
            elif (k := int(np.searchsorted(motor_ns, step_ns))) < len(motor_ns):
                latencies.append((int(motor_ns[k]) - sent_ns) / 1e6)
    return latencies, ends.pop() if len(ends) == 1 else "mixed"


def pose_ages_ms(history: History, mission: Mission) -> list[float]:
    return [
        (step_ns - exposure_ns) / 1e6
        for track in history.tracks.values()
        for step_ns, exposure_ns in zip(track.step_ns, track.exposure_ns, strict=True)
        if mission.start_ns <= step_ns <= mission.end_ns
    ]


def stop_latencies_ms(history: History) -> list[float]:
    """From each stop's first request to every robot's first report that obeys it."""
    return [
        (told_ns - stop.stamp_ns) / 1e6
        for stop in history.stops
        for track in history.tracks.values()
        for told_ns in [next((r.stamp_ns for r in track.reports if r.stop_id == stop.stop_id), None)]
        if told_ns is not None
    ]


def path_m(points: Floats, stride_m: float = 0.01) -> float:
    """Length of a path, taken in strides so that measurement noise does not add up."""
    total, last = 0.0, None
    for x, y in points.tolist():
        if last is None:
            last = (x, y)
        elif (gap := math.dist(last, (x, y))) >= stride_m:
            total, last = total + gap, (x, y)
    return total


def seconds(track: RobotTrack, mission: Mission) -> dict[str, float]:
    edges = [*track.doing, None]
    totals: dict[str, float] = {}
    for doing, following in pairwise(edges):
        assert doing is not None
        start_ns = max(doing.since_ns, mission.start_ns)
        end_ns = min(following.since_ns if following else mission.end_ns, mission.end_ns)
        if end_ns > start_ns:
            totals[doing.activity] = totals.get(doing.activity, 0.0) + (end_ns - start_ns) / 1e9
    return {name: round(total, 3) for name, total in sorted(totals.items())}


def dropped(history: History, inside: Mask) -> int:
    numbers = [pair for pair, kept in zip(history.frame_numbers, inside.tolist(), strict=True) if kept]
    return sum(after[1] - before[1] - 1 for before, after in pairwise(numbers) if before[0] == after[0])


def growth(history: History, mission: Mission) -> int:
    until = [h for h in history.health if h.stamp_ns <= mission.end_ns]
    before = [h for h in until if h.stamp_ns <= mission.start_ns] or until[:1]
    return max(0, until[-1].frames_dropped - before[-1].frames_dropped) if until else 0
