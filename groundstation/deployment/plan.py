"""What is done to one robot's computer, step by step, as data. Pure: nothing here reaches a robot."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple

from groundstation.deployment.render import rules_name, unit_name

SCRIPTS = Path(__file__).parent / "scripts"
Wanted = Literal["ready", "waiting"]
"""What the new release must reach: at work, or, where no router answers, looking for it."""

READY_TURNS, PAUSE_S = 60, 0.5
STEADY = 4
"""Looks in a row at one process that is well."""


class Copy(NamedTuple):
    """Files to the robot."""

    source: Path
    """A folder on the station; its content is copied."""
    target: str
    delete: bool
    """Take away what is not in the source."""


class Step(NamedTuple):
    """One thing done on a robot: a copy, then a script."""

    name: str
    says: str
    """What it does, for a person."""
    script: str = ""
    """For ``sh -s`` as root."""
    copies: tuple[Copy, ...] = ()
    timeout_s: float = 60.0
    switched: bool = False
    """From this step on a failure takes the robot back to its last release."""


class Target(NamedTuple):
    """One robot and where its things lie."""

    robot: str
    folder: str
    root: str = ""
    """Prefix of every path: empty, but for tests."""


class Release(NamedTuple):
    """What is to be installed on one robot."""

    name: str
    environment: str
    files: Path
    """Folder with arena.toml, unit, rules and keys."""
    wheels: Path
    """Folder of wheels, the installer's own among them."""
    requirements: str
    """With a hash for each wheel."""
    pip: str
    """File name of the installer's wheel."""
    pip_sha256: str
    python: str
    """The robot's interpreter."""
    arena_hash: str


def script(name: str, target: Target, values: Mapping[str, object] | None = None) -> str:
    """A script of this package with its variables set."""
    given = {
        "ROOT": target.root,
        "FOLDER": target.folder,
        "ROBOT": target.robot,
        "UNIT": unit_name(target.robot),
        "RULES": rules_name(target.robot),
        **(values or {}),
    }
    lines = [f"{key}={shlex.quote(str(value))}" for key, value in given.items()]
    return "\n".join(["set -eu", *lines, (SCRIPTS / f"{name}.sh").read_text(encoding="utf-8")])


def probe(target: Target) -> Step:
    """Look, change nothing."""
    return Step("probe", "look at the computer", script("probe", target), timeout_s=20.0)


def deployment(target: Target, release: Release, wanted: Wanted) -> tuple[Step, ...]:
    """From a computer that passed its pre-flight to a robot that runs the release."""
    base = target.root + target.folder
    values = {
        "RELEASE": release.name,
        "ENVIRONMENT": release.environment,
        "REQUIREMENTS": release.requirements,
        "PIP": release.pip,
        "PIP_SHA256": release.pip_sha256,
        "PYTHON": release.python,
    }
    return (
        Step("prepare", f"folders below {target.folder}, user ahdc", script("prepare", target)),
        Step(
            "copy",
            "wheels, arena file, certificates, unit and rules",
            copies=(
                Copy(release.wheels, f"{base}/wheels", delete=True),
                Copy(release.files, f"{base}/releases/{release.name}", delete=False),
            ),
            timeout_s=600.0,
        ),
        Step(
            "install", f"environment {release.environment}, offline", script("install", target, values), timeout_s=600.0
        ),
        Step("check", "the release reads its files", script("check", target, values)),
        Step("switch", f"make {release.name} the robot's, restart it", script("switch", target, values), switched=True),
        waiting(target, release.name, wanted),
        Step("prune", "drop releases older than the last two", script("prune", target)),
    )


def waiting(target: Target, release: str, wanted: Wanted) -> Step:
    """Look at the service until it is well."""
    values = {"RELEASE": release, "TURNS": READY_TURNS, "PAUSE": PAUSE_S, "WANTED": wanted, "STEADY": STEADY}
    words = "until it is ready and says this release" if wanted == "ready" else "until it looks for the router"
    timeout_s = READY_TURNS * (PAUSE_S + 1.0)
    return Step("wait", words, script("wait", target, values), timeout_s=timeout_s, switched=True)


def rollback(target: Target, release: str, wanted: Wanted) -> tuple[Step, ...]:
    """Back to a release that is on the computer; to none at all where ``release`` is empty."""
    if not release:
        return (Step("withdraw", "there is no earlier release: run nothing", script("withdraw", target)),)
    switch = Step("switch back", f"make {release} the robot's again", script("switch", target, {"RELEASE": release}))
    return (switch, waiting(target, release, wanted)._replace(switched=False))


def removal(target: Target) -> tuple[Step, ...]:
    """Everything away."""
    return (Step("remove", f"the service, its rules and {target.folder}", script("remove", target)),)


def fault_of(step: Step, code: int, output: str, release: Release | None = None) -> str:
    """Why a step has not done what it should; empty: it has."""
    lines = [line for line in output.strip().splitlines() if line.strip()]
    if code:
        return f"{step.name}: {' | '.join(lines[-3:]) or f'exit code {code}'}"
    said = dict(line.split("=", 1) for line in lines if "=" in line)
    if step.name == "wait" and int(said.get("Steady", "0") or 0) < STEADY:
        words = [line.partition("=")[2] for line in lines if line.startswith("Journal=")]
        state = f"{said.get('ActiveState', '?')}/{said.get('SubState', '?')}, {said.get('Result', '?')}"
        status = said.get("StatusText", "")
        return f"not ready ({state}{', ' + status if status else ''}); {' | '.join(words[-3:])}".rstrip("; ")
    if step.name == "check" and release is not None and said.get("arena") != release.arena_hash:
        return f"check: arena file reads as {said.get('arena')!r} there, as {release.arena_hash!r} here"
    return ""
