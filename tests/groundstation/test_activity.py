"""One word for what a control step was about."""

import pytest

from contract.messages import RobotStep
from groundstation.activity import ACTIVITIES, activity


def step(waits: str, left: float, right: float) -> RobotStep:
    return RobotStep(
        robot="r01", frame=1, exposure_ns=0, step_ns=0, write_ns=0, left_radps=left, right_radps=right,
        links=(), task="tracking", waits=waits,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("waits", "left", "right", "word"),
    [
        ("", 5.0, 5.0, "travel"),
        ("", -5.0, -5.0, "travel"),
        ("", -5.0, 5.0, "turning"),
        ("", 1.0, -0.5, "turning"),
        ("", 3.0, 0.1, "travel"),
        ("", 0.0, 0.0, "travel"),
        ("indicator", 5.0, 5.0, "follow"),
        ("start", 5.0, 5.0, "follow"),
        ("indicator", -5.0, 5.0, "turning"),
        ("help", 5.0, 5.0, "help"),
        ("hold", -5.0, 5.0, "hold"),
        ("link", -5.0, 5.0, "link"),
        ("separation", 0.0, 0.0, "separation"),
        ("fence", 0.0, 0.0, "fence"),
        ("joining", 0.0, 0.0, "joining"),
    ],
)
def test_word(waits: str, left: float, right: float, word: str) -> None:
    assert activity(step(waits, left, right)) == word
    assert word in ACTIVITIES
