"""Mutants of one module, each run against its tests in a forked process; nothing is ever written to the source.

    python -m tests.prove.mutants drivers.gate tests/drivers/test_gate.py

A mutant is one change: a comparison or an operator exchanged, a condition always or never true, an operand, a
statement, a decorator or a ``not`` left out, a number moved, a truth value or a word changed. Annotations,
docstrings, prose (text with a space) and declarations of types are left alone. It is killed when a test fails, or
nothing ends in time. Exit code 0 where only the mutants named by ``--equivalent`` survive.
"""

import argparse
import ast
import copy
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
TIMEOUT_S = 120
COMPARES: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt, ast.NotEq),
    ast.LtE: (ast.Lt, ast.GtE, ast.Eq),
    ast.Gt: (ast.GtE, ast.Lt, ast.NotEq),
    ast.GtE: (ast.Gt, ast.LtE, ast.Eq),
    ast.Eq: (ast.NotEq, ast.LtE, ast.GtE),
    ast.NotEq: (ast.Eq, ast.Lt, ast.Gt),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATORS: dict[type[ast.operator], tuple[type[ast.operator], ...]] = {
    ast.Add: (ast.Sub, ast.Mult),
    ast.Sub: (ast.Add, ast.Mult),
    ast.Mult: (ast.Div, ast.Add),
    ast.Div: (ast.Mult, ast.Sub),
}
QUICK = [
    "-x",
    "-q",
    "--no-header",
    "--tb=no",
    "--assert=plain",
    "-p",
    "no:cacheprovider",
    "-p",
    "no:xdist",
    "-p",
    "no:ahdc",
]
TYPES = ("Literal", "TypeVar")


class Mutant:
    """One changed tree, named by its line and what was changed."""

    def __init__(self, tree: ast.Module, node: ast.AST, what: str) -> None:
        self.tree = ast.fix_missing_locations(copy.deepcopy(tree))
        self.line = getattr(node, "lineno", 0)
        self.what = what

    def name(self, source: str) -> str:
        """The line it is in, and what became of it: the same wherever the line stands."""
        return f"{source.splitlines()[self.line - 1].strip()} => {self.what}"


def mutants(source: str) -> Iterator[Mutant]:
    """Every mutant of a module's text."""
    tree = ast.parse(source)
    for parent, field, index, node in list(_places(tree)):
        for what, changed in _changes(parent, node):
            _put(parent, field, index, changed)
            yield Mutant(tree, node, f"{_short(node)} -> {what}")
            _put(parent, field, index, node)
    for node in ast.walk(tree):
        yield from _inner(tree, node)


def _short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 70 else f"{text[:67]}..."


def _put(parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def _places(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, ast.AST]]:
    """Every node of the tree that may change, and where it hangs."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "type_comment", "bases"):
            continue
        for index, node in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if not isinstance(node, ast.AST) or _declares(node):
                continue
            yield tree, field, index, node
            yield from _places(node)


def _declares(node: ast.AST) -> bool:
    """Docstrings, imports, and what only a type checker reads."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return True
    if isinstance(node, ast.AnnAssign) and node.value is None:
        return True
    called = node.value if isinstance(node, ast.Assign) else None
    return isinstance(called, ast.Subscript) and isinstance(called.value, ast.Name) and called.value.id in TYPES


def _changes(parent: ast.AST, node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """What may stand in a node's place."""
    if isinstance(node, ast.Assign | ast.AugAssign | ast.Raise | ast.If | ast.For | ast.While | ast.Return) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield "nothing", ast.Pass()
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield ast.unparse(node.operand), node.operand
    if isinstance(node, ast.BoolOp):
        for operand in node.values:
            rest = [value for value in node.values if value is not operand]
            yield f"without {_short(operand)}", rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
    if isinstance(node, ast.Constant):
        yield from _constants(node)
    if isinstance(parent, ast.If | ast.IfExp | ast.While) and node is parent.test:
        for truth in (True, False):
            yield str(truth), ast.Constant(truth)
    if isinstance(parent, ast.comprehension) and node in parent.ifs:
        yield "True", ast.Constant(True)


def _constants(node: ast.Constant) -> Iterator[tuple[str, ast.AST]]:
    value = node.value
    if isinstance(value, bool):
        yield str(not value), ast.Constant(not value)
    elif isinstance(value, int | float):
        for other in (value + 1, value - 1):
            yield str(other), ast.Constant(other)
    elif isinstance(value, str) and value and " " not in value:
        yield repr(f"x{value}"), ast.Constant(f"x{value}")


def _inner(tree: ast.Module, node: ast.AST) -> Iterator[Mutant]:
    """Operators and decorators exchanged in place."""
    if isinstance(node, ast.Compare):
        for index, operator in enumerate(node.ops):
            for other in COMPARES[type(operator)]:
                node.ops[index] = other()
                yield Mutant(tree, node, _short(node))
                node.ops[index] = operator
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS and not _unions(node):
        operator_ = node.op
        for other_ in OPERATORS[type(operator_)]:
            node.op = other_()
            yield Mutant(tree, node, _short(node))
            node.op = operator_
    elif isinstance(node, ast.BoolOp):
        joined = node.op
        node.op = ast.Or() if isinstance(joined, ast.And) else ast.And()
        yield Mutant(tree, node, _short(node))
        node.op = joined
    elif isinstance(node, ast.FunctionDef) and node.decorator_list:
        decorators, node.decorator_list = node.decorator_list, []
        yield Mutant(tree, node, f"{node.name} without its decorator")
        node.decorator_list = decorators


def _unions(node: ast.BinOp) -> bool:
    return isinstance(node.op, ast.BitOr)


class Brief:
    """Hypothesis without shrinking: that a test fails is enough."""

    def pytest_collection(self) -> None:
        import hypothesis

        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        settings = hypothesis.settings(derandomize=True, database=None, deadline=None, max_examples=60, phases=phases)
        hypothesis.settings.register_profile("mutants", settings)
        hypothesis.settings.load_profile("mutants")


class Planted(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives out a mutant instead of the module."""

    def __init__(self, module: str, path: Path, tree: ast.Module) -> None:
        self._module, self._path, self._tree = module, path, tree

    def find_spec(self, name: str, path: object = None, target: object = None) -> importlib.machinery.ModuleSpec | None:
        return importlib.util.spec_from_loader(name, self, origin=str(self._path)) if name == self._module else None

    def exec_module(self, module: ModuleType) -> None:
        module.__file__ = str(self._path)
        exec(compile(self._tree, str(self._path), "exec"), module.__dict__)


def survives(module: str, path: Path, tree: ast.Module, tests: Sequence[str]) -> bool:
    """Whether every test passes with this tree for the module, in a process of its own."""
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        return status == 0
    code = 1
    try:
        signal.alarm(TIMEOUT_S)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        import pytest

        sys.meta_path.insert(0, Planted(module, path, tree))
        code = int(pytest.main([*QUICK, *tests], plugins=[Brief()]))
    finally:
        os._exit(code)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module", help="such as drivers.gate")
    parser.add_argument("tests", nargs="+", help="test files")
    parser.add_argument("--equivalent", type=Path, help="file with lines 'MODULE: MUTANT  # PROOF'")
    parser.add_argument("--lines", default="", metavar="A:B", help="only mutants of these lines")
    args = parser.parse_args(arguments)
    path = ROOT / Path(*args.module.split(".")).with_suffix(".py")
    source = path.read_text()
    known = equivalents(args.equivalent, args.module) if args.equivalent else Counter()
    for once in ("hypothesis", "hypothesis.strategies", "pytest", "contract.arena", "contract.messages"):
        importlib.import_module(once)

    if not survives(args.module, path, ast.parse(source), args.tests):
        print(f"{args.module}: its tests fail without any mutant", file=sys.stderr)
        return 2
    first, _, last = args.lines.partition(":")
    total, equal, alive = 0, 0, 0
    for mutant in mutants(source):
        if args.lines and not int(first) <= mutant.line <= int(last):
            continue
        total += 1
        if survives(args.module, path, mutant.tree, args.tests):
            name = mutant.name(source)
            if known[name]:
                known[name] -= 1
                equal += 1
            else:
                alive += 1
                print(f"{args.module}: {name}", flush=True)
    unused = [] if args.lines else sorted(known.elements())
    for name in unused:
        print(f"named as equivalent, but killed or gone: {name}")
    print(f"{args.module}: {total - alive - equal} of {total} killed, {equal} equivalent, {alive} alive")
    return 1 if alive or unused else 0


def equivalents(path: Path, module: str) -> Counter[str]:
    """Mutants that may survive, each as often as it stands there, from lines ``MODULE: MUTANT  # PROOF``.

    :raises ValueError: a line has no proof.
    """
    found: Counter[str] = Counter()
    for line in path.read_text().splitlines():
        name, _, rest = line.partition(": ")
        what, _, proof = rest.partition("  # ")
        if not line.strip() or name != module:
            continue
        if not proof.strip():
            raise ValueError(f"{path.name}: '{what}' has no proof")
        found[what.strip()] += 1
    return found


if __name__ == "__main__":
    sys.exit(main())
