"""STOP reaches every emulated motor in time: by request, by the station's silence, and past a robot that is frozen.

Figures of a busy machine are not the kit's: run it alone. ``AHDC_STOPS`` sets how many of each kind.
"""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from groundstation import rig
from groundstation.faultpage import percentiles
from groundstation.faultrig import Stage
from groundstation.link import Link
from groundstation.stoptimes import stops

STOPS = int(os.environ.get("AHDC_STOPS", "20"))
ROBOTS = 6
REQUEST_MS = 50.0
SILENCE_MS = 700.0


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    out: Path = tmp_path_factory.mktemp("stop") / "run"
    arena = rig.mock_arena(rig.find_arena("experiment2"), out, rig.Changes(ROBOTS, 60, 1))
    with rig.Rig(arena, out) as processes:
        processes.start()
        with Link(arena, "station") as link:
            yield Stage(processes, link)


def motors_ms(stage: Stage, how: Callable[[Stage], int], but: tuple[str, ...] = ()) -> tuple[float, float, float]:
    """p50, p99, max"""
    found = percentiles([zero for zeros, _ in stops(stage, how, STOPS, but) for zero in zeros])
    assert found is not None
    print("\nmotors at zero, p50/p99/max: {:.1f} / {:.1f} / {:.1f} ms".format(*found), flush=True)
    return found


@pytest.mark.timeout(0)
def test_a_stop_request(stage: Stage) -> None:
    assert motors_ms(stage, Stage.stop)[1] <= REQUEST_MS


@pytest.mark.timeout(0)
def test_the_silence_of_a_killed_station(stage: Stage) -> None:
    assert motors_ms(stage, Stage.fall_silent)[2] <= SILENCE_MS


@pytest.mark.timeout(0)
def test_a_frozen_robot_delays_no_other(stage: Stage) -> None:
    frozen = next(iter(stage.arena.robots))

    def stop(stage: Stage) -> int:
        stage.signal(frozen, signal.SIGSTOP)
        return stage.stop()

    assert motors_ms(stage, stop, but=(frozen,))[1] <= REQUEST_MS
