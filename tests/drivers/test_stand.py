"""Real wheels on a stand under a virtual body: it goes where the measured wheels say, and nowhere else."""

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Platform, parse
from contract.keys import Keys
from contract.messages import FeedbackBatch, Message, WheelFeedback
from drivers.mock.body import Body
from drivers.mock.stand import STALE_NS, Stand
from groundstation.mock_arena import MockArena

PLATFORM = Platform()
STEP_NS = 10_000_000
SPEED = st.floats(-25.0, 25.0)


def sample(stamp_ns: int, left_rad: float, right_rad: float, left: float = 0.0, right: float = 0.0) -> WheelFeedback:
    return WheelFeedback(
        robot="r01", stamp_ns=stamp_ns, left_radps=left, right_radps=right, left_rad=left_rad, right_rad=right_rad
    )


@given(speeds=st.lists(st.tuples(SPEED, SPEED), min_size=1, max_size=40), lost=st.sets(st.integers(0, 39)))
def test_it_rolls_as_a_body_on_these_wheels_whatever_is_lost(speeds: list[tuple[float, float]], lost: set[int]) -> None:
    body, stand = Body(PLATFORM, (1.0, 2.0), 0.5), Stand(PLATFORM, (1.0, 2.0), 0.5)
    stand.measured(sample(0, 0.0, 0.0))
    left = right = 0.0
    for index, (left_radps, right_radps) in enumerate(speeds):
        left, right = left + left_radps * 0.01, right + right_radps * 0.01
        if index not in lost or index == len(speeds) - 1:
            body.roll(left, right)
            stand.measured(sample((index + 1) * STEP_NS, left, right, left_radps, right_radps))
    assert stand.pose(len(speeds) * STEP_NS) == pytest.approx((body.x_m, body.y_m, body.heading_rad), abs=1e-9)


@given(ahead_ns=st.integers(0, 2 * STALE_NS), speed=SPEED)
def test_between_samples_it_rolls_on_but_not_for_ever(ahead_ns: int, speed: float) -> None:
    stand = Stand(PLATFORM, (0.0, 0.0), 0.0)
    stand.measured(sample(STEP_NS, 0.3, 0.3, speed, speed))
    x_m, y_m, _ = stand.pose(STEP_NS + ahead_ns)
    assert x_m == pytest.approx(speed * PLATFORM.wheel_radius_m * min(ahead_ns, STALE_NS) * 1e-9)
    assert y_m == 0.0


def test_angles_that_begin_anew_and_old_samples_move_nothing() -> None:
    stand = Stand(PLATFORM, (0.0, 0.0), 0.0)
    for stamp, angle in ((1, 5.0), (2, 5.4), (3, 0.0), (4, 0.2), (2, 90.0)):
        stand.measured(sample(stamp * STEP_NS, angle, angle, 30.0 if angle == 5.4 else 0.0, 0.0))
    assert stand.pose(4 * STEP_NS)[0] == pytest.approx(0.6 * PLATFORM.wheel_radius_m)
    stand.measured(sample(5 * STEP_NS, 80.0, 80.0))
    assert stand.pose(5 * STEP_NS)[0] == pytest.approx(0.6 * PLATFORM.wheel_radius_m)


class Heard:
    """A link on which only this was heard."""

    keys = Keys("bench")

    def __init__(self) -> None:
        self.subscribed: list[str] = []
        self.messages: list[tuple[str, Message]] = []

    def subscribe(self, keys: Any) -> None:
        self.subscribed += keys

    def drain(self) -> list[tuple[str, Message]]:
        taken, self.messages = self.messages, []
        return taken


def test_the_arena_file_alone_says_who_stands_on_a_stand(tmp_path: Path) -> None:
    wheels = {"kind": "roboclaw", "counts_per_revolution": 2048}
    table = {
        "arena": {"name": "bench", "size_m": [4.0, 4.0]},
        "mocap": {"command_port": 41510, "data_port": 41511},
        "robots": {
            "r01": {"body": "a", "start": [1.0, 1.0], "emulate": ["body"], "wheels": {**wheels, "port": "/dev/null"}},
            "r02": {
                "body": "b",
                "start": [2.0, 1.0],
                "emulate": ["wheels", "body"],
                "wheels": {**wheels, "port": str(tmp_path / "r02")},
            },
        },
    }
    link = Heard()
    mock = MockArena(parse(table, "bench"), link, tmp_path / "faults.txt")  # type: ignore[arg-type]
    mock.open()
    try:
        assert link.subscribed == [link.keys.feedback("r01")]
        assert (tmp_path / "r02").exists()
        turned = (sample(1, 0.0, 0.0), sample(1 + STEP_NS, 0.2, 0.2, 20.0, 20.0))
        link.messages.append(("", FeedbackBatch(robot="r01", samples=turned)))
        link.messages.append(("", FeedbackBatch(robot="r02", samples=turned)))
        mock._listen()
        first, second = mock._poses()
        assert first[0] == "a"
        assert first[1] == pytest.approx(1.0 + 0.2 * 0.03 + 20.0 * 0.03 * 0.3)
        assert (second[1], second[2]) == (2.0, 1.0)
        assert not math.isnan(first[3])
    finally:
        mock.close()
