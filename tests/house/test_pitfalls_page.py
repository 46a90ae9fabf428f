"""The page of pitfalls and the tests tell the same."""

import ast
import re

import pytest

from drivers.registry import FAMILIES
from tests.house.checkout import ROOT, tracked

ROW = re.compile(r"^\| (?P<pitfall>.+) \| (?P<family>[^|]+) \| \[`(?P<test>\w+)`\]\(\.\./(?P<file>[^)]+)\) \|$")
PAGE = (ROOT / "docs/pitfalls.md").read_text()
WIRES = ("every family", "every CAN family")


def rows(page: str) -> list[re.Match[str]]:
    """Of every table; ValueError for a line of a table that is none."""
    lines = [
        line for line in page.splitlines() if line.startswith("|") and "---" not in line and "| Pitfall |" not in line
    ]
    found = [ROW.match(line) for line in lines]
    if None in found:
        raise ValueError(f"no row: {lines[found.index(None)]}")
    return [row for row in found if row is not None]


def functions_of(file: str) -> set[str]:
    """Names of the test functions in a file of the checkout."""
    tree = ast.parse((ROOT / file).read_text())
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


ROWS = rows(PAGE)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["test"])
def test_the_test_of_every_row_is_there(row: re.Match[str]) -> None:
    assert row["test"] in functions_of(row["file"])


def test_every_pitfall_test_has_its_row() -> None:
    named = {(row["file"], row["test"]) for row in ROWS}
    files = [str(path.relative_to(ROOT)) for path in tracked("tests/*.py")]
    pitfalls = {(file, test) for file in files for test in functions_of(file) if test.startswith("test_pitfall_")}
    assert pitfalls <= named


def test_every_family_has_pitfalls_under_a_heading_of_its_own() -> None:
    families = {row["family"].strip("`") for row in ROWS}
    assert families == {family.kind for family in FAMILIES} | set(WIRES)
    for section in PAGE.split("\n## ")[1:]:
        assert len({row["family"] for row in rows(section)}) == 1, section.splitlines()[0]


@pytest.mark.parametrize("line", ["| a | `vesc` | test_x |", "| a | [`test_x`](../tests/x.py) |"])
def test_what_is_no_row_is_told(line: str) -> None:
    with pytest.raises(ValueError, match="no row"):
        rows(line)
