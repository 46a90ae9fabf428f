"""Every test that the page on safety names is there."""

import re

import pytest

from tests.house.checkout import ROOT
from tests.house.test_pitfalls_page import functions_of

PAGE = (ROOT / "docs/safety.md").read_text()
PROOF = re.compile(r"\[`(?P<test>test_\w+)`\]\(\.\./(?P<file>tests/[^)]+)\)")
PROOFS = sorted({(proof["file"], proof["test"]) for proof in PROOF.finditer(PAGE)})


@pytest.mark.parametrize(("file", "test"), PROOFS)
def test_the_test_is_there(file: str, test: str) -> None:
    assert test in functions_of(file)


def test_every_row_beside_the_supervisor_has_its_proof() -> None:
    section = PAGE.split("## What acts beside the supervisor")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    assert len(rows) > 10
    assert all(PROOF.search(row.split("|")[-2]) for row in rows)
