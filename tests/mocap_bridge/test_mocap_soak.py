"""A slice of a soak in virtual time: every fault once, nothing wrong ever believed, each under its right name."""

import itertools

import pytest

from mocap_bridge.mock.script import KINDS as SCRIPTED
from mocap_bridge.mock.script import Script
from tests.mocap_bridge.lockstep import STARTS, Story, circling
from tests.mocap_bridge.soak import KINDS, Judge, faults, over_s


def soak(seed: int, count: int) -> Judge:
    """So many faults in virtual time."""
    story, judge = Story(seed=seed), Judge(circling())
    story.until(1.5)
    for fault in itertools.islice(faults(seed, STARTS), count):
        story.server.follow(Script((fault,)))
        judge.begin(fault)
        while story.elapsed_s < over_s(fault):
            story.until(story.elapsed_s + 0.05)
            for frame in story.frames:
                judge.frame(frame, story.script_s(frame))
            for health in story.health:
                judge.health(health)
            for kept in (story.frames, story.health, story.source_frames, story.tape):
                kept.clear()  # type: ignore[attr-defined]
        judge.end()
    return judge


def test_every_fault_that_can_be_scripted_is_drawn() -> None:
    assert set(KINDS) | {"deaf"} == set(SCRIPTED)


@pytest.mark.parametrize("seed", [1])
def test_random_faults_are_survived_named_and_nothing_wrong_is_believed(seed: int) -> None:
    judge = soak(seed, len(KINDS))
    assert judge.verdicts == []
    assert judge.frames > 115 * 2 * len(KINDS)
    assert set(judge.named) == {kind.name for kind in KINDS.values()} - {""}
