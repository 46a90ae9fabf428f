"""Every mutant of the last gate, the supervisor, its failsafes and target memory is found out, or proven equivalent.

Each statement left out, each condition always and never true: more than line and branch coverage of these modules.
The mutants live in forked processes (``mutants.py``); those that no test can find are in ``equivalent.txt``, each with
its proof, and one that is found out after all is an error there.
"""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.prove.mutants import ROOT, equivalents, mutants

HERE = Path(__file__).parent
EQUIVALENT = HERE / "equivalent.txt"
MODULES = {
    "drivers.gate": "tests/drivers/test_gate.py",
    "onboard.safety": "tests/onboard/test_safety.py",
    "onboard.failsafes": "tests/onboard/test_safety.py",
    "onboard.ahdc.memory": "tests/onboard/test_tasks.py",
}


@pytest.mark.timeout(0)
@pytest.mark.parametrize("module", MODULES)
def test_no_mutant_survives(module: str) -> None:
    command = ["-m", "tests.prove.mutants", module, MODULES[module], "--equivalent", str(EQUIVALENT)]
    assert subprocess.run([sys.executable, *command], cwd=ROOT, check=False).returncode == 0


def test_every_kind_of_mutant_is_made() -> None:
    source = '"""Prose."""\nimport math\nKind = Literal["a"]\ndef f(x: int) -> bool:\n    """Prose."""\n    y = -x\n'
    source += '    if x < 1 and not y:\n        return "word" != "two words"\n    return x * 2 is None\n'
    made = {mutant.what for mutant in mutants(source)}
    assert made >= {
        "y = -x -> nothing", "-x -> x", "x < 1 and (not y) -> True", "x < 1 and (not y) -> False",
        "x < 1 and (not y) -> without x < 1", "x < 1 or not y", "x <= 1", "x != 1", "not y -> y", "1 -> 2",
        "'word' -> 'xword'", "'word' == 'two words'", "x / 2", "x * 2 is not None",
    }  # fmt: skip
    assert not any(what.startswith(("'Prose", "'two words'", "'a'", "Kind")) for what in made)


def test_every_mutant_compiles_and_differs() -> None:
    for module in MODULES:
        source = (ROOT / Path(*module.split(".")).with_suffix(".py")).read_text()
        whole = ast.unparse(ast.parse(source))
        for mutant in mutants(source):
            compile(mutant.tree, module, "exec")
            assert ast.unparse(mutant.tree) != whole


def test_every_equivalent_has_its_proof() -> None:
    lines = [line for line in EQUIVALENT.read_text().splitlines() if line.strip()]
    found = [equivalents(EQUIVALENT, module) for module in MODULES]
    assert sum(map(Counter.total, found)) == len(lines), "a line of no module"
