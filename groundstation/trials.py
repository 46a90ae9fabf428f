"""What an experiment file asks for: every trial with its name, in the order in which it is run. Pure."""

import tomllib
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from msgspec import Meta, Struct

from contract import profiles
from contract.arena import ArenaError
from contract.tables import Fault, nearest, read_table, show

Many = Annotated[int, Meta(ge=1, le=1000)]
Seed = Annotated[int, Meta(ge=0, le=(1 << 32) - 1)]
Backend = Literal["lockstep", "mock", "robots"]


class Experiment(Struct, frozen=True, forbid_unknown_fields=True):
    """An experiment file. Every combination of robots, targets, profile and seed is run ``repetitions`` times."""

    name: Annotated[str, Meta(pattern="^[a-z0-9_-]{1,32}$")]
    backend: Backend = "lockstep"
    """Where: virtual time, the mock arena in real time, or the arena's robots and its running processes."""
    arena: str = ""
    """Arena file, or an example's name; of ``mock`` and ``robots``."""
    robots: tuple[Many, ...] = ()
    """Numbers of robots; empty: those of the arena file."""
    targets: tuple[Many, ...] = (19,)
    profiles: tuple[str, ...] = ()
    """Control profiles, ours or installed laws; empty: that of the arena file (``lockstep``: field)."""
    seeds: tuple[Seed, ...] = (1,)
    """Of the target clouds."""
    repetitions: Many = 1
    timeout_s: Annotated[float, Meta(gt=0.0, le=86_400.0)] = 120.0
    """A mission that takes longer has failed."""
    conditions: Literal["ideal", "field"] = "field"
    """Of ``lockstep``."""
    record: bool = False
    """Of ``lockstep``: keep a recording of every trial; the other backends always do."""
    pause_below_v: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Of ``robots``: wait for the operator before a trial while a battery is below this; 0: never."""


class Trial(NamedTuple):
    """One run of an experiment; ``robots`` 0 and ``profile`` '' stand for those of the arena file."""

    name: str
    robots: int
    targets: int
    profile: str
    seed: int
    repetition: int


def parse(text: str, source: str) -> Experiment:
    """An experiment from its TOML.

    :raises ArenaError: listing every fault.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ArenaError(source, [Fault("file", source, f"not TOML: {error}")]) from None
    faults: list[Fault] = []
    found: Experiment | None = read_table(Experiment, table, "", faults)
    if found is not None:
        faults += _cross_checks(found, table)
    if faults or found is None:
        raise ArenaError(source, faults)
    return found


def _cross_checks(experiment: Experiment, table: dict[str, object]) -> Iterator[Fault]:
    backend = experiment.backend
    if backend == "lockstep":
        if not experiment.robots:
            yield Fault("robots", "", 'backend "lockstep" needs numbers of robots, such as [5, 6]')
        if experiment.repetitions > 1:
            text = "the same seed gives the same run, bit for bit, in lockstep; give more seeds instead"
            yield Fault("repetitions", str(experiment.repetitions), text)
        unused = ("arena", "pause_below_v")
    else:
        if not experiment.arena:
            yield Fault("arena", "", f'backend "{backend}" needs an arena file or an example\'s name')
        unused = ("conditions", "record", *(("pause_below_v",) if backend == "mock" else ("robots", "profiles")))
    for key in unused:
        if key in table:
            yield Fault(key, str(table[key]), f'not used by backend "{backend}"; remove it')
    for key in ("targets", "seeds", "robots", "profiles"):
        values = getattr(experiment, key)
        if len(set(values)) < len(values):
            yield Fault(key, str(list(values)), "every value once; use repetitions to run the same again")
    for index, profile in enumerate(experiment.profiles):
        if profile not in (known := profiles.known()):
            text = "needs one of " + ", ".join(known)
            yield Fault(f"profiles[{index}]", show(profile), text, nearest(profile, known))
    for key in ("targets", "seeds"):
        if not getattr(experiment, key):
            yield Fault(key, "[]", "at least one value is needed")


def trials(experiment: Experiment) -> list[Trial]:
    """All trials; whole repetitions one after the other, so that an experiment cut short is balanced."""
    profiles = experiment.profiles or (("field",) if experiment.backend == "lockstep" else ("",))
    return [
        Trial(_name(profile, robots, targets, seed, k), robots, targets, profile, seed, k)
        for k in range(1, experiment.repetitions + 1)
        for seed in experiment.seeds
        for robots in experiment.robots or (0,)
        for targets in experiment.targets
        for profile in profiles
    ]


def _name(profile: str, robots: int, targets: int, seed: int, repetition: int) -> str:
    parts = (profile, f"n{robots}" if robots else "", f"m{targets}", f"s{seed}", f"k{repetition}")
    return "-".join(part for part in parts if part)
