"""What a robot's drive really is, by least squares from motion capture and wheel feedback. Pure.

Wheel radii and separation follow from the differential drive's own equations over short windows,
``turn = (r_R dR - r_L dL) / b`` and ``way = (r_L dL + r_R dR) / 2``, the way being the chord
corrected for the arc. Brakes: :mod:`groundstation.brake_fit`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

WINDOW_S = 0.25
MAX_GAP_S = 0.1
"""Windows with a longer hole in either stream are left out."""
MAX_STEP_RAD = 6.0
"""Between two samples; more is an odometer that started afresh."""
LEAST_WAY_M = 1.0
LEAST_TURN_RAD = 3.0
"""To be seen in each direction: a spin one way cannot tell separation from a crooked heading."""

Numbers = NDArray[np.float64]


class CalibrationError(ValueError):
    """The data does not say; the text tells what to drive."""


class Pose(NamedTuple):
    """A rigid body at mid-exposure, s, m and rad."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float


class Turned(NamedTuple):
    """Wheel angles as the driver reports them, s and rad."""

    time_s: float
    left_rad: float
    right_rad: float


class Geometry(NamedTuple):
    """Factors on the nominal dimensions, and how far the fit is off."""

    left_multiplier: float
    right_multiplier: float
    separation_multiplier: float
    way_rms_m: float
    turn_rms_rad: float
    windows: int


class Windows(NamedTuple):
    """Motion over ``WINDOW_S``, one row each: chord in m (signed by the heading), turn, wheel turns, course."""

    way_m: Numbers
    turn_rad: Numbers
    left_rad: Numbers
    right_rad: Numbers
    course_rad: Numbers
    """Direction of travel minus heading, folded to forward motion."""


def windows(poses: Sequence[Pose], wheels: Sequence[Turned]) -> Windows:
    """Cut the streams.

    :raises CalibrationError: too little of either.
    """
    if len(poses) < 10 or len(wheels) < 10:
        raise CalibrationError(f"{len(poses)} poses and {len(wheels)} wheel samples are too few; drive for a minute")
    body, turned = np.array(poses), np.array(wheels)
    heading = np.unwrap(body[:, 3])
    rows = []
    first = 0
    for last in range(len(body)):
        if body[last, 0] - body[first, 0] < WINDOW_S:
            continue
        begin, end = np.searchsorted(turned[:, 0], (body[first, 0], body[last, 0]))
        inside = turned[max(0, begin - 1) : end + 1]
        if _whole(body[first : last + 1, 0], inside, body[first, 0], body[last, 0]):
            at = body[[first, last], 0]
            left = np.diff(np.interp(at, inside[:, 0], inside[:, 1]))[0]
            right = np.diff(np.interp(at, inside[:, 0], inside[:, 2]))[0]
            dx, dy = body[last, 1:3] - body[first, 1:3]
            turn = heading[last] - heading[first]
            rows.append((dx, dy, turn, left, right, heading[first] + 0.5 * turn))
        first = last
    if not rows:
        raise CalibrationError("no quarter second without a hole in poses or feedback; check both streams")
    dx, dy, turn, left, right, middle = np.array(rows).T
    half = 0.5 * turn
    arc = np.where(np.abs(half) > 1e-6, half / np.sin(np.where(np.abs(half) > 1e-6, half, 1.0)), 1.0)
    forward = np.sign(left + right)
    course = np.angle(np.exp(1j * (np.arctan2(dy, dx) + np.where(forward < 0, math.pi, 0.0) - middle)))
    return Windows(np.hypot(dx, dy) * arc * forward, turn, left, right, course)


def _whole(times: Numbers, inside: Numbers, begin_s: float, end_s: float) -> bool:
    if len(inside) < 3 or inside[0, 0] > begin_s or inside[-1, 0] < end_s:
        return False
    gap_s = max(np.diff(times).max(), np.diff(inside[:, 0]).max())
    return bool(gap_s <= MAX_GAP_S and np.abs(np.diff(inside[:, 1:], axis=0)).max() <= MAX_STEP_RAD)


def fit_geometry(seen: Windows, radius_m: float, separation_m: float) -> Geometry:
    """Multipliers of both radii and of the separation.

    :raises CalibrationError: the motion does not determine them.
    """
    ways = float(np.abs(seen.way_m).sum())
    turns = [float(seen.turn_rad[seen.turn_rad * sign > 0].sum() * sign) for sign in (1, -1)]
    if ways < LEAST_WAY_M or min(turns) < LEAST_TURN_RAD:
        raise CalibrationError(
            f"{ways:.1f} m of way, {turns[0]:.1f} rad to the left and {turns[1]:.1f} rad to the right seen; "
            f"drive at least {LEAST_WAY_M:g} m and spin {LEAST_TURN_RAD:g} rad each way"
        )
    angles = np.column_stack((-seen.left_rad, seen.right_rad))
    (per_left, per_right), *_ = np.linalg.lstsq(angles, seen.turn_rad, rcond=None)
    if min(per_left, per_right) <= 0.0:
        raise CalibrationError("the body turns against its wheels: swapped wheels, or a wheel with the wrong sign")
    rolled = 0.5 * (seen.left_rad + per_right / per_left * seen.right_rad)
    left_m = float(rolled @ seen.way_m / (rolled @ rolled))
    right_m = left_m * float(per_right / per_left)
    return Geometry(
        left_m / radius_m,
        right_m / radius_m,
        left_m / float(per_left) / separation_m,
        float(np.sqrt(np.mean((rolled * left_m - seen.way_m) ** 2))),
        float(np.sqrt(np.mean((angles @ (per_left, per_right) - seen.turn_rad) ** 2))),
        len(seen.way_m),
    )


def fit_heading_offset(seen: Windows) -> float:
    """Heading of the robot minus that of its rigid body, rad, from the direction of straight travel.

    :raises CalibrationError: no straight travel.
    """
    straight = (np.abs(seen.way_m) > 0.03) & (np.abs(seen.turn_rad) < 0.1)
    if np.abs(seen.way_m[straight]).sum() < 0.5:
        raise CalibrationError("less than 0.5 m of straight travel; drive straight for a while")
    weights = np.abs(seen.way_m[straight])
    return float(np.angle(np.sum(weights * np.exp(1j * seen.course_rad[straight]))))
