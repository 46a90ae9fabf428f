"""Links and commands in the documentation lead somewhere."""

import functools
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from markdown_it import MarkdownIt

from tests.house import arena_page
from tests.house.checkout import ROOMS, ROOT, tracked

PAGES = [str(path.relative_to(ROOT)) for path in tracked("*.md")]
LINK = re.compile(r"\]\(([^)\s]+)\)|<img[^>]+src=\"([^\"]+)\"")
VERBS = set(re.findall(r"^  ([a-z]+) ", (ROOT / "kit").read_text().split('"""')[1], re.MULTILINE))


def without_code(text: str) -> str:
    return re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)


def anchors(text: str) -> set[str]:
    """The anchors a reader's browser gets for the headings, as GitHub spells them."""
    headings = re.findall(r"^#+ +(.*)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def broken(page: Path, text: str) -> list[str]:
    """Relative links of a page that lead to no file or to no heading."""
    found = []
    for match in LINK.finditer(without_code(text)):
        target = match[1] or match[2]
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name) if name else page
        if not file.exists():
            found.append(f"{page.name}: {target}: no such file")
        elif anchor and file.suffix == ".md" and anchor not in anchors(file.read_text() if name else text):
            found.append(f"{page.name}: {target}: no such heading")
    return found


@pytest.mark.parametrize("page", PAGES)
def test_links_resolve(page: str) -> None:
    assert broken(ROOT / page, (ROOT / page).read_text()) == []


def unbuilt(text: str) -> list[str]:
    """What of a page does not become what its writer meant: a fence left open, a table that is none or lost a cell."""
    build = MarkdownIt("commonmark").enable("table")
    tokens = build.parse(text)
    html = re.sub(r"<code.*?</code>", "", build.render(text), flags=re.DOTALL)
    found = [f"no table: {line}" for line in re.findall(r"^(?:<p>)?(\|.*)$", html, re.MULTILINE)]
    found += [f"fence: {line}" for line in re.findall(r"^.*```.*$", html, re.MULTILINE)]
    lines = text.splitlines()
    for token in tokens:
        if token.type == "fence" and token.map and not lines[token.map[1] - 1].strip().startswith("```"):
            found.append(f"open fence: {lines[token.map[0]]}")
        if token.type == "table_open" and token.map:
            rows = [
                re.split(r"(?<!\\)\|", line.strip().removeprefix("|").removesuffix("|"))
                for line in lines[slice(*token.map)]
            ]
            found += [f"cells: {'|'.join(row)}" for row in rows if len(row) != len(rows[0])]
    return found


@pytest.mark.parametrize("page", PAGES)
def test_pages_build(page: str) -> None:
    assert unbuilt((ROOT / page).read_text()) == []


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("| a | b |\n|---|---|\n| 1 |\n", "cells"),
        ("| a | b |\n| 1 | 2 |\n", "no table"),
        ("```sh\nls\n", "open fence"),
    ],
)
def test_a_page_that_does_not_build_is_found(text: str, what: str) -> None:
    assert next(line.split(":")[0] for line in unbuilt(text)) == what


@pytest.mark.parametrize("page", PAGES)
def test_kit_verbs_exist(page: str) -> None:
    used = set(re.findall(r"\./kit (?:--yes )?([a-z]+)", (ROOT / page).read_text()))
    assert used <= VERBS


@pytest.mark.parametrize("page", PAGES)
def test_proofs_and_files_of_kit_commands_exist(page: str) -> None:
    text = (ROOT / page).read_text()
    words = [word for line in re.findall(r"\./kit prove((?: [a-z_]+)+)(?=[`\n])", text) for word in line.split()]
    assert [word for word in words if not (ROOT / "tests" / "prove" / f"test_{word}.py").exists()] == []
    files = re.findall(
        r"(?<![\w/])(?:tests|bench|onboard|groundstation|drivers|contract|mocap_bridge)/[\w/]+\.(?:py|sh|txt)", text
    )
    assert [file for file in files if "NAME" not in file and not (ROOT / file).exists()] == []


def test_a_broken_link_is_found() -> None:
    page = ROOT / "README.md"
    assert broken(page, "# A\n[x](no/such.md) [y](#b) [z](#a)") == [
        "README.md: no/such.md: no such file",
        "README.md: #b: no such heading",
    ]


def test_every_page_in_docs_is_in_the_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text()
    pages = [path.relative_to(ROOT / "docs").as_posix() for path in tracked("docs/*.md") if path.name != "README.md"]
    assert pages
    assert [page for page in pages if f"({page}" not in index] == []


def test_arena_page_tells_every_key_as_the_loader_reads_it() -> None:
    assert arena_page.PAGE.read_text() == arena_page.page(), "run python -m tests.house.arena_page"
    keys = {f.name for struct in arena_page.SECTIONS.values() for f in msgspec.structs.fields(struct)}
    assert len(keys) > 40


VERB_USE = re.compile(r"\b(ahdc-(?:onboard|drivers|mocap-bridge|groundstation))[ \t]+([a-z][a-z-]+)")


@pytest.mark.parametrize("page", PAGES)
def test_commands_of_the_rooms_exist(page: str) -> None:
    """Every ``ahdc-ROOM VERB`` inside code of a page is a verb that the command knows."""
    code = re.findall(r"```[a-z]*\n(.*?)```|`([^`\n]+)`", (ROOT / page).read_text(), re.DOTALL)
    used = {match for pair in code for match in VERB_USE.findall("\n".join(pair))}
    assert [use for use in sorted(used) if not knows(*use)] == []


COMMAND_LINE = re.compile(r"\b(ahdc-(?:onboard|drivers|mocap-bridge|groundstation))[ \t]+([a-z][a-z-]+)([^\n`|;]*)")


@pytest.mark.parametrize("page", PAGES)
def test_options_of_commands_exist(page: str) -> None:
    code = re.findall(r"```[a-z -]*\n(.*?)```|`([^`\n]+)`", (ROOT / page).read_text(), re.DOTALL)
    lines = COMMAND_LINE.findall("\n".join(block or inline for block, inline in code))
    used = {
        (command, verb, option)
        for command, verb, rest in lines
        for option in re.findall(r"(?<![\w-])--[a-z-]+", rest.partition("#")[0])
    }
    assert [use for use in sorted(used) if not re.search(rf"{use[2]}(?![\w-])", helped(*use[:2]))] == []


def knows(command: str, verb: str) -> bool:
    return "usage" in helped(command, verb)


@functools.cache
def helped(command: str, verb: str) -> str:
    """What the verb says of itself; empty where the command has no such verb."""
    module = command.removeprefix("ahdc-").replace("-", "_")
    done = subprocess.run(
        [sys.executable, "-m", module, verb, "--help"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return done.stdout if done.returncode == 0 else ""


def test_an_unknown_verb_is_found() -> None:
    assert not knows("ahdc-groundstation", "teleport")


def test_symbols_of_the_paper_stand_where_the_table_says() -> None:
    law = ROOT / "onboard" / "ahdc"
    table = (law / "PAPER.md").read_text().partition("## Symbols")[2].partition("\n## ")[0]
    rows = [row.split(" | ") for row in re.findall(r"^\| (.+) \|$", table, re.MULTILINE)]
    seen = 0
    for cells in rows:
        files = re.findall(r"`([^`]+\.py)`", cells[-1])
        text = "\n".join((ROOT / name if "/" in name else law / name).read_text() for name in files)
        words = [word for name in re.findall(r"`([^`]+)`", cells[1]) for word in re.findall(r"\w+", name)]
        assert [word for word in words if not re.search(rf"\b{word}\b", text)] == [], cells[0]
        seen += len(words)
    assert seen > 40


def test_symptoms_are_words_that_the_programs_say() -> None:
    page = (ROOT / "docs" / "handbook" / "troubleshooting.md").read_text()
    source = "\n".join(path.read_text() for room in ROOMS for path in (ROOT / room).rglob("*.py"))
    source = source.replace("cannot {verb}", "cannot open")
    symptoms = [
        word
        for row in re.findall(r"^\| (.+) \|$", page, re.MULTILINE)
        if " | " in row
        for word in re.findall(r"`([^`]+)`", row.split(" | ")[0])
    ]
    assert len(symptoms) > 12
    assert [word for word in symptoms if word not in source] == []
