"""A law of another distribution, found by the profile's name and kept from harming the robot's process."""

import math
from collections.abc import Callable
from typing import Any

from contract import profiles
from onboard.ahdc.law import Law
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.view import Goal, View


class GuardedLaw:
    """Calls the law; an exception or anything but two finite numbers becomes a stop and is counted by name."""

    def __init__(self, law: Law, count: Callable[[str], None]) -> None:
        self._law = law
        self._count = count

    def velocity(self, view: View, goal: Goal | None) -> Vector:
        try:
            x, y = self._law.velocity(view, goal)
            u = float(x), float(y)
        except Exception as error:
            self._count(f"law: {type(error).__name__}")
            return (0.0, 0.0)
        if not (math.isfinite(u[0]) and math.isfinite(u[1])):
            self._count("law: not finite")
            return (0.0, 0.0)
        return u


def installed_law(
    robot: str, parameters: Parameters, options: dict[str, Any], count: Callable[[str], None]
) -> GuardedLaw | None:
    """The law the profile names; None for a profile of ours.

    :raises ValueError: no installed distribution has it, or it cannot be made; names the entry point.
    """
    profile = parameters.profile
    if profile in profiles.OURS:
        return None
    entry = profiles.others().get(profile)
    if entry is None:
        raise ValueError(f"control.profile = {profile!r}: no installed distribution brings it ({profiles.LAWS})")
    try:
        return GuardedLaw(entry.load()(robot, parameters, options), count)
    except Exception as error:
        raise ValueError(f"control.profile = {profile!r}: {entry.value} of {profiles.LAWS}: {error!r}") from error
