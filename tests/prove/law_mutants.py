"""What became of the mutants of the control law, from mutmut's own records, for a copy of the checkout it ran in.

    python -m tests.prove.law_mutants COPY

prints JSON: counts by ending, and every mutant that no test has found out as [function, before, after].
"""

import json
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

FOUND_OUT = {1: "killed", 3: "killed", -24: "timeout", 24: "timeout", 36: "timeout", 152: "timeout", 255: "timeout"}
"""Exit codes of a mutant's tests; anything else is no verdict of theirs."""
ALIVE = {0: "survived", 5: "no tests", 33: "no tests", None: "not run"}


def endings(copy: Path) -> Iterator[tuple[str, str]]:
    """Every mutant's name, and how it ended."""
    for file in sorted((copy / "mutants").rglob("*.meta")):
        for name, code in json.loads(file.read_text(encoding="utf-8"))["exit_code_by_key"].items():
            yield name, FOUND_OUT.get(code) or ALIVE.get(code) or f"exit code {code}"


def changed(diff: str) -> tuple[str, str]:
    """The lines that a diff takes away and those that it adds, each in one."""
    lines = [line for line in diff.splitlines() if line[:3] not in ("---", "+++")]
    before, after = (" / ".join(line[1:].strip() for line in lines if line[:1] == sign) for sign in "-+")
    return before, after


def function_of(name: str) -> str:
    """``onboard.ahdc.tasking Tasking._left_m`` of ``onboard.ahdc.tasking.xǁTaskingǁ_left_m__mutmut_1``."""
    module, _, mangled = name.rpartition("__mutmut_")[0].rpartition(".")
    return f"{module} {mangled.removeprefix('x_').removeprefix('xǁ').replace('ǁ', '.')}"


def main() -> int:
    copy = Path(sys.argv[1])
    os.chdir(copy)
    from mutmut.mutation.diff_apply import get_diff_for_mutant

    counts: Counter[str] = Counter()
    alive = []
    for name, ending in endings(copy):
        counts[ending] += 1
        if ending not in FOUND_OUT.values():
            alive.append([function_of(name), *changed(get_diff_for_mutant(name))])
    print(json.dumps({"counts": counts, "alive": alive}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
