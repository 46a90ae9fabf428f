"""Writes the reference part of docs/arena-file.md from contract/arena.py: ``python -m tests.house.arena_page``."""

import ast
import typing

import msgspec
from msgspec import Meta

from contract import arena
from tests.house.checkout import ROOT

PAGE = ROOT / "docs" / "arena-file.md"
MARK = "<!-- generated from contract/arena.py by python -m tests.house.arena_page; edit above this line -->"
SECTIONS: dict[str, type[msgspec.Struct]] = {
    "arena": arena.Floor,
    "link": arena.Link,
    "mocap": arena.Mocap,
    "control": arena.Control,
    "control.field": arena.FieldControl,
    "control.paper": arena.PaperControl,
    "platform": arena.Platform,
    "safety": arena.Safety,
    "targets": arena.Targets,
    "robots.ID": arena.Robot,
    "deploy": arena.Deploy,
}


def remarks() -> dict[str, dict[str, str]]:
    """Struct name to field name to the string that follows the field in the source."""
    found: dict[str, dict[str, str]] = {}
    tree = ast.parse((ROOT / "contract" / "arena.py").read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            texts = found.setdefault(node.name, {})
            for field, after in zip(node.body, [*node.body[1:], None], strict=True):
                if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
                    continue
                if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                    texts[field.target.id] = " ".join(str(after.value.value).replace("``", "`").split())
    return found


def kind(annotation: object) -> str:
    """What a field takes, in a reader's words: type and range, or the choices."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        metas = [argument for argument in arguments[1:] if isinstance(argument, Meta)]
        signs = (("gt", "> "), ("ge", ">= "), ("lt", "< "), ("le", "<= "))
        bounds = [f"{s}{getattr(m, k):.10g}" for m in metas for k, s in signs if getattr(m, k) is not None]
        return " ".join([kind(arguments[0]), ", ".join(bounds)]).strip()
    if origin is typing.Literal:
        return " or ".join(f'`"{choice}"`' if isinstance(choice, str) else f"`{choice}`" for choice in arguments)
    if origin is tuple:
        count = "list of" if arguments[-1] is Ellipsis else f"{len(arguments)} x"
        return f"{count} {kind(arguments[0])}"
    if origin is dict:
        return "table"
    if origin is not None or annotation is type(None):
        return " or ".join(kind(argument) for argument in arguments if argument is not type(None))
    words: dict[object, str] = {float: "number", int: "integer", str: "text", bool: "true or false"}
    return words[annotation]


def default(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return "**needed**"
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    if value is None:
        return "unset"
    return f"`{msgspec.json.encode(value).decode()}`"


def reference() -> str:
    texts = remarks()
    parts = []
    for name, struct in SECTIONS.items():
        hints = typing.get_type_hints(struct, include_extras=True)
        parts += [f"## [{name}]", "", "| Key | Takes | Default | |", "|---|---|---|---|"]
        for field in msgspec.structs.fields(struct):
            if f"{name}.{field.name}" in SECTIONS:
                continue
            told = texts[struct.__name__].get(field.name, "")
            parts.append(f"| `{field.name}` | {kind(hints[field.name])} | {default(field)} | {told} |")
        parts.append("")
    return "\n".join(parts)


def page() -> str:
    """The page as it should be: what stands above the mark, then the reference."""
    return PAGE.read_text().partition(MARK)[0] + MARK + "\n\n" + reference()


if __name__ == "__main__":
    PAGE.write_text(page())
