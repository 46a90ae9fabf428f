"""Whether a robot that was cut off has left the others apart: a judge's view of true places and of links reported."""

import pytest

from contract.arena import parse
from contract.messages import RobotReport
from groundstation.faultrig import Place, Stage

WHEELS = {"kind": "roboclaw", "counts_per_revolution": 2048}


class Seen(Stage):
    """A stage of three robots side by side; r08 is the victim."""

    def __init__(self, x_m: dict[str, float], links: dict[str, tuple[str, ...]] | None = None) -> None:
        robots = {
            name: {"body": name, "start": [1.0 + k, 1.0], "wheels": {**WHEELS, "port": f"/dev/{name}"}}
            for k, name in enumerate(("r06", "r08", "r09"))
        }
        self.arena = parse({"arena": {"name": "apart", "size_m": [8.0, 8.0]}, "robots": robots}, "apart.toml")
        self.places = {name: [Place(1, at_m, 0.0, 0.0)] for name, at_m in x_m.items()}
        self.reports = {
            name: RobotReport(robot=name, boot=1, stamp_ns=1, run="running", links_on=on)
            for name, on in (links or {}).items()
        }


def test_others_that_a_robot_held_together_have_not_come_apart_where_it_rolled_on_after_it_was_cut_off() -> None:
    stage = Seen({"r06": 0.0, "r08": 1.04, "r09": 1.3})
    assert stage.is_split("r08", {})
    assert not stage.is_split("r08", {"r08": (0.55, 0.0)})
    assert not stage.is_split("r06", {})


@pytest.mark.parametrize(
    ("links", "x_m", "whole"),
    [
        ({"r06": ("r09", "r08"), "r09": ("r06",)}, 0.9, True),
        ({"r06": ("r09",), "r09": ("r06",)}, 1.1, False),
        ({"r06": ("r08",), "r09": ("r08",)}, 0.9, False),
        ({"r06": ("r09",), "r09": ()}, 0.9, False),
        ({"r06": ("r09",)}, 0.9, False),
    ],
    ids=["linked", "too far", "by the victim alone", "one end", "not heard"],
)
def test_the_others_are_whole_by_links_among_themselves(
    links: dict[str, tuple[str, ...]], x_m: float, whole: bool
) -> None:
    assert Seen({"r06": 0.0, "r08": 0.5, "r09": x_m}, links).is_whole("r08") is whole
