"""PAPER.md's index is true: every callable, broken, fails its law and the paper-profile mission."""

import importlib
import importlib.util
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import hypothesis
import pytest

import onboard.ahdc
from groundstation.sweep import Job, play
from tests.onboard import test_equations

NO_SHRINKING = hypothesis.settings(phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate), deadline=None)

PAPER = Path(onboard.ahdc.__path__[0]) / "PAPER.md"
ROW = re.compile(r"^\| (?P<equation>[^|]+?) \| `(?P<path>[\w.]+:[\w.]+)` \| `(?P<law>test_\w+)` \|$", re.MULTILINE)
ROWS = [(match["equation"], match["path"], match["law"]) for match in ROW.finditer(PAPER.read_text())]
MISSION = Job(robots=6, targets=12, seed=1, profile="paper", conditions="ideal", limit_s=4.0)


class Broken(Exception):
    """Raised by a callable whose body was replaced."""


def broken(*_: Any, **__: Any) -> Any:
    raise Broken


def function(path: str) -> FunctionType:
    module, _, name = path.partition(":")
    found: Any = importlib.import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    assert isinstance(found, FunctionType)
    return found


def second_copy(module: ModuleType) -> ModuleType:
    """The laws once more, with settings of our own: a broken body needs no shrinking."""
    spec = importlib.util.spec_from_file_location("laws_to_break", str(module.__file__))
    assert spec is not None
    assert spec.loader is not None
    copy = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copy)
    for name in dir(copy):
        if getattr(getattr(copy, name), "is_hypothesis_test", False):
            NO_SHRINKING(getattr(copy, name))
    return copy


LAWS = second_copy(test_equations)


@pytest.fixture
def break_body() -> Iterator[Callable[[str], None]]:
    saved: list[tuple[FunctionType, Any]] = []

    def apply(path: str) -> None:
        target = function(path)
        saved.append((target, target.__code__))
        target.__code__ = broken.__code__.replace(co_name=target.__name__)
        target.__globals__.setdefault("Broken", Broken)

    yield apply
    for target, code in saved:
        target.__code__ = code
        target.__globals__.pop("Broken", None)


def test_the_index_names_every_equation() -> None:
    text = " ".join(equation for equation, _, _ in ROWS)
    for number in (*range(1, 9), *range(11, 15)):
        assert re.search(rf"eq\. {number}\b", text), number
    assert "eq. 9-10" in text
    assert "alg. 1" in text
    assert "alg. 2" in text


def test_the_mission_runs_unbroken() -> None:
    assert play(MISSION).run_steps > 0


@pytest.mark.parametrize(("equation", "path", "law"), ROWS, ids=[path for _, path, _ in ROWS])
def test_a_broken_callable_fails_its_law_and_the_mission(
    equation: str, path: str, law: str, break_body: Callable[[str], None]
) -> None:
    break_body(path)
    with pytest.raises(Broken):
        getattr(LAWS, law)()
    with pytest.raises(Broken):
        play(MISSION)
