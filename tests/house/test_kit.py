"""``kit`` itself: what it builds when, what it refuses with which words, and that half an environment never counts."""

import ast
import contextlib
import importlib.machinery
import importlib.util
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.house.checkout import ROOT

SOURCE = (ROOT / "kit").read_text()


def never(*_: object) -> Any:
    raise AssertionError("must not be called")


@pytest.fixture
def kit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script as a module, at home in an empty checkout whose pip only writes down what it was asked."""
    loader = importlib.machinery.SourceFileLoader("kit_under_test", str(ROOT / "kit"))
    spec = importlib.util.spec_from_loader("kit_under_test", loader)
    assert spec
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    (tmp_path / "requirements.lock").write_text("a==1\nb==2\n")
    (tmp_path / "pyproject.toml").write_text("[project]\n")
    monkeypatch.setattr(module.os, "execv", never)
    monkeypatch.setenv("AHDC_KIT_PYTHON", "own")
    monkeypatch.setattr(module.sys, "prefix", sys.base_prefix)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(module, "LOCK", tmp_path / "requirements.lock")
    return module


@pytest.fixture
def pips(kit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What pip was asked to install, 'lock' or 'project', in order; no package is fetched."""
    asked: list[str] = []

    def empty_environment(_: int) -> list[str]:
        kit.VENV.joinpath("bin").mkdir(parents=True, exist_ok=True)
        kit.VENV.joinpath("bin", "python").write_text("")
        return ["pip"]

    monkeypatch.setattr(kit, "has", lambda *_: True)
    monkeypatch.setattr(kit, "pip_command", empty_environment)
    monkeypatch.setattr(kit, "pip", lambda _c, args, _n, _h: asked.append("lock" if "-r" in args else "project"))
    return asked


def test_first_call_installs_the_lock_and_the_project_and_later_calls_nothing(kit: ModuleType, pips: list[str]) -> None:
    kit.ensure(False)
    assert pips == ["lock", "project"]
    kit.ensure(False)
    assert pips == ["lock", "project"]


def test_changed_project_file_installs_only_the_project(kit: ModuleType, pips: list[str]) -> None:
    kit.ensure(False)
    (kit.ROOT / "pyproject.toml").write_text("[project]\nversion = '2'\n")
    kit.ensure(False)
    assert pips[2:] == ["project"]


def test_changed_lock_builds_afresh(kit: ModuleType, pips: list[str]) -> None:
    kit.ensure(False)
    kit.LOCK.write_text("a==1\nb==3\n")
    kit.ensure(False)
    assert pips[2:] == ["lock", "project"]


def test_lost_interpreter_builds_afresh(kit: ModuleType, pips: list[str]) -> None:
    kit.ensure(False)
    (kit.VENV / "bin" / "python").unlink()
    kit.ensure(False)
    assert pips[2:] == ["lock", "project"]


def test_moved_checkout_and_other_python_have_other_stamps(kit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    here = kit.stamps()
    monkeypatch.setattr(kit.sys, "version_info", (3, 12, 9, "final", 0))
    assert kit.stamps()[0] != here[0]
    monkeypatch.undo()


@pytest.mark.parametrize("broken_at", ["lock", "project"])
@pytest.mark.parametrize("how", [KeyboardInterrupt, SystemExit, OSError])
def test_interrupted_build_never_looks_finished(
    kit: ModuleType, pips: list[str], monkeypatch: pytest.MonkeyPatch, broken_at: str, how: type[BaseException]
) -> None:
    whole = kit.pip

    def breaks(command: list[str], arguments: list[str], total: int, held: int) -> None:
        whole(command, arguments, total, held)
        if pips[-1] == broken_at:
            raise how

    kit.ensure(False)
    kit.LOCK.write_text("a==2\n")
    monkeypatch.setattr(kit, "pip", breaks)
    with pytest.raises(how):
        kit.ensure(False)
    assert kit.built() == []
    monkeypatch.setattr(kit, "pip", whole)
    kit.ensure(False)
    assert pips[-2:] == ["lock", "project"]
    assert kit.built() == kit.stamps()


TWO_KITS = """
import importlib.machinery, importlib.util, pathlib, sys
script, root, gate, log = sys.argv[1:]
loader = importlib.machinery.SourceFileLoader("kit_under_test", script)
kit = importlib.util.module_from_spec(importlib.util.spec_from_loader("kit_under_test", loader))
loader.exec_module(kit)
kit.ROOT = pathlib.Path(root); kit.VENV = kit.ROOT / ".venv"; kit.LOCK = kit.ROOT / "requirements.lock"
def command(_held):
    (kit.VENV / "bin").mkdir(parents=True)
    (kit.VENV / "bin" / "python").write_text("")
    return ["pip"]
def pip(_command, arguments, _total, _held):
    with open(log, "a") as file:
        file.write("pip\\n")
    if "-r" in arguments:
        open(gate).read()
kit.choose_python = kit.give_way = lambda: None
kit.pip_command, kit.pip = command, pip
kit.ensure(False)
"""


@pytest.fixture
def start_kit(kit: ModuleType, tmp_path: Path) -> Iterator[Any]:
    """Starts a kit whose pip waits until the gate, a FIFO, is written."""
    os.mkfifo(tmp_path / "gate")
    arguments = [str(ROOT / "kit"), str(kit.ROOT), str(tmp_path / "gate"), str(tmp_path / "log")]
    with contextlib.ExitStack() as started:

        def start() -> subprocess.Popen[str]:
            child = subprocess.Popen(
                [sys.executable, "-c", TWO_KITS, *arguments], stderr=subprocess.PIPE, text=True, env={**os.environ}
            )
            started.callback(child.kill)
            return started.enter_context(child)

        yield start


def test_two_kits_at_once_build_once(kit: ModuleType, tmp_path: Path, start_kit: Any) -> None:
    first = start_kit()
    assert "building" in first.stderr.readline()
    second = start_kit()
    assert "another kit is building" in second.stderr.readline()
    (tmp_path / "gate").write_text("go")
    assert first.wait(60) == 0
    assert second.wait(60) == 0
    assert (tmp_path / "log").read_text().count("pip") == 2
    assert kit.built() == kit.stamps()


def test_too_old_python_names_the_one_line_to_run(kit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kit.sys, "version_info", (3, 9, 2))
    monkeypatch.setattr(kit, "better_python", lambda: None)
    with pytest.raises(kit.Refusal, match=r"this is 3\.9 .*\n +sudo apt-get install -y python3\.11 python3\.11-venv"):
        kit.choose_python()


def test_too_old_python_gives_way_to_a_newer_one(kit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    turned: list[list[str]] = []
    monkeypatch.setattr(kit.sys, "version_info", (3, 9, 2))
    monkeypatch.setattr(kit.shutil, "which", lambda name: f"/usr/bin/{name}" if name != "python3.13" else None)
    monkeypatch.setattr(kit, "has", lambda *_: True)

    def turn(_: str, command: list[str]) -> Any:
        turned.append(command)
        raise SystemExit

    monkeypatch.setattr(kit.os, "execv", turn)
    with pytest.raises(SystemExit):
        kit.choose_python()
    assert turned[0][0] == "/usr/bin/python3.12"


def test_shim_of_an_absent_python_is_passed_over(kit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kit.shutil, "which", lambda name: f"/shims/{name}")
    monkeypatch.setattr(kit, "has", lambda python, *_: python.endswith("3.11"))
    assert kit.better_python() == "/shims/python3.11"


@pytest.fixture
def pythons(kit: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, float]:
    """Seconds of the other builds of this Python, by the folder on PATH they stand in; 1 s of our own."""
    paces: dict[str, float] = {}
    name = f"python3.{sys.version_info[1]}"
    for folder in ("slow", "same", "fast", "bare"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text("")
        (tmp_path / folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", os.pathsep.join(str(tmp_path / folder) for folder in ("slow", "same", "bare", "fast")))
    monkeypatch.delenv("AHDC_KIT_PYTHON", raising=False)
    monkeypatch.setattr(kit, "pace_s", lambda path: paces.get(Path(path).parent.name, 1.0))
    monkeypatch.setattr(kit, "has", lambda path, *_: "bare" not in path)
    return paces


def test_a_much_faster_build_of_the_same_python_is_taken(
    kit: ModuleType, pythons: dict[str, float], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert kit.swifter_python() is None
    pythons.update(slow=1.4, same=0.9, bare=0.5, fast=0.7)
    fast = str(tmp_path / "fast" / f"python3.{sys.version_info[1]}")
    assert kit.swifter_python() == fast
    turned: list[tuple[str, str]] = []
    monkeypatch.setattr(kit.os, "execve", lambda path, _, env: turned.append((path, env["AHDC_KIT_PYTHON"])))
    kit.give_way()
    assert turned == [(fast, fast)]
    monkeypatch.setenv("AHDC_KIT_PYTHON", "own")
    kit.give_way()
    assert len(turned) == 1


def test_pace_is_measured_in_the_interpreter_itself(kit: ModuleType) -> None:
    assert 0.0 < kit.pace_s(sys.executable) < 60.0
    assert kit.pace_s("/bin/false") == float("inf")


@pytest.mark.parametrize(
    ("works", "wanted"),
    [
        ({"ensurepip", "pip"}, "environment's pip"),
        ({"pip"}, "own pip"),
        (set(), "nothing"),
    ],
)
def test_pip_is_taken_from_where_it_is(
    kit: ModuleType, monkeypatch: pytest.MonkeyPatch, works: set[str], wanted: str
) -> None:
    ran: list[list[str]] = []

    def has(_: str, *arguments: str) -> bool:
        text = " ".join(arguments)
        return "ensurepip" in works if "ensurepip" in text else "pip" in works if "pip" in text else True

    monkeypatch.setattr(kit, "has", has)
    monkeypatch.setattr(kit.subprocess, "run", lambda command, **_: ran.append(command))
    command = kit.pip_command(9)
    inside = str(kit.VENV / "bin" / "python")
    if wanted == "environment's pip":
        assert command == [inside, "-m", "pip"]
        assert "--without-pip" not in ran[0]
    elif wanted == "own pip":
        assert command == [sys.executable, "-m", "pip", "--python", inside]
        assert "--without-pip" in ran[0]
    else:
        assert (command, ran) == ([], [])


@pytest.fixture
def apt(kit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The apt-get commands kit ran; a machine with apt, without a terminal."""
    ran: list[str] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        ran.append(" ".join(command))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(kit.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(kit.subprocess, "run", run)
    monkeypatch.setattr(kit.sys, "stdin", io.StringIO())
    return ran


PACKAGE = f"python3.{sys.version_info[1]}-venv"


@pytest.mark.parametrize(("uid", "line"), [(1000, "sudo sh -c 'apt-get update && "), (0, "let kit do it: ./kit --yes")])
def test_missing_venv_package_is_named_not_installed(
    kit: ModuleType, apt: list[str], monkeypatch: pytest.MonkeyPatch, uid: int, line: str
) -> None:
    monkeypatch.setattr(kit.os, "geteuid", lambda: uid)
    with pytest.raises(kit.Refusal) as refusal:
        kit.install_venv_package(uid != 0)
    assert line in str(refusal.value)
    assert f"apt-get install -y {PACKAGE}" in str(refusal.value)
    assert apt == []


def test_missing_venv_package_is_installed_when_root_says_yes(
    kit: ModuleType, apt: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kit.os, "geteuid", lambda: 0)
    kit.install_venv_package(True)
    assert apt == ["apt-get -qq update", f"apt-get -qq install -y {PACKAGE}"]


def test_failing_pip_shows_its_last_words(kit: ModuleType, tmp_path: Path) -> None:
    kit.VENV.mkdir()
    held = os.open(tmp_path, os.O_RDONLY)
    with pytest.raises(kit.Refusal, match=r"(?s)no such host.*PIP_FIND_LINKS"):
        kit.pip([sys.executable, "-c", "print('no such host'); raise SystemExit(1)"], [], 2, held)
    os.close(held)


@pytest.mark.parametrize(
    ("quick", "arena", "code"),
    [(0, 0, 0), (1, 0, 1), (0, 1, 1), (0, 5, 0), (5, 0, 5), (2, 0, 2), (1, 5, 1), (3, 0, 3)],
)
def test_exit_code_of_the_tests(
    kit: ModuleType, monkeypatch: pytest.MonkeyPatch, quick: int, arena: int, code: int
) -> None:
    codes = {"not arena and not root and not prove": quick, "arena and not root and not prove": arena}
    monkeypatch.setattr(kit, "run", lambda *command: codes[command[-1]])
    assert kit.test([]) == code


@pytest.mark.parametrize(
    ("words", "commands"),
    [
        (["lint"], ["ruff check .", "ruff format --check .", "mypy"]),
        (["test", "tests/house"], ["pytest tests/house"]),
        (["test", "-m", "root"], ["pytest -m root"]),
        (["check"], ["ruff check .", "ruff format --check .", "mypy", "pytest -n auto", "pytest -p no:xdist"]),
        (["prove", "sweep", "-x"], ["pytest -m prove -s -x"]),
        (["exec", "ahdc-drivers", "list"], ["ahdc-drivers list"]),
        (["--yes", "demo", "--headless"], ["groundstation demo --headless"]),
    ],
)
def test_verbs_run_what_they_say(
    kit: ModuleType, monkeypatch: pytest.MonkeyPatch, words: list[str], commands: list[str]
) -> None:
    folder = kit.ROOT / "tests" / "prove"
    folder.mkdir(parents=True)
    (folder / "test_sweep.py").write_text("")
    ran: list[str] = []
    for name in ("run", "become"):
        monkeypatch.setattr(kit, name, lambda *command, **_: ran.append(" ".join(command)) or 0)
    monkeypatch.setattr(kit, "ensure", lambda yes: None)
    assert kit.main(words) == 0
    begun = [line.removeprefix(f"{kit.VENV}/bin/python -m ") for line in ran]
    assert len(begun) == len(commands)
    assert all(line.startswith(command) for line, command in zip(begun, commands, strict=True)), begun


def test_every_verb_is_taught(kit: ModuleType) -> None:
    assert all(f"\n  {verb} " in SOURCE for verb in kit.VERBS)


def test_unknown_verb_and_no_verb_are_bad_input(
    kit: ModuleType, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kit, "ensure", never)
    assert kit.main(["tests"]) == 2
    assert "known: demo, test" in capsys.readouterr().err
    assert kit.main([]) == 2
    assert kit.main(["--help"]) == 0
    assert "./kit [--yes] VERB" in capsys.readouterr().out


def test_outside_variables_do_not_get_in_front_of_the_lock(kit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/opt/somewhere")
    env = kit.environment()
    assert "PYTHONPATH" not in env
    assert env["PATH"].startswith(f"{kit.VENV}/bin:")


def test_unknown_proof_is_refused_and_known_ones_are_listed(
    kit: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = kit.ROOT / "tests" / "prove"
    folder.mkdir(parents=True)
    (folder / "test_sweep.py").write_text('"""A thousand missions without a split.\n\nMore."""\n')
    assert kit.prove(["--list"]) == 0
    assert capsys.readouterr().out.split(maxsplit=1) == ["sweep", "A thousand missions without a split.\n"]
    assert kit.prove(["swep"]) == 2
    assert "known: sweep" in capsys.readouterr().err


def test_script_needs_the_standard_library_only() -> None:
    tree = ast.parse(SOURCE)
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} <= sys.stdlib_module_names


def test_script_parses_on_the_python_it_has_to_refuse() -> None:
    ast.parse(SOURCE, feature_version=(3, 7))
