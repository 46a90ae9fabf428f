"""The arithmetic that ties watchdog, brake, pose age, speed and margins together; the arena loader's and the doctor's.

Distances, m, from speed v in m/s:

    S(v) = v L for v <= a L, else (v^2 - (a L)^2) / (2 a) + a L^2    braked (a lowest deceleration, L longest lag)
    C(v) = v (w + 0.02 s) + v^2 / (2 k)                              cut off (w ``safety.watchdog_s``, k coasting)

Required of every arena, u being ``control.max_speed_mps``, r_c ``control.sensing_radius_m``:

    C(u) + contact <= r_c            a robot at rest comes into sight before a cut robot can reach it
    2 S(u) + d_min <= r_c            two robots that come into sight of each other can still both stop
    0.8 u t + link margin < r_c - r_a    at the oldest usable pose, t, the field bound still leaves links some length
    command_age_s < w                the gate's zeros come before the device lets go
    w >= 2 control periods           and it does not let go for one step missed
    d_min >= diameter                robots that keep the distance do not touch
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from contract.tables import Fault, show

if TYPE_CHECKING:
    from contract.arena import Arena

SLACK_S = 0.02
"""From a command to the last packet that feeds the watchdog."""
POSE_ERROR_M = 0.005
RUN_AHEAD = 0.8
"""Share of u_max by which a partner's stop point may run ahead per second of age (onboard/ahdc/room.py)."""


def stopping_m(speed_mps: float, deceleration_mps2: float, lag_s: float) -> float:
    """S(v)."""
    knee = deceleration_mps2 * lag_s
    if speed_mps <= knee:
        return speed_mps * lag_s
    return (speed_mps * speed_mps - knee * knee) / (2.0 * deceleration_mps2) + knee * lag_s


def cut_m(speed_mps: float, watchdog_s: float, coast_mps2: float) -> float:
    """C(v)."""
    return speed_mps * (watchdog_s + SLACK_S) + speed_mps * speed_mps / (2.0 * coast_mps2)


def contact_m(arena: "Arena") -> float:
    """Centre distance at which two robots may touch, pose error included; never above ``safety.min_distance_m``."""
    return min(arena.safety.min_distance_m, arena.platform.diameter_m + POSE_ERROR_M)


def margin_faults(arena: "Arena") -> Iterator[Fault]:
    """Every relation of the module's docstring that an arena file breaks, with the sum that shows it."""
    yield from _cut_faults(arena)
    yield from _brake_faults(arena)
    yield from _age_faults(arena)
    yield from _time_faults(arena)
    safety, diameter_m = arena.safety, arena.platform.diameter_m
    if safety.min_distance_m < diameter_m:
        text = f"must be at least platform.diameter_m = {diameter_m:g}"
        yield Fault("safety.min_distance_m", show(safety.min_distance_m), text)


def _cut_faults(arena: "Arena") -> Iterator[Fault]:
    speed, radius_m = arena.control.max_speed_mps, arena.control.sensing_radius_m
    watchdog_s, coast_mps2 = arena.safety.watchdog_s, arena.platform.coast_deceleration_mps2
    room_m = radius_m - contact_m(arena)
    way_m = cut_m(speed, watchdog_s, coast_mps2)
    if way_m <= room_m:
        return
    total = (
        f"a robot cut off at control.max_speed_mps rolls {speed:g} x ({watchdog_s:g} + {SLACK_S:g}) + {speed:g}^2 / "
        f"(2 x {coast_mps2:g}) = {way_m:.2f} m; control.sensing_radius_m less contact leaves {room_m:.2f} m"
    )
    longest_s = (room_m - speed * speed / (2.0 * coast_mps2)) / speed - SLACK_S
    if longest_s >= max(0.02, 2.0 * arena.control.control_period_s):
        yield Fault("safety.watchdog_s", show(watchdog_s), f"at most {_down(longest_s)}: {total}")
        return
    standing_s = watchdog_s + SLACK_S
    fastest = coast_mps2 * ((standing_s * standing_s + 2.0 * max(0.0, room_m) / coast_mps2) ** 0.5 - standing_s)
    yield Fault("control.max_speed_mps", show(speed), f"at most {_down(fastest)}: {total}")


def _brake_faults(arena: "Arena") -> Iterator[Fault]:
    control, distance_m = arena.control, arena.safety.min_distance_m
    weak, slow = control.field.brake_deceleration_mps2[0], control.field.motor_lag_s[1]
    way_m = stopping_m(control.max_speed_mps, weak, slow)
    room_m = (control.sensing_radius_m - distance_m) / 2.0
    if way_m <= room_m:
        return
    text = (
        f"at most {_down(_fastest_mps(max(0.0, room_m), weak, slow))}: two robots stop in 2 x {way_m:.2f} m "
        f"(brake_deceleration_mps2 low {weak:g}, motor_lag_s high {slow:g}) and keep safety.min_distance_m = "
        f"{distance_m:g}, more than control.sensing_radius_m = {control.sensing_radius_m:g}"
    )
    yield Fault("control.max_speed_mps", show(control.max_speed_mps), text)


def _age_faults(arena: "Arena") -> Iterator[Fault]:
    control, age_s = arena.control, arena.safety.max_pose_age_s
    room_m = control.sensing_radius_m - control.avoidance_radius_m - control.field.link_margin_m
    ahead_m = RUN_AHEAD * control.max_speed_mps * age_s
    if control.profile == "field" and ahead_m >= room_m:
        text = (
            f"below {room_m / (RUN_AHEAD * control.max_speed_mps):.3g}: a stop point runs ahead {RUN_AHEAD:g} x "
            f"{control.max_speed_mps:g} x {age_s:g} = {ahead_m:.2f} m; sensing_radius_m - avoidance_radius_m - "
            f"link_margin_m leaves {room_m:.2f} m"
        )
        yield Fault("safety.max_pose_age_s", show(age_s), text)


def _time_faults(arena: "Arena") -> Iterator[Fault]:
    safety, period_s = arena.safety, arena.control.control_period_s
    if safety.watchdog_s < 2.0 * period_s:
        text = f"at least {2.0 * period_s:g}: two control periods of {period_s:g} s, or one step missed cuts the motors"
        yield Fault("safety.watchdog_s", show(safety.watchdog_s), text)
    elif safety.command_age_s >= safety.watchdog_s:
        text = f"below {safety.watchdog_s:g} (safety.watchdog_s): the gate's zeros must come before the device lets go"
        yield Fault("safety.command_age_s", show(safety.command_age_s), text)


def _fastest_mps(way_m: float, deceleration_mps2: float, lag_s: float) -> float:
    """The speed that stops in ``way_m``: inverse of S."""
    knee = deceleration_mps2 * lag_s
    if way_m <= knee * lag_s:
        return way_m / lag_s
    return float((2.0 * deceleration_mps2 * (way_m - knee * lag_s) + knee * knee) ** 0.5)


def _down(value: float) -> str:
    """Rounded towards zero, so that the value shown is allowed."""
    return f"{int(value * 1000) / 1000:g}"
