"""What a run was worth, in numbers, from its messages alone. Pure.

The same function judges live (from the station's own messages) and afterwards (from the recording).
Definitions:

- The *mission* lasts from the start (stamp less ``elapsed_s`` of the first ``running`` RunStatus) for
  the ``elapsed_s`` of the status that ends it; ``completed`` is what that status says, and that every
  target is in ``occupied``.
- ``occupied``: targets in the union of the ``NeighbourState.occupied`` bitmaps stamped within the
  mission. ``visited``: those of them that a robot's true position came within ``control.reach_m`` and
  20 mm of during the mission.
- ``run_steps``: control steps within the mission, of the robot that took most.
- A *frame* is a MocapFrame exposed within the mission; a robot without a valid pose counts where it
  was last seen. The *disk graph* joins robots no farther apart than r_c; the *enforced graph* joins
  those of them that both enforce the link (newest RobotStep of each on that frame or before).
- ``min_lambda2``: least lambda_2 of the disk graph. ``disconnected_frames``: frames in which the disk
  graph or, in profile ``field``, the enforced graph is in pieces; ``disconnected_disk_frames`` and
  ``disconnected_enforced_frames`` count them separately.
- Distances are between *true positions* (interpolated MotorBatch truth where there is any, else the
  last known pose) at every exposure from the start to 1 s after the end. ``collisions``: times a pair
  came closer than ``platform.diameter_m``.
- ``lower_bound_s``: :func:`groundstation.targets.lower_bound_s` for the positions in the mission's
  first frame.
- ``pose_to_wheel_ms``: from ``transmit_ns`` of the frame a RobotStep acted on to the first MotorSample
  stamped at or after its ``step_ns``; where a robot's motors are not emulated, to its ``write_ns``.
- ``stop_ms``: from the stamp of a stop's first request to each robot's first report that obeys it.
- ``loop``: ``nominal_hz`` is the measured frame rate over k = max(1, round(control period x frame
  rate)); ``p99_jitter_ms`` the 99th percentile of abs(interval - nominal); ``deadline_misses`` sums
  over intervals longer than 1.5 nominal the steps left out, at least one each.
- ``frames_dropped``: frame numbers of a mocap session missing from the recording within the mission;
  ``frames_dropped_bridge``: growth of MocapHealth.frames_dropped, from the last health message before
  the start (or the first there is) to the last before the end.
- Percentiles interpolate linearly. Of an empty set they are null.
"""

import msgspec
import numpy as np

from groundstation import measures
from groundstation.connectivity import tree_floor
from groundstation.history import Floats, History, Mission
from groundstation.measures import Loop, Spread
from groundstation.targets import lower_bound_s

SETTLE_NS = 1_000_000_000


class RobotMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """One robot's share of the mission."""

    targets: int
    path_m: float
    nearest_m: float | None
    """Least distance to another robot."""
    seconds: dict[str, float]
    """Where the time went, by activity (:data:`groundstation.activity.ACTIVITIES`)."""
    invalid_frames: int
    faults: tuple[str, ...]
    """Reasons of every fault and stop state it reported, in order."""


class Metrics(msgspec.Struct, frozen=True, kw_only=True):
    """See the module for the definition of each number."""

    completed: bool
    ending: str
    detail: str
    targets: int
    occupied: int
    visited: int
    mission_s: float
    run_steps: int
    frames: int
    min_lambda2: float
    lambda2_floor: float
    disconnected_frames: int
    disconnected_disk_frames: int
    disconnected_enforced_frames: int
    links_removed: int
    """Links enforced at both ends that ceased to be, within the mission."""
    collisions: int
    min_distance_m: float | None
    lower_bound_s: float
    ratio_to_lower_bound: float | None
    seed: int
    profile: str
    pose_to_wheel_ms: Spread
    pose_to_wheel_until: str
    """``motor``: the emulated controllers decoded it; ``write``: the bus write returned; ``mixed``."""
    pose_age_ms: Spread
    """Exposure to the control law's entry."""
    loop: dict[str, Loop]
    robots: dict[str, RobotMetrics]
    frames_dropped: int
    frames_dropped_bridge: int
    stops: int
    stop_ms: Spread = Spread(p50=None, p99=None, max=None)
    """STOP to each robot's report that obeys it."""
    undecodable: int = 0


def compute(history: History, undecodable: int = 0) -> Metrics | None:
    """The metrics of a run; None when no mission was started."""
    mission = history.mission()
    if mission is None:
        return None
    arena, cloud = history.arena, history.cloud
    points = [(t.x_m, t.y_m) for t in cloud.targets] if cloud else []
    inside = measures.within(history.exposure_ns, mission.start_ns, mission.end_ns)
    known = history.last_known()[inside, :, :2]
    graphs = measures.graphs(history, known, history.exposure_ns[inside])
    rolling = measures.within(history.exposure_ns, mission.start_ns, mission.end_ns + SETTLE_NS)
    gaps = measures.distances(history.true_positions()[rolling])
    occupied = measures.occupied(history, mission)
    starts = [(float(x), float(y)) for x, y in known[0]] if len(known) and not np.isnan(known[0]).any() else []
    control = arena.control
    bound_s = lower_bound_s(starts, points, control.max_speed_mps, control.occupying_time_s, control.reach_m)
    mission_s = (mission.end_ns - mission.start_ns) / 1e9
    completed = mission.ending == "completed" and len(occupied) == len(points) > 0
    rate_hz = measures.frame_rate(history.exposure_ns[inside])
    loop = {
        name: measures.loop(history.tracks[name], mission, rate_hz, control.control_period_s) for name in history.robots
    }
    latencies, until = measures.pose_to_wheel(history, mission)
    return Metrics(
        completed=completed,
        ending=mission.ending,
        detail=mission.detail,
        targets=len(points),
        occupied=len(occupied),
        visited=measures.visited(history, occupied, rolling),
        mission_s=round(mission_s, 3),
        run_steps=max((entry.steps for entry in loop.values()), default=0),
        frames=len(known),
        min_lambda2=round(min((value for value, *_ in graphs), default=0.0), 6),
        lambda2_floor=round(tree_floor(len(history.robots)), 6),
        disconnected_frames=sum(disk or enforced for _, disk, enforced in graphs),
        disconnected_disk_frames=sum(disk for _, disk, _ in graphs),
        disconnected_enforced_frames=sum(enforced for *_, enforced in graphs),
        links_removed=measures.links_removed(history, history.exposure_ns[inside]),
        collisions=measures.collisions(gaps, arena.platform.diameter_m),
        min_distance_m=measures.least(gaps),
        lower_bound_s=round(bound_s, 3),
        ratio_to_lower_bound=round(mission_s / bound_s, 4) if completed and bound_s > 0 else None,
        seed=cloud.seed if cloud else arena.targets.seed,
        profile=control.profile,
        pose_to_wheel_ms=measures.spread(latencies),
        pose_to_wheel_until=until,
        pose_age_ms=measures.spread(measures.pose_ages_ms(history, mission)),
        loop=loop,
        robots=_robots(history, mission, known, gaps, occupied),
        frames_dropped=measures.dropped(history, inside),
        frames_dropped_bridge=measures.growth(history, mission),
        stops=len(history.stops),
        stop_ms=measures.spread(measures.stop_latencies_ms(history)),
        undecodable=undecodable,
    )


def encode(metrics: Metrics) -> bytes:
    """``metrics.json``."""
    return msgspec.json.format(msgspec.json.encode(metrics)) + b"\n"


def failures(metrics: Metrics | None) -> list[str]:
    """Why the mission is not a success, in words; empty for a success."""
    if metrics is None:
        return ["no mission was started"]
    found = []
    if not metrics.completed:
        ending = metrics.ending or "recording ends before the mission"
        found.append(f"{metrics.occupied} of {metrics.targets} targets occupied ({ending}: {metrics.detail})")
    if metrics.disconnected_frames:
        found.append(f"network split in {metrics.disconnected_frames} of {metrics.frames} frames")
    if metrics.collisions:
        found.append(f"{metrics.collisions} collisions, least distance {metrics.min_distance_m} m")
    return found


def _robots(
    history: History, mission: Mission, known: Floats, gaps: Floats, occupied: dict[int, str]
) -> dict[str, RobotMetrics]:
    poses = history.poses()[measures.within(history.exposure_ns, mission.start_ns, mission.end_ns)]
    found = {}
    for i, name in enumerate(history.robots):
        track = history.tracks[name]
        path = known[:, i][~np.isnan(known[:, i, 0])]
        reasons = [f"{report.run}: {report.reason}" for report in track.reports if report.run in ("fault", "stopped")]
        found[name] = RobotMetrics(
            targets=sum(robot == name for robot in occupied.values()),
            path_m=round(measures.path_m(path), 3),
            nearest_m=measures.least(gaps[:, i]),
            seconds=measures.seconds(track, mission),
            invalid_frames=int(np.isnan(poses[:, i, 0]).sum()),
            faults=tuple(dict.fromkeys(reasons)),
        )
    return found
