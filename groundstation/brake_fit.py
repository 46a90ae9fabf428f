"""A robot's brakes, by least squares from motion capture. Pure.

Stops are fitted to ``dv/dt = clip((command - v) / lag, +-a)``.
Each stop says its deceleration and lag, and how well it knows them; the interval over all of them is believed only
with enough stops that do.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from groundstation.calibration import CalibrationError, Numbers, Pose

LEAST_STOP_MPS = 0.25
STOP_S = 0.6
LEAST_STOPS = 9
"""The next stop lies between the extremes of n with a likelihood of (n - 1) / (n + 1), whatever their distribution:
four in five for nine, two in three for five."""
SURE_SHARE = 0.1
"""A stop counts whose fit knows deceleration and lag this well: one standard deviation as a share of the value."""
POSE_ERROR_M = 1e-4
"""Residuals of a fit are taken for at least this."""


class Brakes(NamedTuple):
    """Intervals over all stops seen, and how well the fits know each end: one standard deviation, as a share."""

    deceleration_mps2: tuple[float, float]
    lag_s: tuple[float, float]
    stops: int
    deceleration_share: float
    lag_share: float


def way_of_stop(time_s: Numbers, speed_mps: float, lag_s: float, deceleration_mps2: float) -> Numbers:
    """Way rolled after the command to stop."""
    knee = deceleration_mps2 * lag_s
    ramp_s = max(0.0, speed_mps - knee) / deceleration_mps2
    early, late = np.minimum(time_s, ramp_s), np.maximum(time_s - ramp_s, 0.0)
    rest = min(speed_mps, knee)
    return speed_mps * early - 0.5 * deceleration_mps2 * early**2 + rest * lag_s * (1.0 - np.exp(-late / lag_s))


def fit_stop(time_s: Numbers, way_m: Numbers, speed_mps: float) -> tuple[float, float]:
    """(deceleration, lag) of one stop: a grid, twice refined."""
    best, span = (2.0, 0.1), (4.0, 4.0)
    for _ in range(4):
        decelerations = best[0] * np.geomspace(1 / span[0], span[0], 25)
        lags = best[1] * np.geomspace(1 / span[1], span[1], 25)
        found = [
            (float(np.sum((way_of_stop(time_s, speed_mps, lag, a) - way_m) ** 2)), float(a), float(lag))
            for a in decelerations
            for lag in lags
        ]
        _, *pair = min(found)
        best, span = (pair[0], pair[1]), (span[0] ** 0.3, span[1] ** 0.3)
    return best


def sureness(time_s: Numbers, way_m: Numbers, speed_mps: float, stop: tuple[float, float]) -> tuple[float, float]:
    """Standard deviations of a fitted (deceleration, lag), as shares of each, by the fit's residuals and slopes.

    Infinite where the way does not depend on one of them, as on the deceleration when lag alone ends the motion.
    """
    deceleration, lag = stop
    step = 1e-3
    slopes = np.column_stack(
        (
            way_of_stop(time_s, speed_mps, lag, deceleration * (1 + step))
            - way_of_stop(time_s, speed_mps, lag, deceleration * (1 - step)),
            way_of_stop(time_s, speed_mps, lag * (1 + step), deceleration)
            - way_of_stop(time_s, speed_mps, lag * (1 - step), deceleration),
        )
    ) / (2 * step)
    residuals = way_of_stop(time_s, speed_mps, lag, deceleration) - way_m
    error_m = max(POSE_ERROR_M, float(np.sqrt(residuals @ residuals / max(1, len(way_m) - 2))))
    normal = slopes.T @ slopes
    if np.linalg.cond(normal) > 1e9:
        return (math.inf, math.inf)
    shares = error_m * np.sqrt(np.diag(np.linalg.inv(normal)))
    return (float(shares[0]), float(shares[1]))


def fit_brakes(poses: Sequence[Pose], stops_s: Sequence[float], reserve: float = 0.05) -> Brakes:
    """Brake interval over all stops from a straight run.

    :param stops_s: when a command to stop was written.
    :param reserve: share by which the interval is widened at both ends.
    :raises CalibrationError: fewer than ``LEAST_STOPS`` from ``LEAST_STOP_MPS`` or more that each determine both values
        to ``SURE_SHARE``, or stops so different that their middle is not known to ``reserve``.
    """
    body = np.array(poses)
    pairs, shares = [], []
    unsure = 0
    for stop_s in stops_s:
        run = body[(body[:, 0] >= stop_s - 0.1) & (body[:, 0] <= stop_s)]
        roll = body[(body[:, 0] >= stop_s) & (body[:, 0] <= stop_s + STOP_S)]
        if len(run) < 5 or len(roll) < 20 or abs(roll[-1, 3] - run[0, 3]) > 0.2:
            continue
        slope_x, at_x = np.polyfit(run[:, 0] - stop_s, run[:, 1], 1)
        slope_y, at_y = np.polyfit(run[:, 0] - stop_s, run[:, 2], 1)
        speed = math.hypot(slope_x, slope_y)
        if speed >= LEAST_STOP_MPS:
            times, way = roll[:, 0] - stop_s, np.hypot(roll[:, 1] - at_x, roll[:, 2] - at_y)
            pair = fit_stop(times, way, speed)
            share = sureness(times, way, speed, pair)
            if max(share) > SURE_SHARE:
                unsure += 1
            else:
                pairs.append(pair)
                shares.append(share)
    if len(pairs) < LEAST_STOPS:
        more = (
            f" and {unsure} more whose deceleration or lag the fit does not know to {SURE_SHARE:.0%}" if unsure else ""
        )
        raise CalibrationError(
            f"{len(pairs)} stops from {LEAST_STOP_MPS:g} m/s or faster, straight ahead{more}; {LEAST_STOPS} are "
            f"needed, for the next stop to lie between their extremes four times in five: drive at full speed and stop "
            "ten times"
        )
    scatter = np.std(np.log(pairs), axis=0, ddof=1) / math.sqrt(len(pairs))
    if max(scatter) > reserve:
        raise CalibrationError(
            f"{len(pairs)} stops know the middle deceleration to {scatter[0]:.0%} and the middle lag to "
            f"{scatter[1]:.0%}, less well than the reserve of {reserve:.0%}: stop more often, on the same floor, "
            "straight ahead"
        )
    decelerations, lags = [a for a, _ in pairs], [lag for _, lag in pairs]
    low, high = 1.0 - reserve, 1.0 + reserve
    return Brakes(
        (low * min(decelerations), high * max(decelerations)),
        (low * min(lags), high * max(lags)),
        len(pairs),
        max(share for share, _ in shares),
        max(share for _, share in shares),
    )
