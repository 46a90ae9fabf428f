"""The runs of a sweep on a Dask cluster: same jobs, same results, in the same order.

Every worker must run the very code that asks: otherwise the results would depend on who played them.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path

from groundstation.result import Result
from groundstation.sweep import POLL_S, Job, keep, polled

CONNECT_S = 10.0
PACKAGES = ("contract", "onboard", "drivers", "mocap_bridge", "groundstation")
INSTALL = "pip install 'ahdc-fieldkit[distributed]'"


def fingerprint() -> str:
    """Hash of every module of the kit here."""
    root = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _remote_fingerprint() -> str:
    return fingerprint()


def spread(jobs: list[Job], address: str) -> Iterator[Result | None]:
    """Results in the order of the jobs, None now and then in between; left early, what has not begun is cancelled.

    :raises ConnectionError: no ``distributed``, no scheduler, no workers, or workers with other code.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ConnectionError(f"--cluster needs the package distributed; remedy: {INSTALL}") from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConnectionError(f"--cluster {address}: no scheduler answers ({error})") from None
    with client:
        _check(client.run(_remote_fingerprint, on_error="return"), address)
        futures = client.map(keep, jobs, pure=False, retries=1)
        try:
            yield from polled(len(jobs), lambda k: futures[k].result(timeout=POLL_S), TimeoutError)
        finally:
            client.cancel(futures)


def _check(found: dict[str, object], address: str) -> None:
    """Every worker has this code."""
    if not found:
        raise ConnectionError(f"--cluster {address}: the scheduler has no workers; start some: dask worker {address}")
    ours = fingerprint()
    others = {worker: code for worker, code in found.items() if code != ours}
    if others:
        worker, code = next(iter(others.items()))
        raise ConnectionError(
            f"--cluster {address}: {len(others)} of {len(found)} workers run other code, {worker} for one: "
            f"{code}, here {ours}; install the same revision there"
        )
