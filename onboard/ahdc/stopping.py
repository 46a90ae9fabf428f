"""Where a robot comes to rest: the brake model behind the field profile's stop points.

A wheel's rim speed follows its command as dv/dt = clip((command - v) / lag, -a, +a): a first-order lag
with a limited acceleration. A body with a calibrated *interval* of (a, lag) is bracketed by the weakest
brake (a low, lag high: the ``long`` stop) and the strongest (a high, lag low: the ``short`` stop).

The resting place after "wheels to zero" depends, seen from the body, on the two rim speeds alone, so it
is tabulated once (fine numerical integration) and interpolated.
"""

import itertools
import math
from typing import Final, NamedTuple

import numpy as np

from onboard.ahdc.parameters import Parameters, Vector

INTEGRATION_STEP_S: Final = 0.002
NODES: Final = 49
"""Table nodes an axis; with linear interpolation the error stays below 0.3 mm up to u_max."""
TABLE_RANGE: Final = 1.15
"""Rim speeds covered, in units of u_max: measured speed may overshoot."""


class Brake(NamedTuple):
    """One brake model: rim deceleration and first-order lag."""

    deceleration_mps2: float
    lag_s: float


def rim_after(speed_mps: float, command_mps: float, brake: Brake, duration_s: float) -> tuple[float, float]:
    """(rim speed, rim way) after following a constant command; closed form."""
    gap = command_mps - speed_mps
    a, lag = brake
    knee = a * lag
    way = 0.0
    if gap > knee or -gap > knee:
        slope, ramp_s = (a, (gap - knee) / a) if gap > 0 else (-a, (-gap - knee) / a)
        if ramp_s >= duration_s:
            return (speed_mps + slope * duration_s, (speed_mps + slope * duration_s / 2) * duration_s)
        way = (speed_mps + slope * ramp_s / 2) * ramp_s
        speed_mps += slope * ramp_s
        duration_s -= ramp_s
        gap = command_mps - speed_mps
    if lag < 1e-6:
        return (command_mps, way + command_mps * duration_s)
    decay = math.exp(-duration_s / lag)
    return (command_mps - gap * decay, way + command_mps * duration_s - gap * lag * (1 - decay))


def stop_distance_m(speed_mps: float, brake: Brake) -> float:
    """Straight way to rest from a speed; never negative."""
    v, (a, lag) = abs(speed_mps), brake
    knee = a * lag
    return v * lag if v <= knee else (v * v - knee * knee) / (2 * a) + knee * lag


def speed_for_stop_mps(distance_m: float, brake: Brake) -> float:
    """The speed whose straight stop takes this distance: inverse of :func:`stop_distance_m`."""
    if distance_m <= 0:
        return 0.0
    a, lag = brake
    knee = a * lag
    if lag > 0 and distance_m <= knee * lag:
        return distance_m / lag
    return math.sqrt(max(0.0, 2 * a * (distance_m - knee * lag) + knee * knee))


class StopTable:
    """Resting place after immediate full braking, by rim speeds, for one brake model.

    Places are (forward, left), m, as seen from the body.
    """

    def __init__(self, brake: Brake, max_rim_mps: float, wheel_separation_m: float) -> None:
        self.brake = brake
        self.wheel_separation_m = wheel_separation_m
        self._limit_mps = max_rim_mps * TABLE_RANGE
        self._scale = (NODES - 1) / (2 * self._limit_mps)
        axis = np.linspace(-self._limit_mps, self._limit_mps, NODES)
        lower, upper = np.triu_indices(NODES)
        places = _integrate_stop(axis, lower, upper, brake, wheel_separation_m)
        nodes = [[(0.0, 0.0)] * NODES for _ in range(NODES)]
        for i, j, forward, sideways in zip(lower, upper, *(array.tolist() for array in places), strict=True):
            nodes[i][j] = (forward, sideways)
            nodes[j][i] = (forward, -sideways)
        self._cells = [
            [(*row[j], *row[j + 1], *next_row[j], *next_row[j + 1]) for j in range(NODES - 1)]
            for row, next_row in itertools.pairwise(nodes)
        ]

    def place(self, left_mps: float, right_mps: float) -> Vector:
        """Resting place from rim speeds; beyond the table's range the edge is scaled up."""
        limit = self._limit_mps
        if not (-limit <= left_mps <= limit and -limit <= right_mps <= limit):
            excess = max(abs(left_mps), abs(right_mps)) / limit
            if excess > 1:
                forward, left = self.place(left_mps / excess, right_mps / excess)
                return (forward * excess * excess, left * excess * excess)
        u = (left_mps + limit) * self._scale
        v = (right_mps + limit) * self._scale
        i, j = int(u), int(v)
        if i > NODES - 2:
            i = NODES - 2
        if j > NODES - 2:
            j = NODES - 2
        u -= i
        v -= j
        a_forward, a_left, b_forward, b_left, c_forward, c_left, d_forward, d_left = self._cells[i][j]
        wa, wb, wc, wd = (1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v
        return (
            wa * a_forward + wb * b_forward + wc * c_forward + wd * d_forward,
            wa * a_left + wb * b_left + wc * c_left + wd * d_left,
        )

    def places(self, left_mps: float, right_mps: float, other: "StopTable") -> tuple[float, float, float, float]:
        """:meth:`place` of this table and of another of the same range."""
        limit = self._limit_mps
        if not (-limit <= left_mps <= limit and -limit <= right_mps <= limit) or other._limit_mps != limit:
            return (*self.place(left_mps, right_mps), *other.place(left_mps, right_mps))
        u = (left_mps + limit) * self._scale
        v = (right_mps + limit) * self._scale
        i, j = int(u), int(v)
        if i > NODES - 2:
            i = NODES - 2
        if j > NODES - 2:
            j = NODES - 2
        u -= i
        v -= j
        wa, wb, wc, wd = (1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v
        a, a_left, b, b_left, c, c_left, d, d_left = self._cells[i][j]
        p, p_left, q, q_left, r, r_left, s, s_left = other._cells[i][j]
        return (
            wa * a + wb * b + wc * c + wd * d,
            wa * a_left + wb * b_left + wc * c_left + wd * d_left,
            wa * p + wb * q + wc * r + wd * s,
            wa * p_left + wb * q_left + wc * r_left + wd * s_left,
        )

    def place_after(
        self, left_mps: float, right_mps: float, command_left_mps: float, command_right_mps: float, period_s: float
    ) -> Vector:
        """Resting place after one period of a command and then full braking."""
        new_left, way_left = rim_after(left_mps, command_left_mps, self.brake, period_s)
        new_right, way_right = rim_after(right_mps, command_right_mps, self.brake, period_s)
        turn = (way_right - way_left) / self.wheel_separation_m
        way = (way_left + way_right) / 2
        forward, left = self.place(new_left, new_right)
        cosine, sine = math.cos(turn), math.sin(turn)
        return (
            way * math.cos(turn / 2) + forward * cosine - left * sine,
            way * math.sin(turn / 2) + forward * sine + left * cosine,
        )


Grid = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Nodes = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


def _integrate_stop(
    rims: Grid, lower: Nodes, upper: Nodes, brake: Brake, wheel_separation_m: float
) -> tuple[Grid, Grid]:
    """Midpoint integration of the unicycle while both wheels brake, tail included.

    :param rims: rim speeds, m/s; ``lower`` and ``upper`` say which of them the left and the right wheel begin with.
    """
    a, lag = brake
    left, right = rims[lower], rims[upper]
    forward, sideways, turn = np.zeros_like(left), np.zeros_like(left), np.zeros_like(left)
    fastest = float(np.max(np.abs(left)))
    horizon_s = fastest / a + 9 * lag + INTEGRATION_STEP_S
    step_s = min(INTEGRATION_STEP_S, max(horizon_s / 2000, 1e-5))
    decay = math.exp(-step_s / lag) if lag > 1e-9 else 0.0
    for _ in range(math.ceil(horizon_s / step_s)):
        rims = _brake(rims, a, a * lag, decay, step_s)
        new_left, new_right = rims[lower], rims[upper]
        way = (left + right + new_left + new_right) * (step_s / 4)
        rotation = (right + new_right - left - new_left) * (step_s / 2 / wheel_separation_m)
        middle = turn + rotation / 2
        forward += way * np.cos(middle)
        sideways += way * np.sin(middle)
        turn += rotation
        left, right = new_left, new_right
    return forward, sideways


def _brake(speed: Grid, a: float, knee: float, decay: float, step_s: float) -> Grid:
    linear = np.sign(speed) * np.maximum(np.abs(speed) - a * step_s, 0.0)
    return np.where(np.abs(speed) > knee, linear, speed * decay)


class Stops(NamedTuple):
    """The bracket of resting places: weakest and strongest brake."""

    long: StopTable
    short: StopTable

    def places(self, left_mps: float, right_mps: float) -> tuple[float, float, float, float]:
        """Resting places (forward, left, forward, left) by the long and the short table, in one look at both."""
        return self.long.places(left_mps, right_mps, self.short)


def stop_tables(parameters: Parameters) -> Stops:
    """Tables for both ends of the calibrated brake interval."""
    (weak, strong), (quick, slow) = parameters.brake_deceleration_mps2, parameters.motor_lag_s
    make = _cached_table
    limit, separation = parameters.max_speed_mps, parameters.wheel_separation_m
    return Stops(make(Brake(weak, slow), limit, separation), make(Brake(strong, quick), limit, separation))


_tables: dict[tuple[Brake, float, float], StopTable] = {}


def _cached_table(brake: Brake, max_rim_mps: float, wheel_separation_m: float) -> StopTable:
    key = (brake, max_rim_mps, wheel_separation_m)
    if key not in _tables:
        _tables[key] = StopTable(brake, max_rim_mps, wheel_separation_m)
    return _tables[key]
