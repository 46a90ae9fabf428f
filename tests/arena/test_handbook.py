"""The handbook's commands, typed in order in one folder; of those that need hands or hours, who runs them."""

import re
from pathlib import Path

import pytest

from tests.arena.handbook import FOLDER, PAGES, QUICK, Reader, blocks
from tests.house.checkout import ROOT

ELSEWHERE = {
    "ahdc-drivers jog": "tests/drivers/test_bench_verbs.py",
    "ahdc-drivers identify": "tests/drivers/test_bench_verbs.py",
    "ahdc-mocap-bridge record": "tests/mocap_bridge/test_mocap_replay.py",
    "ahdc-groundstation calibrate": "tests/groundstation/test_calibration.py",
    "ahdc-groundstation deploy": "tests/prove/test_deploy.py",
    "ahdc-groundstation page": "tests/groundstation/test_page_server.py",
    "./kit demo": "tests/arena/test_six_robots.py",
    "./kit test": "tests/house/test_kit.py",
    "./kit prove": "tests/house/test_kit.py",
}


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Reader:
    return Reader(tmp_path_factory.mktemp("clone"))


@pytest.mark.parametrize("page", QUICK)
def test_every_command_of_the_page_works(reader: Reader, page: str) -> None:
    reader.follow(FOLDER / f"{page}.md")


def test_every_page_with_commands_is_followed() -> None:
    with_commands = {path.stem for path in FOLDER.glob("*.md") if any(block.kind == "sh" for block in blocks(path))}
    assert with_commands == set(PAGES)


def test_blocks_of_commands_say_who_runs_them() -> None:
    kinds = {block.kind for path in FOLDER.glob("*.md") for block in blocks(path)}
    assert kinds <= {"sh", "sh by-hand", "sh elsewhere", "toml"}


def test_what_is_not_typed_here_is_run_elsewhere() -> None:
    lines = [
        line.removeprefix("./kit exec ")
        for path in FOLDER.glob("*.md")
        for block in blocks(path)
        if block.kind in ("sh by-hand", "sh elsewhere")
        for line in block.text.splitlines()
    ]
    assert lines
    assert [line for line in lines if not any(line.startswith(command) for command in ELSEWHERE)] == []
    for command, test in ELSEWHERE.items():
        text = (ROOT / test).read_text()
        assert command.split()[-1] in text, f"{test} does not run {command}"


def test_a_command_that_fails_is_found(reader: Reader) -> None:
    with pytest.raises(AssertionError, match="ended with 2"):
        reader.type("./kit exec ahdc-drivers check no-such.toml")


def test_indented_blocks_are_read(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("1. a\n\n   ```sh\n   one\n   two\n   ```\n\n```toml\nx = 1\n```\n")
    assert [(block.kind, re.sub(r"\s+", " ", block.text).strip()) for block in blocks(page)] == [
        ("sh", "one two"),
        ("toml", "x = 1"),
    ]
