"""One result type for every doctor, pre-flight and loader check."""

from typing import Literal

from contract.messages import Message
from contract.units import Name, Text

Verdict = Literal["pass", "warn", "fail"]


class CheckResult(Message, frozen=True, kw_only=True):
    """One named check: its verdict, what was seen, and what to do about it."""

    name: Name
    verdict: Verdict
    seen: Text = ""
    remedy: Text = ""
    subject: Name = ""
    """Robot, device or file the check is about."""


def worst(results: list[CheckResult]) -> Verdict:
    """The gravest verdict; ``pass`` for an empty list."""
    verdicts = {result.verdict for result in results}
    return "fail" if "fail" in verdicts else "warn" if "warn" in verdicts else "pass"
