"""Scripted faults of the emulated server: what goes wrong, when, for how long, to which body. Pure."""

from typing import NamedTuple

KINDS: dict[str, str] = {
    "occlusion": "BODY is flagged as not tracked and keeps its last pose",
    "absent": "BODY is left out of the frames",
    "swap": "BODY and OTHER change places",
    "jump": "BODY appears VALUE metres along x from where it is",
    "turn": "BODY appears turned by VALUE radians",
    "frozen": "BODY keeps its pose bit for bit",
    "not_finite": "BODY's x is not a number",
    "denormal": "BODY's quaternion has norm VALUE",
    "tilt": "BODY leans by VALUE radians",
    "marker_error": "BODY's mean marker error is VALUE metres",
    "id_change": "BODY gets another id, and the model list changes with it",
    "wrong_models": "the model list lacks BODY",
    "duplicate_name": "the model list gives BODY's name to a second body, too",
    "drop": "frames are lost with probability VALUE (default: all)",
    "late": "frames are sent VALUE seconds late, with the stamps of their exposure",
    "reorder": "every other frame is sent after its successor",
    "duplicate": "every frame is sent twice",
    "burst": "frames are held back and sent at once at the end",
    "truncated": "datagrams are cut to VALUE of their length (default: half)",
    "restart": "the server is gone, then starts anew: frame numbers, time, clients, clock",
    "silence": "no frames, commands are answered",
    "deaf": "frames, but commands are not answered",
    "no_echo": "the clock's echoes are not answered",
    "rate_change": "frames come at VALUE Hz",
    "millimetres": "positions are in millimetres",
    "clock_drift": "the server's clock gains VALUE parts per million",
    "edit_mode": "frames carry the edit-mode flag",
}
"""Every kind of fault, in the words of ``emulate --help``."""

_BODY_KINDS = """occlusion absent swap jump turn frozen not_finite denormal tilt marker_error id_change wrong_models
duplicate_name"""
_VALUE_KINDS = "jump turn denormal tilt marker_error late rate_change clock_drift"
_NEEDS_BODY = frozenset(_BODY_KINDS.split())
_NEEDS_VALUE = frozenset(_VALUE_KINDS.split())


class ScriptError(ValueError):
    """A line of a script that is not usable; the text names line, word and what is allowed."""


class Fault(NamedTuple):
    """One fault, from ``start_s`` after the first frame for ``duration_s``."""

    kind: str
    start_s: float
    duration_s: float
    body: str = ""
    other: str = ""
    value: float | None = None

    def active(self, elapsed_s: float) -> bool:
        """Whether it is on."""
        return self.start_s <= elapsed_s < self.start_s + self.duration_s

    def number(self, default: float) -> float:
        """Its value, or the default."""
        return default if self.value is None else self.value


class Script(NamedTuple):
    """Faults in no particular order; several may be on at once."""

    faults: tuple[Fault, ...] = ()

    def active(self, kind: str, elapsed_s: float, body: str = "") -> Fault | None:
        """The first such fault that is on, for that body where the kind has one."""
        for fault in self.faults:
            if fault.kind == kind and fault.active(elapsed_s) and fault.body == body:
                return fault
        return None


NO_FAULTS = Script()


def parse(text: str) -> Script:
    """A script: one fault a line, ``START DURATION KIND [BODY [OTHER]] [VALUE]``, ``#`` for comments.

    ``2.0 0.5 occlusion r06`` hides r06 from second 2 to 2.5; ``5 1 swap r06 r08``; ``8 2 late 0.05``.

    :raises ScriptError: naming the first line that is not of this form.
    """
    faults = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if words:
            faults.append(_fault(words, f"line {number}"))
    return Script(tuple(faults))


def _fault(words: list[str], where: str) -> Fault:
    if len(words) < 3:
        raise ScriptError(f"{where}: START DURATION KIND needed, {' '.join(words)!r} given")
    start_s, duration_s = (_number(word, where) for word in words[:2])
    kind, rest = words[2], words[3:]
    if kind not in KINDS:
        raise ScriptError(f"{where}: {kind!r} is no fault; known: {', '.join(KINDS)}")
    if start_s < 0.0 or duration_s < 0.0:
        raise ScriptError(f"{where}: times must not be negative")
    names = 2 if kind == "swap" else 1 if kind in _NEEDS_BODY else 0
    if len(rest) < names:
        raise ScriptError(f"{where}: {kind} needs {names} body name(s)")
    body, other = [*rest[:names], "", ""][:2]
    values = rest[names:]
    if len(values) > 1 or (kind in _NEEDS_VALUE and not values):
        raise ScriptError(f"{where}: {kind} takes {'a value' if kind in _NEEDS_VALUE else 'at most one value'}")
    return Fault(kind, start_s, duration_s, body, other, _number(values[0], where) if values else None)


def _number(word: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise ScriptError(f"{where}: {word!r} is not a number") from None
    if not abs(value) < 1e9:
        raise ScriptError(f"{where}: {word} is not a usable number")
    return value
