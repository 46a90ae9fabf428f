"""Every driver's control step within 1.5 times the bare library calls: CPU, and from command to wire."""

import json

import pytest

from bench.driver_cost import measure
from drivers.registry import FAMILIES, Family
from onboard.service import quiet

STEPS = 1000
WITHIN = 1.5


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.kind)
def test_a_step_costs_little_more_than_the_bare_calls(family: Family) -> None:
    """Ratios of adjacent blocks: what else this computer does meets both sides alike."""
    quiet()
    figures = measure(family, STEPS)
    print(json.dumps(figures))
    assert figures["cpu_ratio"] <= WITHIN
    assert figures["wire_ratio"] <= WITHIN
