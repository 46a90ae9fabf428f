"""The text of the project speaks of the project: no machine's paths, no registry hosts, nothing left to do."""

import re

from tests.house.checkout import ROOT, tracked

FORBIDDEN = {
    "a path of one machine": r"(?<!\w)/(?:(?:work|farm|root)/|home/[a-z]|tmp/v\b)",
    "a registry host": r"pypi\.org|pythonhosted|npmjs\.|deb\.debian|file:///",
    "talk of how the work is organised": r"\bissue #?\d|developer session|\bthis session\b",
    "something left to do": r"\bTO" + r"DO\b|\bFIX" + r"ME\b",
}
BINARY = (".png", ".mcap", ".gz", ".pdf", ".npz", ".bin", ".woff2")


def faults(name: str, text: str) -> list[str]:
    return [
        f"{name}:{number}: {what}: {line.strip()[:100]}"
        for number, line in enumerate(text.splitlines(), 1)
        for what, pattern in FORBIDDEN.items()
        if re.search(pattern, line, re.IGNORECASE if what.startswith("talk") else 0)
    ]


def test_text_is_clean() -> None:
    files = [path for path in tracked() if path.suffix not in BINARY and path.name != "test_hygiene.py"]
    assert len(files) > 10
    found = [fault for path in files for fault in faults(str(path.relative_to(ROOT)), path.read_text())]
    assert not found, "\n".join(found)


def test_each_kind_is_found() -> None:
    lines = ["see /wo" + "rk/x", "index: https://py" + "pi.org/simple", "as iss" + "ue #4 asks", "# TO" + "DO: later"]
    assert [len(faults("f", line)) for line in lines] == [1, 1, 1, 1]


def test_scripts_are_executable() -> None:
    shebang = [path for path in tracked() if path.suffix not in BINARY and path.read_text().startswith("#!")]
    assert ROOT / "kit" in shebang
    assert [path for path in shebang if not path.stat().st_mode & 0o111] == []
