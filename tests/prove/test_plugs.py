"""200 pulled plugs, and a whole mission with every controller family in turn and with six at once, in lockstep."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from plugs import SIX, Puller, judge, six_families

PULLS = 200
EACH = 4


@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", range(1, PULLS // EACH + 1))
def test_a_pulled_plug_stops_one_robot_and_is_named(seed: int) -> None:
    world = six_families(seed)
    puller = Puller(world, seed)
    puller.run(0.8)
    for _ in range(EACH):
        judge(puller.pull())


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "kinds", [*((kind,) * 6 for kind in (*SIX, "vesc_uart")), SIX], ids=lambda k: "-".join(sorted(set(k)))
)
def test_a_mission_completes_with_every_family(kinds: tuple[str, ...]) -> None:
    result = six_families(3, kinds=kinds).run()
    assert result.completed, result.why
    assert (result.disconnected_steps, result.collisions) == (0, 0)
