"""What a law of your own is: a velocity in place of algorithm 1's lines 2-12. Goals, messages and safety stay."""

from collections.abc import Callable
from typing import Any, Protocol

from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.view import Goal, View


class Law(Protocol):
    """One robot's law. It decides from the view alone, as ours do."""

    def velocity(self, view: View, goal: Goal | None) -> Vector:
        """Called once a control step.

        :param goal: where algorithm 2 sends the robot; None: nowhere.
        :return: m/s, arena frame. The supervisor bounds it by speed, fence and separation.
        """


LawMaker = Callable[[str, Parameters, dict[str, Any]], Law]
"""What an entry point names: robot, parameters and the table ``[control.law]`` in, its law out."""
