"""The handbook's commands, typed in order in one folder; of those that need hands or hours, who runs them."""

import re
from pathlib import Path

import pytest

from tests.arena.commands import ELSEWHERE, documented, unaccounted
from tests.arena.handbook import FOLDER, PAGES, QUICK, Reader, blocks
from tests.house.checkout import ROOT


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


def test_every_command_of_every_page_is_run_by_a_test() -> None:
    commands = documented()
    assert len(commands) > 120
    assert unaccounted(commands) == []


def test_a_command_that_no_test_runs_is_found() -> None:
    said = {"ahdc-groundstation report --frame 7": "a.md", "ahdc-drivers list --all": "a.md", "keys burn r06": "b.md"}
    assert unaccounted(said) == [
        "a.md: ahdc-drivers list --all",
        "a.md: ahdc-groundstation report --frame 7",
        "b.md: keys burn r06",
    ]


@pytest.mark.parametrize("begin", ELSEWHERE)
def test_what_is_not_typed_here_is_run_elsewhere(begin: str) -> None:
    file, words = ELSEWHERE[begin]
    assert words in (ROOT / file).read_text(), f"{file} does not run {begin}"


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
