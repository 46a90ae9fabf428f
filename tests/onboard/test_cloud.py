"""Targets by cells: what is near is what a look at every target finds."""

from hypothesis import given
from hypothesis import strategies as st

from contract.messages import Target
from onboard.cloud import Cloud, cells_of

places = st.floats(-6.0, 6.0)
clouds = st.lists(st.builds(Target, index=st.integers(0, 30), x_m=places, y_m=places), max_size=40)


@given(clouds, places, places, st.floats(0.0, 4.0))
def test_near_is_what_a_look_at_all_finds_in_the_same_order(
    targets: list[Target], x_m: float, y_m: float, reach_m: float
) -> None:
    known = {target.index: (target.x_m, target.y_m) for target in targets}
    near = [(k, (x, y)) for k, (x, y) in known.items() if abs(x - x_m) <= reach_m and abs(y - y_m) <= reach_m]
    assert Cloud(targets).about(x_m, y_m, reach_m) == near


@given(clouds, clouds)
def test_the_cloud_kept_is_that_of_the_targets_told(first: list[Target], second: list[Target]) -> None:
    for targets in (tuple(first), tuple(second), tuple(first)):
        assert cells_of(targets).about(0.0, 0.0, 100.0) == Cloud(targets).about(0.0, 0.0, 100.0)
