"""A new reader's way: every command of the handbook typed in order, missions and all; then those of all other pages."""

import os

import pytest

from tests.arena.commands import ALONE, BESIDE, SITE, SMALL, Way
from tests.arena.handbook import FOLDER, PAGES, Reader

pytestmark = pytest.mark.timeout(900)


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Reader:
    reader = Reader(tmp_path_factory.mktemp("clone"))
    (reader.folder / "small.toml").write_text(SMALL)
    return reader


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_the_page_works(reader: Reader, page: str) -> None:
    reader.follow(FOLDER / f"{page}.md")


@pytest.mark.parametrize("way", dict.fromkeys(ALONE.values()), ids=lambda way: way.typed)
def test_every_command_of_the_text_works(reader: Reader, way: Way) -> None:
    if way == ALONE["ahdc-groundstation radio --out DIR"] and os.geteuid():
        pytest.skip("network namespaces need root")
    try:
        reader.type(*way)
    finally:
        reader.end()


def test_orders_of_the_text_work_beside_a_running_site(reader: Reader) -> None:
    try:
        for line in SITE:
            reader.type(line)
        for way in dict.fromkeys(BESIDE.values()):
            reader.type(*way)
    finally:
        reader.end()
