"""What doctor says of a site's certificates: who has none, whose end soon, which files others can read. Pure."""

from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime

from contract.checks import CheckResult
from groundstation import certificates
from groundstation.register import Register, lifetime


def certificate_checks(
    names: Iterable[str], register: Register | None, held: Mapping[str, bytes], too_open: Iterable[str], now: datetime
) -> Iterator[CheckResult]:
    """A check for everybody who should have a certificate, and one for the files.

    :param names: robots and roles that the site cannot do without.
    :param register: None on a computer that has only its own certificate: that one is looked at.
    :param held: certificates on this computer by holder, PEM.
    """
    for name in names if register is not None else held:
        remedy = f"ahdc-groundstation keys issue {name} --replace, then bring it to where it belongs"
        if register is None:
            words, well = lifetime(certificates.about(held[name]).not_after, now)
        elif (entry := register.current(name)) is not None:
            words, well = lifetime(entry.not_after, now)
        else:
            words, well = "revoked" if register.is_revoked(name) else "none", False
        verdict = "pass" if well else "warn" if words.startswith("ends") else "fail"
        yield CheckResult(
            name="certificate",
            verdict=verdict,  # type: ignore[arg-type]
            seen=words,
            remedy="" if well else remedy,
            subject=name,
        )
    found = list(too_open)
    yield CheckResult(
        name="private keys",
        verdict="fail" if found else "pass",
        seen=f"readable by others: {', '.join(found)}"[:400] if found else "their owner's alone",
        remedy="chmod 600 them, and issue new ones if somebody else may have read them" if found else "",
    )
