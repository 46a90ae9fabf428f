"""TOML tables to Structs, reporting *every* fault, each with its path, value and allowed range."""

import difflib
import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec


class Fault(msgspec.Struct, frozen=True):
    """One thing wrong in a file."""

    path: str
    """Dotted path of the key, such as ``robots.r06.start``."""
    value: str
    """The value as written, empty where the key is missing."""
    allowed: str
    hint: str = ""

    def __str__(self) -> str:
        value = f" = {self.value}" if self.value else ""
        hint = f" ({self.hint})" if self.hint else ""
        return f"{self.path}{value}: {self.allowed}{hint}"


MISSING = object()


def nearest(word: str, known: list[str]) -> str:
    """``did you mean "x"?`` for the closest known word, or nothing."""
    close = difflib.get_close_matches(word, known, 1, 0.6)
    return f'did you mean "{close[0]}"?' if close else ""


def read_table(kind: type[Any], table: object, path: str, faults: list[Fault]) -> Any:
    """``table`` as a ``kind`` (a Struct), after appending all that is wrong to ``faults``.

    A faulty value stands at its default, so that the rest can be checked; None where a required one is faulty.
    """
    if not isinstance(table, dict):
        faults.append(Fault(path, show(table), "a table is needed here"))
        return None
    fields = {field.name: field for field in msgspec.structs.fields(kind)}
    hints = get_type_hints(kind, include_extras=True)
    for key in table:
        if key not in fields:
            known = sorted(fields)
            hint = nearest(str(key), known) or f"known keys: {', '.join(known)}"
            faults.append(Fault(join(path, str(key)), show(table[key]), "unknown key", hint))
    values = {}
    for name, field in fields.items():
        if name in table:
            value = read_value(hints[name], table[name], join(path, name), faults)
            if value is not None:
                values[name] = value
        elif field.required:
            faults.append(Fault(join(path, name), "", f"missing; needs {describe(hints[name])}"))
    complete = all(name in values for name, field in fields.items() if field.required)
    return kind(**values) if complete else None


def read_value(hint: Any, value: object, path: str, faults: list[Fault]) -> Any:
    """One value of the hinted type; Structs and dictionaries of Structs are walked key by key."""
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
        return read_table(bare, value, path, faults)
    if get_origin(bare) is dict and is_struct(get_args(bare)[1]):
        if not isinstance(value, dict):
            faults.append(Fault(path, show(value), "a table of tables is needed here"))
            return None
        name_hint, item = get_args(bare)
        for key in value:
            try:
                msgspec.convert(key, name_hint)
            except msgspec.ValidationError:
                faults.append(Fault(join(path, str(key)), "", f"bad name; needs {describe(name_hint)}"))
        entries = {key: read_table(item, entry, join(path, str(key)), faults) for key, entry in value.items()}
        return {key: entry for key, entry in entries.items() if entry is not None}
    try:
        return msgspec.convert(value, hint, strict=True)
    except msgspec.ValidationError as error:
        where = str(error).partition(" - at `$")[2].rstrip("`")
        choices = get_args(bare) if get_origin(bare) is Literal else ()
        hint_text = nearest(value, [str(c) for c in choices]) if isinstance(value, str) else ""
        faults.append(Fault(path + where, show(value), f"needs {describe(hint)}", hint_text))
        return None


def is_struct(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, msgspec.Struct)


def describe(hint: Any) -> str:
    """The allowed values of a type in words: ``a number from 0.1 to 2``."""
    if get_origin(hint) is Annotated:
        base, *metas = get_args(hint)
        meta = next((entry for entry in metas if isinstance(entry, msgspec.Meta)), None)
        text = describe(base)
        if meta is None:
            return text
        low = meta.ge if meta.ge is not None else meta.gt
        high = meta.le if meta.le is not None else meta.lt
        if low is not None and high is not None:
            text += f" from {low} to {high}" if meta.gt is None else f" above {low} and up to {high}"
        elif low is not None:
            text += f" of at least {low}" if meta.gt is None else f" above {low}"
        elif high is not None:
            text += f" of at most {high}"
        if meta.pattern is not None:
            text += f" matching {meta.pattern}"
        if meta.min_length is not None:
            text += f", at least {meta.min_length} long"
        if meta.max_length is not None:
            text += f", at most {meta.max_length} long"
        return text
    origin = get_origin(hint)
    if origin is Literal:
        return "one of " + ", ".join(f'"{choice}"' for choice in get_args(hint))
    if origin in (Union, types.UnionType):
        return " or ".join(describe(part) for part in get_args(hint))
    if origin is tuple:
        parts = get_args(hint)
        if len(parts) == 2 and parts[1] is Ellipsis:
            return f"a list, each item {describe(parts[0])}"
        return f"a list of {len(parts)}, each {describe(parts[0])}"
    if is_struct(hint):
        return "a table"
    names = {float: "a number", int: "a whole number", str: "a text", bool: "true or false", type(None): "nothing"}
    return names.get(hint, "a table" if origin is dict else str(hint))


def join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def show(value: object) -> str:
    """A value as a TOML writer would, cut to 60 characters."""
    text = f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."
