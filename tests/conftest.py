"""What every test shares: hypothesis profiles, the tiers of proof, and the discipline about skips.

- ``CI=true`` turns a skip into a failure unless ``tests/skips.txt`` lists it with its reason.
- ``AHDC_FRESH=1`` gives hypothesis a fresh random seed (printed, and repeatable with ``--hypothesis-seed``);
  otherwise every run draws the same examples.
- Tests under ``tests/{arena,root,prove}`` carry the marker of that name; ``root`` and ``prove`` run only when
  ``-m`` names them.
"""

import fnmatch
import os
import random
from collections.abc import Generator
from pathlib import Path

import hypothesis
import hypothesis.internal.conjecture.providers as providers
import pytest

HERE = Path(__file__).parent
TIERS = ("arena", "root", "prove")
ON_DEMAND = ("root", "prove")

FRESH = os.environ.get("AHDC_FRESH") == "1"
hypothesis.settings.register_profile("ci", derandomize=True, max_examples=60, deadline=None, database=None)
hypothesis.settings.register_profile("fresh", max_examples=300, deadline=None, print_blob=True)
hypothesis.settings.load_profile("fresh" if FRESH else "ci")
if not FRESH:
    # Constants found in the modules imported so far would make examples depend on which tests a worker ran before.
    providers.HypothesisProvider._local_constants = providers.Constants()  # type: ignore[assignment]


def read_skips(path: Path) -> dict[str, str]:
    """Allowed skips: test id (with ``*`` wildcards) to reason, from lines ``ID  # reason``; ValueError without one."""
    allowed = {}
    for number, line in enumerate(path.read_text().splitlines(), 1):
        test, _, reason = line.partition("#")
        if not test.strip():
            continue
        if not reason.strip():
            raise ValueError(f"{path.name}:{number}: '{test.strip()}' has no reason; write 'ID  # why'")
        allowed[test.strip()] = reason.strip()
    return allowed


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    if FRESH and config.getoption("hypothesis_seed", None) is None:
        config.option.hypothesis_seed = random.SystemRandom().randrange(2**32)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if FRESH:
        seed = config.option.hypothesis_seed
        terminalreporter.write_line(f"fresh examples; the same again with --hypothesis-seed={seed}")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    asked = config.getoption("markexpr") or ""
    kept: list[pytest.Item] = []
    dropped: list[pytest.Item] = []
    for item in items:
        folder = item.path.relative_to(HERE).parts[0] if item.path.is_relative_to(HERE) else ""
        if folder in TIERS:
            item.add_marker(folder)
        hidden = any(item.get_closest_marker(tier) and tier not in asked for tier in ON_DEMAND)
        (dropped if hidden else kept).append(item)
    if dropped:
        config.hook.pytest_deselected(items=dropped)
        items[:] = kept


def judge(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn an unlisted skip into a failure, in CI only."""
    if os.environ.get("CI") != "true" or not report.skipped or hasattr(report, "wasxfail"):
        return
    allowed = read_skips(HERE / "skips.txt")
    if any(fnmatch.fnmatchcase(report.nodeid, pattern) for pattern in allowed):
        return
    why = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
    report.outcome = "failed"
    report.longrepr = f"{report.nodeid} was skipped ({why}); in CI every skip must be listed in tests/skips.txt"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    judge(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    judge(report)
    return report
