"""The arena file's values reach the law under their code names."""

from contract.arena import parse, table_of
from onboard.ahdc.parameters import Parameters, from_arena
from tests.onboard.samples import arena

CONTROL = {
    "sensing_radius_m": 1.5,
    "critical_margin_m": 0.25,
    "avoidance_radius_m": 0.21,
    "separation_weight": 1.1,
    "alignment_weight": 1.2,
    "max_speed_mps": 0.7,
    "occupying_time_s": 1.3,
    "reach_m": 0.06,
}


def altered(profile: str, own: dict[str, object]) -> Parameters:
    """The parameters of an arena file of two robots in which no value is the default."""
    table = table_of(arena(profile, 2))
    table["control"] = CONTROL | {"profile": profile, profile: own}
    table["platform"] = {"diameter_m": 0.13, "wheel_separation_m": 0.12}
    table["safety"] = {"neighbour_silence_s": 0.4}
    return from_arena(parse(table, "altered"))


def test_each_value_of_the_file_is_the_parameter_of_its_name() -> None:
    own = {"brake_deceleration_mps2": [1.7, 2.3], "motor_lag_s": [0.07, 0.14], "link_margin_m": 0.03}
    p = altered("field", own | {"target_knowledge": "own"})
    assert {name: getattr(p, name) for name in CONTROL if name != "critical_margin_m"} == {
        name: value for name, value in CONTROL.items() if name != "critical_margin_m"
    }
    assert (p.profile, p.robots) == ("field", 2)
    assert (p.diameter_m, p.wheel_separation_m, p.neighbour_silence_s) == (0.13, 0.12, 0.4)
    assert (p.brake_deceleration_mps2, p.motor_lag_s, p.link_margin_m) == ((1.7, 2.3), (0.07, 0.14), 0.03)
    assert not p.share_sightings
    assert altered("field", {"target_knowledge": "shared"}).share_sightings


def test_each_value_of_the_paper_is_the_parameter_of_its_symbol() -> None:
    p = altered("paper", {"cohesion_weight": 0.8, "run_step_s": 0.02})
    assert (p.profile, p.cohesion_weight, p.run_step_s) == ("paper", 0.8, 0.02)


def test_epsilon_and_the_radius_to_plan_with_follow_from_r_c() -> None:
    p = altered("field", {"link_margin_m": 0.03})
    assert p.noncritical_radius_m == 1.25
    assert p.critical_margin_m == 0.25
    assert p.link_radius_m == 1.5 - 0.03
