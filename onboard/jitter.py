"""How late a loop of the control loop's kind wakes up on this computer, with and without what may make it steadier.

Each setting is tried in a process of its own, in turns with all the others, so that what else the computer does
meets them alike; only ratios within a turn are compared.
"""

import json
import os
import select
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from onboard import switches
from onboard.computer import said
from onboard.service import lock_memory, quiet

PERIOD_NS: Final = 10_000_000
BATCH: Final = 300
"""Objects a step makes and drops, as decoding a frame and planning do."""


class Lateness(NamedTuple):
    """Of one setting, microseconds after the due time."""

    setting: str
    p50_us: float
    p99_us: float
    max_us: float
    ratio: float
    """p99 against that of ``AS_IT_IS`` in the same turn, median over the turns."""
    refused: str = ""
    """Why it could not be tried here."""


def _locked() -> None:
    if not lock_memory():
        raise PermissionError("mlockall is refused; LimitMEMLOCK")


def _fifo() -> None:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))


def _one_core() -> None:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def _nice() -> None:
    os.nice(-10)


def _nothing() -> None:
    return


AS_IT_IS = "as it is"
GOVERNOR = "governor"
WIFI = "round trip, Wi-Fi saving"
SWITCH = "not tried: --switch does, as root, and puts it back"
SETTINGS: dict[str, Callable[[], None]] = {
    AS_IT_IS: _nothing,
    "garbage collector quiet": quiet,
    "memory locked": _locked,
    "nice -10": _nice,
    "one core": _one_core,
    "SCHED_FIFO 50": _fifo,
}


def compare(turns: int, seconds: float, switch: bool = False, root: Path = Path("/")) -> list[Lateness]:
    """Every setting ``turns`` times for ``seconds`` each.

    :param switch: turn settings of the whole machine to and fro as well, as root, and put them back.
    :param root: the machine's files, or a tree that looks like them.
    """
    samples: dict[str, list[list[float]]] = {name: [] for name in SETTINGS}
    files, values = switches.governors(root)
    names = {f"{GOVERNOR} {value}": value for value in values}
    refused = {} if switch else dict.fromkeys(names, SWITCH)
    samples |= {name: [] for name in names}
    for _ in range(turns):
        for name, setting in SETTINGS.items():
            _take(name, partial(tried, setting, seconds), samples, refused)
        for name, value in names.items():
            _take(name, partial(_governed, files, value, seconds), samples, refused)
    if not names:
        samples[GOVERNOR] = []
        refused[GOVERNOR] = "the kernel sets no frequency here"
    elsewhere = switches.without_lateness(root)
    return [
        *summary(samples, refused),
        *round_trips(turns, switch),
        *(Lateness(name, 0.0, 0.0, 0.0, 0.0, why) for name, why in elsewhere.items()),
    ]


def _take(
    name: str,
    measure: Callable[[], list[float] | str],
    samples: dict[str, list[list[float]]],
    refused: dict[str, str],
) -> None:
    if name not in refused:
        found = measure()
        if isinstance(found, str):
            refused[name] = found
        else:
            samples[name].append(found)


def _governed(files: Sequence[Path], value: str, seconds: float) -> list[float] | str:
    try:
        with switches.held(files, value):
            return tried(_nothing, seconds)
    except OSError as error:
        return error.strerror or str(error)


def round_trips(turns: int, may_switch: bool, ask: Callable[..., str] = said) -> list[Lateness]:
    """Round trips to the gateway over Wi-Fi, its power saving on and off; the ratio is against on."""
    interface, gateway = switches.wireless_gateway(ask)
    if not gateway or not may_switch:
        return [Lateness(WIFI, 0.0, 0.0, 0.0, 0.0, SWITCH if gateway else "there is no wireless interface in use")]
    found: dict[str, list[list[float]]] = {"on": [], "off": []}
    for _ in range(turns):
        for save, blocks in found.items():
            blocks.append(switches.round_trips_us(interface, gateway, save, ask))
    if not all(block for blocks in found.values() for block in blocks):
        return [Lateness(WIFI, 0.0, 0.0, 0.0, 0.0, f"{gateway} does not answer a ping")]
    return [_row(f"{WIFI} {save}", blocks, found["on"]) for save, blocks in found.items()]


def summary(samples: dict[str, list[list[float]]], refused: dict[str, str]) -> list[Lateness]:
    """One row a setting from its turns' samples, in microseconds."""
    rows = []
    for name, blocks in samples.items():
        if not blocks or name in refused:
            rows.append(Lateness(name, 0.0, 0.0, 0.0, 0.0, refused.get(name, "no samples")))
            continue
        rows.append(_row(name, blocks, samples[AS_IT_IS]))
    return rows


def _row(name: str, blocks: list[list[float]], bases: list[list[float]]) -> Lateness:
    whole = sorted(value for block in blocks for value in block)
    pairs = [share(own, 0.99) / share(base, 0.99) for own, base in zip(blocks, bases, strict=False)]
    ratio = statistics.median(pairs) if pairs else 0.0
    return Lateness(name, share(whole, 0.5), share(whole, 0.99), whole[-1], ratio)


def share(values: Sequence[float], part: float) -> float:
    """The value that ``part`` of the values do not exceed; never below 1, for ratios."""
    ordered = sorted(values)
    return max(1.0, ordered[min(len(ordered) - 1, int(part * len(ordered)))])


def tried(setting: Callable[[], None], seconds: float) -> list[float] | str:
    """Lateness of every step in a process with that setting, microseconds; or why it is refused."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        answer: object = "it ended early"
        try:
            os.close(reader)
            setting()
            answer = measured(seconds)
        except OSError as error:
            answer = error.strerror or str(error)
        finally:
            with os.fdopen(writer, "w") as pipe:
                json.dump(answer, pipe)
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    found: list[float] | str = json.loads(text) if text else "it ended early"
    return found


def measured(seconds: float) -> list[float]:
    """Lateness of every step, microseconds."""
    poll = select.poll()
    late_us = []
    due_ns = time.monotonic_ns() + PERIOD_NS
    end_ns = due_ns + int(seconds * 1e9)
    while due_ns < end_ns:
        poll.poll(max(0, due_ns - time.monotonic_ns()) / 1e6)
        while time.monotonic_ns() < due_ns:
            poll.poll(0)
        late_us.append((time.monotonic_ns() - due_ns) / 1e3)
        kept = [{"x_m": float(index), "other": [index]} for index in range(BATCH)]
        kept[0]["self"] = kept
        due_ns += PERIOD_NS
    return late_us
