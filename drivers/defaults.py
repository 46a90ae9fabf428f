"""Options with which each family is emulated unless told otherwise."""

from typing import Any

DEFAULTS: dict[str, dict[str, Any]] = {
    "odrive": {"interface": "slcan", "left": 0, "right": 1, "watchdog_s": 0.2},
    "roboclaw": {"counts_per_revolution": 2048},
    "dynamixel": {"left": 1, "right": 2},
    "vesc": {"interface": "slcan", "left": 1, "right": 2, "pole_pairs": 7, "watchdog_s": 1.0},
    "vesc_uart": {"left": 1, "right": 2, "pole_pairs": 7, "watchdog_s": 1.0},
    "cia402": {"interface": "slcan", "left": 1, "right": 2, "counts_per_revolution": 4096},
    "ros_arduino": {"counts_per_revolution": 2048, "watchdog_s": 2.0},
}
