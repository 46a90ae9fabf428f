"""Machine code of the law: which sources it is of, who takes it, and that a compiler makes it."""

import ast
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import groundstation
from groundstation import cli, compiled, compiler

HEADER = Path(sysconfig.get_paths()["include"]) / "Python.h"
COMPILER = shutil.which(str(sysconfig.get_config_var("CC") or "cc").split()[0])
needs_compiler = pytest.mark.skipif(
    COMPILER is None or not HEADER.is_file(), reason="no C compiler or no headers of Python"
)
PLAYED = """import os
import sys
from pathlib import Path

from onboard import law

assert not law.__file__.endswith(".py"), law.__file__
assert law.twice(1.5) == 3.0
Path(os.environ["PLAYED"]).write_text(" ".join(sys.argv[1:]))
"""


@pytest.fixture
def rooms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(compiled, "WORLD", ("lockstep", "plant"))
    monkeypatch.setattr(compiled, "BYTES", {"drivers": ("gate",)})
    for room in compiled.ROOMS:
        (tmp_path / room).mkdir()
        (tmp_path / room / "__init__.py").write_text('"""Nothing."""\n')
    for name in (*compiled.WORLD, "result"):
        (tmp_path / "groundstation" / f"{name}.py").write_text("NUMBER: int = 3\n")
    (tmp_path / "drivers" / "gate.py").write_text("NUMBER: int = 4\n")
    (tmp_path / "onboard" / "law.py").write_text("def twice(x: float) -> float:\n    return 2.0 * x\n")
    return tmp_path


@pytest.fixture
def fresh(rooms: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A process that has imported nothing of what is compiled yet; where its machine code would be."""
    monkeypatch.setattr(compiled, "sources", lambda: rooms)
    monkeypatch.setattr(compiled, "home", lambda: tmp_path / "kept")
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(groundstation, "__path__", list(groundstation.__path__))
    for name in (*compiled.WHOLE, *(f"groundstation.{name}" for name in compiled.WORLD)):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.delenv(compiled.OFF, raising=False)
    return tmp_path / "kept" / compiled.version_of(rooms)


@pytest.mark.parametrize("room", compiled.ROOMS)
def test_the_version_is_that_of_every_source(rooms: Path, room: str) -> None:
    before = compiled.version_of(rooms)
    (rooms / room / "new.py").write_text("")
    added = compiled.version_of(rooms)
    (rooms / room / "new.py").write_text("x = 1\n")
    assert len({before, added, compiled.version_of(rooms)}) == 3
    (rooms / room / "new.py").unlink()
    assert compiled.version_of(rooms) == before


def test_machine_code_is_taken_where_it_is_of_the_sources_as_they_are(fresh: Path, rooms: Path) -> None:
    assert not compiled.take()
    fresh.mkdir(parents=True)
    assert compiled.take()
    assert sys.path.pop(0) == str(fresh)
    assert groundstation.__path__.pop(0) == str(fresh / "groundstation")
    (rooms / "onboard" / "law.py").write_text("")
    assert not compiled.take()
    assert str(fresh) not in sys.path


def test_it_is_not_taken_where_it_must_not_be(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fresh.mkdir(parents=True)
    with monkeypatch.context() as patch:
        patch.setenv(compiled.OFF, "0")
        assert not compiled.take()
    for early in ("onboard", "drivers", "mocap_bridge", "groundstation.lockstep"):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, early, sys)
            assert not compiled.take(), "imported already"
    assert compiled.take()


def test_only_the_command_itself_takes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[str] = []
    monkeypatch.setattr(compiled, "take", lambda: taken.append("taken"))
    assert cli.main(["simulate", "--runs", "0"]) == 2
    assert taken == []
    monkeypatch.setattr(sys, "argv", ["ahdc-groundstation", "topics"])
    assert cli.main() == 0
    assert taken == []
    monkeypatch.setattr(sys, "argv", ["ahdc-groundstation", "simulate", "--runs", "0"])
    assert cli.main() == 2
    assert taken == ["taken"]


def test_what_is_left_out_is_there() -> None:
    folder = compiled.sources()
    assert all((folder / "onboard" / f"{name}.py").is_file() for name in compiled.SHELLS)
    chosen = compiled.modules(folder)
    assert all((folder / name).is_file() for name in chosen)
    assert {"onboard/agent.py", "onboard/ahdc/plan.py", "onboard/cut.py", "groundstation/lockstep.py"} <= set(chosen)
    assert {"groundstation/wire.py", "drivers/gate.py", "mocap_bridge/natnet/frame.py"} <= set(chosen)
    assert not {"onboard/runtime.py", "groundstation/cli.py", "onboard/ahdc/__init__.py"} & set(chosen)


def test_no_class_that_simulate_needs_inherits_from_a_compiled_one_and_is_none_itself() -> None:
    folder = compiled.sources()
    chosen = compiled.modules(folder)
    words = {name.removesuffix(".py").replace("/", ".") for name in chosen}
    others = [path for room in compiled.ROOMS for path in (folder / room).rglob("*.py")]
    found = []
    for path in others:
        name = str(path.relative_to(folder))
        tree = ast.parse(path.read_text())
        taken = {
            alias.asname or alias.name
            for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module in words
            for alias in node.names
        }  # fmt: skip
        bases = {base.split("[")[0] for node in classes(tree) for base in map(ast.unparse, node.bases)}
        if name not in chosen and bases & taken:
            found.append(name)
    assert not found


def classes(tree: ast.Module) -> list[ast.ClassDef]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def test_nothing_compiled_has_a_struct_whose_keywords_mypyc_would_not_see() -> None:
    folder = compiled.sources()
    for name in compiled.modules(folder):
        keywords = [node.name for node in classes(ast.parse((folder / name).read_text())) if node.keywords]
        assert not keywords, name


@pytest.mark.parametrize("missing", ["compiler", "package"])
def test_without_a_tool_it_says_which_and_what_to_do(
    rooms: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    if missing == "compiler":
        monkeypatch.setattr(shutil, "which", lambda name: None)
    else:
        monkeypatch.setattr(compiler.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(compiled.CompileError, match=r"remedy: (sudo apt-get|pip) install"):
        compiled.build(rooms, tmp_path / "kept")
    assert not (tmp_path / "kept").exists()


def test_machine_code_is_named_after_the_sources_it_is_of(
    rooms: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody edits them while the compiler is at work."""
    before = compiled.version_of(rooms)
    monkeypatch.setattr(compiled, "look_for_tools", lambda: None)
    monkeypatch.setattr(
        compiled, "compile_all", lambda work, chosen, quick: (rooms / "onboard" / "law.py").write_text("x = 1\n")
    )
    assert compiled.build(rooms, tmp_path / "kept").name == before


@needs_compiler
@pytest.mark.parametrize("quick", [True, False], ids=["once", "twice"])
def test_a_compiler_makes_it_whole_or_not_at_all(
    rooms: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: bool
) -> None:
    monkeypatch.setattr(compiler, "MISSIONS", [["a", "mission"]])
    (rooms / "groundstation" / "__main__.py").write_text(PLAYED)
    monkeypatch.setenv("PLAYED", str(tmp_path / "played"))
    kept = tmp_path / "kept"
    folder = compiled.build(rooms, kept, quick)
    assert (tmp_path / "played").is_file() == (not quick and compiler.learns())
    assert not any(path.suffix in (".c", ".gcda", ".o") for path in folder.rglob("*"))
    assert [path.name for path in kept.iterdir()] == [compiled.version_of(rooms)]
    look = "from onboard import law; print(law.__file__, law.twice(1.5))"
    command = [sys.executable, "-P", "-c", look]
    both = {"PYTHONPATH": f"{folder}{os.pathsep}{rooms}"}
    path, value = subprocess.check_output(command, env=both, text=True).split()
    assert path.endswith(str(sysconfig.get_config_var("EXT_SUFFIX")))
    assert value == "3.0"
    assert not (folder / "contract").exists()
    look = "import drivers.gate; print(drivers.gate.__file__, drivers.gate.NUMBER)"
    path, value = subprocess.check_output([*command[:-1], look], env=both, text=True).split()
    assert Path(path).parent == folder / "drivers"
    assert value == "4"
    look = "from groundstation import plant, result; print(plant.__file__, result.__file__)"
    swift, plain = subprocess.check_output([*command[:-1], look], env=both, text=True).split()
    assert Path(swift).parent == folder / "groundstation"
    assert plain == str(rooms / "groundstation" / "result.py")
    (rooms / "onboard" / "law.py").write_text("def twice(x: float) -> float:\n    return 'no'\n")
    with pytest.raises(compiled.CompileError, match=r"law\.py:2: error"):
        compiled.build(rooms, kept, quick)
    assert list(kept.iterdir()) == [folder]


@needs_compiler
@pytest.mark.parametrize(
    ("played", "words"), [("raise SystemExit('no floor')", r"missions fail .*no floor"), ("", "no counts")]
)
def test_missions_that_come_to_nothing_are_told(
    rooms: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, played: str, words: str
) -> None:
    monkeypatch.setattr(compiler, "learns", lambda: True)
    monkeypatch.setattr(compiler, "COUNT", ())
    (rooms / "groundstation" / "__main__.py").write_text(played)
    with pytest.raises(compiled.CompileError, match=words):
        compiled.build(rooms, tmp_path / "kept")
    assert list((tmp_path / "kept").iterdir()) == []
