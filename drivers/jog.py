"""Driving wheels by hand: keys to speeds with a dead-man, and which wheel is which. Pure."""

from typing import Any, Literal, NamedTuple

from drivers.base import STANDSTILL, WheelSpeeds

DEAD_MAN_NS = 400_000_000
"""A key counts this long; a held key repeats sooner on any keyboard, after half a second at first."""
FIRST_NS = 700_000_000
"""The first press counts longer, until the keyboard's own repeating sets in."""
KEYS: dict[str, tuple[float, float]] = {
    "w": (1.0, 1.0),
    "s": (-1.0, -1.0),
    "a": (-0.5, 0.5),
    "d": (0.5, -0.5),
    "q": (0.4, 1.0),
    "e": (1.0, 0.4),
}
"""Share of the chosen speed for the left and the right wheel."""
HELP = "w s forward back, a d turn, q e curve, + - faster slower, space stop, x end; let go and it stops"
MAX_MPS = 0.3
STEP_MPS = 0.05


class Jog:
    """What the keys mean at this moment."""

    def __init__(self, wheel_radius_m: float, limit_mps: float = MAX_MPS) -> None:
        self.speed_mps = min(0.1, limit_mps)
        self.ended = False
        self._radius_m = wheel_radius_m
        self._limit_mps = limit_mps
        self._shares = (0.0, 0.0)
        self._until_ns = 0
        self._key = ""

    def press(self, key: str, now_ns: int) -> None:
        """Any key that is not known stops."""
        if key in "+-" and key:
            change = STEP_MPS if key == "+" else -STEP_MPS
            self.speed_mps = min(self._limit_mps, max(STEP_MPS, self.speed_mps + change))
            return
        self.ended = self.ended or key in ("x", "\x03", "\x04")
        held = key == self._key and now_ns < self._until_ns
        self._shares = KEYS.get(key, (0.0, 0.0))
        self._key = key
        self._until_ns = now_ns + (DEAD_MAN_NS if held else FIRST_NS)

    def speeds(self, now_ns: int) -> WheelSpeeds:
        """Zero unless a key was pressed just now."""
        if self.ended or now_ns >= self._until_ns:
            self._shares, self._key = (0.0, 0.0), ""
            return STANDSTILL
        radps = self.speed_mps / self._radius_m
        return WheelSpeeds(self._shares[0] * radps, self._shares[1] * radps)


Seen = Literal["lf", "lb", "rf", "rb", "n"]
"""Left or right wheel, forward or backward, seen from behind; n: neither."""


class Conclusion(NamedTuple):
    """What the wheels table should say; ``fault`` if that is no matter of settings."""

    changes: dict[str, Any]
    fault: str = ""


def conclude(wheels: dict[str, Any], for_left: Seen, for_right: Seen) -> Conclusion:
    """From what was seen when the left, then the right wheel was told to turn forward.

    :param wheels: the ``wheels`` table as it is.
    """
    if "n" in (for_left, for_right):
        silent = "left" if for_left == "n" else "right"
        return Conclusion({}, f"nothing turned for the {silent} wheel: check its motor wires, power and id")
    if for_left[0] == for_right[0]:
        return Conclusion({}, "the same wheel turned twice: both ids or channels lead to one motor")
    changes: dict[str, Any] = {}
    inverted = {side: bool(wheels.get(f"{side}_inverted", False)) for side in ("left", "right")}
    swapped = for_left[0] == "r"
    if swapped and ("left" in wheels or "right" in wheels or wheels.get("kind") == "roboclaw"):
        changes["left"], changes["right"] = wheels.get("right", 2), wheels.get("left", 1)
        inverted = {"left": inverted["right"], "right": inverted["left"]}
    elif swapped:
        return Conclusion({}, "left and right are swapped and this family has no ids to exchange: swap the plugs")
    backward = {("l", "left"): "left", ("r", "left"): "right", ("l", "right"): "left", ("r", "right"): "right"}
    for told, seen in (("left", for_left), ("right", for_right)):
        if seen[1] == "b":
            side = backward[seen[0], told]
            inverted[side] = not inverted[side]
    for side, value in inverted.items():
        if value != bool(wheels.get(f"{side}_inverted", False)):
            changes[f"{side}_inverted"] = value
    return Conclusion(changes)
