"""A new reader's way: every page of the handbook in order, every command typed, missions and all."""

import pytest

from tests.arena.handbook import FOLDER, PAGES, Reader

pytestmark = pytest.mark.timeout(900)


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Reader:
    return Reader(tmp_path_factory.mktemp("clone"))


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_the_page_works(reader: Reader, page: str) -> None:
    reader.follow(FOLDER / f"{page}.md")
