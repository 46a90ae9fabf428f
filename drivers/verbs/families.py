"""``ahdc-drivers list``: families and their options, from the options' own descriptions."""

import argparse
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgspec

from contract.tables import describe, nearest, show
from drivers.registry import Family, families, family_of, module_of


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("kind", nargs="?", help="one family only")


def run(args: argparse.Namespace) -> int:
    chosen = families()
    if args.kind is not None:
        family = family_of(args.kind)
        if family is None:
            known = [entry.kind for entry in chosen]
            print(f'no family "{args.kind}": {nearest(args.kind, known) or "there are " + ", ".join(known)}')
            return 2
        chosen = (family,)
    print("\n\n".join(text_of(family) for family in chosen))
    return 0


def text_of(family: Family) -> str:
    """A family as a paragraph: one option a line, required ones first."""
    kind = module_of(family).Options
    hints = get_type_hints(kind, include_extras=True)
    fields = sorted(msgspec.structs.fields(kind), key=lambda field: not field.required)
    lines = [f'wheels = {{ kind = "{family.kind}", ... }}   # {family.summary}']
    for field in fields:
        if field.name == "kind":
            continue
        value = "required" if field.required or field.default is None else f"default {show(field.default)}"
        lines.append(f"  {field.name}: {_plain(hints[field.name])}; {value}")
        about = _description(hints[field.name])
        if about:
            lines.append(f"      {about}")
    return "\n".join(lines)


def _parts(hint: Any) -> tuple[Any, ...]:
    return (hint, *get_args(hint))


def _description(hint: Any) -> str:
    for part in _parts(hint):
        for meta in get_args(part)[1:] if get_origin(part) is Annotated else ():
            if isinstance(meta, msgspec.Meta) and meta.description:
                return meta.description
    return ""


def _plain(hint: Any) -> str:
    return describe(hint).removesuffix(" or nothing")
