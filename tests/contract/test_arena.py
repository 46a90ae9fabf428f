"""The arena file: all faults at once, each with path, value, allowed range and a hint."""

import copy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import ArenaError, digest, load, parse, robot_or_fault, table_of
from contract.tables import Fault
from drivers.registry import wheel_faults

GOOD: dict[str, Any] = {
    "arena": {"name": "lab6", "size_m": [4.0, 5.0]},
    "robots": {
        "r06": {"body": "r06", "start": [0.4, 0.4], "wheels": {"kind": "odrive"}},
        "r08": {"body": "r08", "start": [0.8, 0.4], "wheels": {"kind": "roboclaw"}},
    },
}
EXAMPLES = sorted((Path(__file__).parents[2] / "groundstation" / "arenas").glob("*.toml"))


def changed(**sections: Any) -> dict[str, Any]:
    table = copy.deepcopy(GOOD)
    for name, section in sections.items():
        table[name] = {**table.get(name, {}), **section}
    return table


def faults(table: dict[str, Any]) -> dict[str, Fault]:
    with pytest.raises(ArenaError) as caught:
        parse(table, "test.toml")
    return {fault.path: fault for fault in caught.value.faults}


def test_every_fault_is_reported_at_once() -> None:
    table = changed(
        control={"sensing_radus_m": 1.0, "max_speed_mps": 9.0, "profile": "feild"},
        mocap={"up_axis": "x", "frame_rate_hz": "fast"},
        targets={"points": [[1.0, 1.0], [9.0, 1.0]]},
    )
    table["robots"]["r08"]["start"] = [0.45, 0.4]
    table["robots"]["R9"] = {"body": "r09", "start": [1.0, 1.0], "wheels": {"kind": "odrive"}}
    del table["robots"]["r06"]["body"]
    found = faults(table)
    assert set(found) == {
        "control.sensing_radus_m",
        "control.max_speed_mps",
        "control.profile",
        "mocap.up_axis",
        "mocap.frame_rate_hz",
        "targets.points[1]",
        "robots.R9",
        "robots.r06.body",
    }
    assert found["control.sensing_radus_m"].hint == 'did you mean "sensing_radius_m"?'
    assert found["control.profile"].hint == 'did you mean "field"?'
    assert "above 0.0 and up to 5.0" in found["control.max_speed_mps"].allowed
    assert found["control.max_speed_mps"].value == "9.0"
    assert "missing" in found["robots.r06.body"].allowed


@pytest.mark.parametrize(
    ("sections", "path", "words"),
    [
        ({"control": {"critical_margin_m": 1.5}}, "control.critical_margin_m", "below sensing_radius_m"),
        ({"control": {"avoidance_radius_m": 0.9}}, "control.avoidance_radius_m", "below r_n"),
        ({"control": {"avoidance_radius_m": 0.1}}, "control.avoidance_radius_m", "platform.diameter_m"),
        ({"control": {"field": {"motor_lag_s": [0.2, 0.1]}}}, "control.field.motor_lag_s", "low <= high"),
        ({"control": {"paper": {}}}, "control.paper", 'not used by profile "field"'),
        ({"control": {"profile": "paper", "field": {}}}, "control.field", 'not used by profile "paper"'),
        ({"arena": {"fence_m": 2.0}}, "arena.fence_m", "leaves no floor"),
        ({"safety": {"battery_critical_v": 12.0}}, "safety.battery_critical_v", "battery_low_v"),
        ({"link": {"router": "udp/1.2.3.4:7"}}, "link.router", "matching"),
        (
            {"robots": {"r08": {"body": "r06", "start": [1.0, 1.0], "wheels": {"kind": "odrive"}}}},
            "robots.r08.body",
            "r06",
        ),
        (
            {"robots": {"r08": {"body": "r08", "start": [0.45, 0.4], "wheels": {"kind": "odrive"}}}},
            "robots.r08.start",
            "0.05 m",
        ),
        (
            {"robots": {"r08": {"body": "r08", "start": [3.99, 0.4], "wheels": {"kind": "odrive"}}}},
            "robots.r08.start",
            "fence",
        ),
        ({"robots": {"r08": {"body": "r08", "start": [1.0, 1.0], "wheels": {}}}}, "robots.r08.wheels.kind", "family"),
    ],
)
def test_relations_between_keys_name_the_key_to_change(sections: dict[str, Any], path: str, words: str) -> None:
    assert words in faults(changed(**sections))[path].allowed


def test_no_robot_no_arena() -> None:
    assert "robots" in faults({**GOOD, "robots": {}})


def test_wheel_options_are_checked_by_the_family_that_owns_them() -> None:
    table = copy.deepcopy(GOOD)
    table["robots"]["r06"]["wheels"] = {"kind": "odriv"}
    with pytest.raises(ArenaError, match='did you mean "odrive"'):
        parse(table, "test.toml", wheel_faults)


@pytest.mark.parametrize("content", [b"[arena", b"\xff\xfe", b"name = 1\nname = 2"])
def test_a_file_that_is_not_toml_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(ArenaError, match=r"broken\.toml"):
        load(path)
    with pytest.raises(ArenaError, match="No such file"):
        load(tmp_path / "absent.toml")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_good_and_survive_being_written_out(path: Path) -> None:
    arena = load(path, wheel_faults)
    again = parse(table_of(arena), "again", wheel_faults)
    assert again == arena
    assert digest(again) == digest(arena)


def test_the_digest_tells_any_difference() -> None:
    digests = {
        digest(parse(table, "t"))
        for table in (GOOD, changed(control={"max_speed_mps": 0.7}), changed(targets={"seed": 2}))
    }
    assert len(digests) == 3


def test_the_digest_is_silent_about_how_software_gets_to_robots() -> None:
    moved = copy.deepcopy(GOOD) | {"deploy": {"user": "pi", "cpus": [3]}}
    moved["robots"]["r06"]["host"] = "192.168.7.16"
    arena = parse(moved, "t")
    assert (arena.robots["r06"].host, arena.deploy.cpus) == ("192.168.7.16", (3,))
    assert digest(arena) == digest(parse(GOOD, "t"))


def test_an_unknown_robot_is_answered_with_the_known_ones() -> None:
    arena = parse(GOOD, "t")
    assert robot_or_fault(arena, "r06").body == "r06"
    with pytest.raises(ArenaError, match='did you mean "r06"'):
        robot_or_fault(arena, "r6")


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner, max_size=4),
    max_leaves=12,
)


@given(st.dictionaries(st.sampled_from([*GOOD, "control", "mocap", "safety", "x"]), json_values, max_size=5))
def test_no_table_crashes_the_loader(table: dict[str, Any]) -> None:
    with pytest.raises(ArenaError) as caught:
        parse(table, "fuzz.toml", wheel_faults)
    assert caught.value.faults


@given(st.sampled_from(["control", "mocap", "safety", "platform", "arena", "targets"]), st.data())
def test_one_bad_value_is_the_only_fault_of_its_key(section: str, data: st.DataObject) -> None:
    arena = parse(GOOD, "t")
    table = table_of(arena)
    key = data.draw(st.sampled_from(sorted(k for k, v in table[section].items() if not isinstance(v, dict))))
    table[section][key] = {"not": "this"}
    found = faults(table)
    assert [path for path in found if path.startswith(f"{section}.{key}")] == list(found)
