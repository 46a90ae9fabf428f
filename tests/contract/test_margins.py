"""The arithmetic between watchdog, brake, pose age, speed and margins: each relation broken, and the cure it names."""

import re
from typing import Any

import pytest

from contract.arena import ArenaError, parse
from contract.margins import cut_m, stopping_m


def table(changes: dict[str, dict[str, Any]]) -> dict[str, Any]:
    robots = {"r01": {"body": "r01", "start": [1.0, 1.0], "wheels": {"kind": "odrive"}}}
    return {"arena": {"name": "lab", "size_m": [4.0, 5.0]}, "robots": robots, **changes}


def faults(changes: dict[str, dict[str, Any]]) -> dict[str, str]:
    try:
        parse(table(changes), "test")
    except ArenaError as error:
        return {fault.path: fault.allowed for fault in error.faults}
    return {}


BROKEN = {
    "watchdog too long": ({"safety": {"watchdog_s": 0.5}}, "safety.watchdog_s"),
    "coasts too far": ({"platform": {"coast_deceleration_mps2": 0.3}}, "control.max_speed_mps"),
    "too fast to be cut": ({"control": {"max_speed_mps": 1.0}}, "control.max_speed_mps"),
    "brakes too weak": (
        {"control": {"field": {"brake_deceleration_mps2": [0.5, 2.0]}}, "platform": {"coast_deceleration_mps2": 5.0}},
        "control.max_speed_mps",
    ),
    "lag too long": (
        {"control": {"field": {"motor_lag_s": [0.1, 0.9]}}, "platform": {"coast_deceleration_mps2": 5.0}},
        "control.max_speed_mps",
    ),
    "sight too short": ({"control": {"sensing_radius_m": 0.7, "critical_margin_m": 0.1}}, "control.max_speed_mps"),
    "poses too old": (
        {
            "safety": {"max_pose_age_s": 0.9},
            "control": {"field": {"link_margin_m": 0.3}},
        },
        "safety.max_pose_age_s",
    ),
    "gate later than the device": ({"safety": {"command_age_s": 0.2}}, "safety.command_age_s"),
    "watchdog shorter than the loop": (
        {"safety": {"watchdog_s": 0.05, "command_age_s": 0.04}, "control": {"control_period_s": 0.03}},
        "safety.watchdog_s",
    ),
    "distance below the diameter": ({"safety": {"min_distance_m": 0.13}}, "safety.min_distance_m"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_relation_names_the_key_and_the_allowed_range(case: str) -> None:
    changes, path = BROKEN[case]
    found = faults(changes)
    assert list(found) == [path]
    assert re.match(r"(at most|at least|below|must be at least) ", found[path])


@pytest.mark.parametrize("case", [name for name, (_, path) in BROKEN.items() if path != "safety.min_distance_m"])
def test_the_value_it_names_is_allowed_and_a_little_more_is_not(case: str) -> None:
    changes, path = BROKEN[case]
    words = faults(changes)[path]
    bound = float(re.search(r"(?:at most|at least|below) ([0-9.]+)", words)[1])
    section, key = path.split(".")
    outwards = -1 if "at least" in words else 1
    for value, allowed in ((bound - outwards * 0.003, True), (bound + outwards * 0.004, False)):
        cured = {**changes, section: {**changes.get(section, {}), key: value}}
        assert (not faults(cured)) == allowed, (value, faults(cured))


def test_the_sum_is_in_the_message() -> None:
    words = faults({"safety": {"watchdog_s": 0.5}})["safety.watchdog_s"]
    assert "0.8 x (0.5 + 0.02) + 0.8^2 / (2 x 0.6) = 0.95 m" in words
    assert "0.85 m" in words


def test_distances_of_the_default_platform() -> None:
    assert faults({}) == {}
    assert cut_m(0.8, 0.2, 0.6) == pytest.approx(0.8 * 0.22 + 0.64 / 1.2)
    assert stopping_m(0.8, 1.6, 0.15) == pytest.approx(0.218, abs=1e-3)
    assert stopping_m(0.1, 1.6, 0.15) == pytest.approx(0.015)
    assert stopping_m(0.24, 1.6, 0.15) == pytest.approx(0.24 * 0.15)
