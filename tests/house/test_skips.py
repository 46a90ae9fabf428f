"""The discipline of the shared configuration itself: skips, tiers, seeds."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis.internal.conjecture.providers import HypothesisProvider

from tests.conftest import FRESH, read_skips
from tests.house.checkout import ROOT

SUITE = """
import hypothesis, pytest
from hypothesis import strategies as st

def test_good(): pass

@pytest.mark.skip(reason="no such device")
def test_skipped(): pass

@pytest.mark.xfail(reason="known")
def test_expected_failure(): assert False
"""


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A small project under the shared configuration."""
    (tmp_path / "tests" / "root").mkdir(parents=True)
    shutil.copy(ROOT / "tests" / "conftest.py", tmp_path / "tests")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "tests" / "skips.txt").write_text("# none\n")
    (tmp_path / "tests" / "test_a.py").write_text(SUITE)
    (tmp_path / "tests" / "root" / "test_r.py").write_text("def test_rooted(): pass\n")
    return tmp_path


def pytest_in(suite: Path, *arguments: str, **variables: str) -> tuple[int, str]:
    env = {k: v for k, v in os.environ.items() if k not in ("CI", "AHDC_FRESH") and not k.startswith("PYTEST_")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments],
        cwd=suite,
        env={**env, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def test_outside_ci_a_skip_is_a_skip_and_a_fresh_run_prints_its_seed(suite: Path) -> None:
    code, output = pytest_in(suite, AHDC_FRESH="1")
    assert code == 0, output
    assert "1 passed, 1 skipped, 1 deselected, 1 xfailed" in output
    assert re.search(r"--hypothesis-seed=\d+", output)


def test_in_ci_unlisted_skips_of_tests_and_modules_fail(suite: Path) -> None:
    (suite / "tests" / "test_m.py").write_text("import pytest\npytest.importorskip('no_such_module_here')\n")
    code, output = pytest_in(suite, "--continue-on-collection-errors", CI="true")
    assert code == 1
    assert "no such device" in output
    assert "no_such_module_here" in output
    assert "tests/skips.txt" in output
    assert "1 passed, 1 deselected, 1 xfailed, 2 errors" in output


def test_in_ci_a_listed_skip_passes_also_side_by_side(suite: Path) -> None:
    (suite / "tests" / "skips.txt").write_text("tests/test_a.py::test_skip*  # no such device here\n")
    code, output = pytest_in(suite, "-n", "1", CI="true")
    assert code == 0, output
    assert "1 skipped" in output


def test_root_tier_runs_only_when_named_and_a_given_seed_is_kept(suite: Path) -> None:
    code, output = pytest_in(suite, "-m", "root", "--hypothesis-seed=7", AHDC_FRESH="1")
    assert code == 0
    assert "1 passed" in output
    assert "--hypothesis-seed=7" in output


def test_a_listed_skip_needs_a_reason(tmp_path: Path) -> None:
    listed = tmp_path / "skips.txt"
    listed.write_text("# all\n\ntests/test_a.py::test_b  # no CAN here\n")
    assert read_skips(listed) == {"tests/test_a.py::test_b": "no CAN here"}
    listed.write_text("tests/test_a.py::test_b\n")
    with pytest.raises(ValueError, match=r"skips.txt:1: 'tests/test_a.py::test_b' has no reason"):
        read_skips(listed)


def test_every_listed_skip_names_a_test_file() -> None:
    files = [test.partition("::")[0] for test in read_skips(ROOT / "tests" / "skips.txt")]
    assert [file for file in files if not (ROOT / file).is_file()] == []


@pytest.mark.skipif(FRESH, reason="fresh examples are meant to differ")
def test_property_examples_do_not_depend_on_what_a_worker_has_imported() -> None:
    """The profile empties a pool that this release of hypothesis really draws from."""
    assert "_local_constants" in HypothesisProvider._maybe_draw_constant.__code__.co_names
    pool = HypothesisProvider._local_constants
    assert not any(pool.set_for_type(kind) for kind in ("integer", "float", "string", "bytes"))  # type: ignore[attr-defined]
