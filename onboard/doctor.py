"""``doctor``: what of this computer makes the control loop late, and the exact remedy; ``--jitter`` measures."""

import argparse
import sys

import msgspec

from contract.checks import CheckResult, worst
from onboard.checkup import checkup
from onboard.computer import snapshot
from onboard.jitter import Lateness, compare


def run(arguments: argparse.Namespace) -> int:
    """Exit code 1 where something fails (with ``--strict``: is warned of)."""
    if arguments.jitter:
        if arguments.turns < 1 or not 0.05 <= arguments.seconds <= 60.0:
            print("--turns: 1 or more; --seconds: from 0.05 to 60", file=sys.stderr)
            return 2
        rows = compare(arguments.turns, arguments.seconds, arguments.switch)
        print(msgspec.json.encode(rows).decode() if arguments.json else "\n".join(table(rows)))
        return 0
    results = checkup(snapshot())
    print(msgspec.json.encode(results).decode() if arguments.json else "\n".join(lines(results)))
    bad = ("fail", "warn") if arguments.strict else ("fail",)
    return 1 if worst(results) in bad else 0


def lines(results: list[CheckResult]) -> list[str]:
    """A line a check, and its remedy below where there is one."""
    names = [f"{result.name} {result.subject}".strip() for result in results]
    wide = max(map(len, names), default=0)
    found = []
    for name, result in zip(names, results, strict=True):
        found.append(f"{result.verdict.upper():<4}  {name:<{wide}}  {result.seen}")
        if result.remedy:
            found.append(f"{'':<{wide + 6}}  -> {result.remedy}")
    return found


def table(rows: list[Lateness]) -> list[str]:
    """Late by how much, setting by setting."""
    found = [f"{'setting':<28}{'p50 us':>9}{'p99 us':>9}{'max us':>9}   p99 against as it is"]
    for row in rows:
        if row.refused:
            found.append(f"{row.setting:<28}{'-':>9}{'-':>9}{'-':>9}   {row.refused}")
        else:
            found.append(f"{row.setting:<28}{row.p50_us:>9.0f}{row.p99_us:>9.0f}{row.max_us:>9.0f}   {row.ratio:.2f}")
    return found
