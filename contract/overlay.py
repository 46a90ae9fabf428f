"""Calibration laid over an arena file: one small TOML file a robot, in the folder ``<arena>.calibration``.

``lab6.toml`` and ``lab6.calibration/r06.toml``. A table of the overlay replaces the arena's values key
by key; intervals of ``[control.field]`` become the widest over all robots, since one brake model serves all.
"""

import copy
import json
import os
import tomllib
from pathlib import Path
from typing import Any


def folder_of(arena: Path) -> Path:
    """Where the overlays of an arena file lie."""
    return arena.with_suffix(".calibration")


def read(arena: Path) -> list[dict[str, Any]]:
    """Every overlay of an arena file, by robot.

    :raises OSError: unreadable.
    :raises tomllib.TOMLDecodeError: not TOML.
    """
    folder = folder_of(arena)
    return [tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.toml"))]


def overlaid(table: dict[str, Any], overlays: list[dict[str, Any]]) -> dict[str, Any]:
    """The arena's table with all overlays on it; the arguments stay as they are."""
    if not overlays:
        return table
    whole = copy.deepcopy(table)
    measured: dict[str, list[list[float]]] = {}
    for overlay in overlays:
        rest = copy.deepcopy(overlay)
        field = rest.get("control", {}).pop("field", {})
        for key, value in field.items():
            measured.setdefault(key, []).append(value)
        _merge(whole, rest)
    if measured and whole.get("control", {}).get("profile", "field") != "paper":
        target = whole.setdefault("control", {}).setdefault("field", {})
        for key, found in measured.items():
            target[key] = [min(low for low, _ in found), max(high for _, high in found)]
    return whole


def _merge(target: dict[str, Any], source: dict[str, Any]) -> None:
    for key, value in source.items():
        if isinstance(value, dict) and isinstance(target.get(key), dict):
            _merge(target[key], value)
        elif value != {}:
            target[key] = value


def save(path: Path, table: dict[str, Any]) -> None:
    """Lay ``table`` over what the overlay says already; the file is replaced at once or not at all.

    :raises OSError: not writable.
    """
    whole = tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    _merge(whole, table)
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".draft")
    draft.write_text(text_of(whole), encoding="utf-8")
    os.replace(draft, path)


def text_of(table: dict[str, Any], path: tuple[str, ...] = ()) -> str:
    """A table of tables, numbers, words, truth values and lists of them as TOML."""
    lines = [f"{key} = {_value(value)}" for key, value in table.items() if not isinstance(value, dict)]
    head = f"[{'.'.join(path)}]\n" if path and lines else ""
    body = head + "".join(f"{line}\n" for line in lines)
    return body + "".join(text_of(value, (*path, key)) for key, value in table.items() if isinstance(value, dict))


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value)
