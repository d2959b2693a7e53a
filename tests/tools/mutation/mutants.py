"""Single changes to a source file: operators, comparisons, constants, signs, conditions."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

_OPERATORS: dict[type[ast.operator], tuple[type[ast.operator], ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.BitAnd: (ast.BitOr,),
    ast.BitOr: (ast.BitAnd,),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
_OPPOSITES = {
    "minimum": "maximum",
    "maximum": "minimum",
    "min": "max",
    "max": "min",
    "any": "all",
    "all": "any",
    "floor": "ceil",
    "ceil": "floor",
}
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


@dataclass(frozen=True)
class Mutant:
    """One change to one file.

    Attributes:
        path: of the file, in the repository.
        node, choice: which node in the order of `ast.walk`, and which of its replacements.
        line: where.
        lines: first and last line of the statement, or of its head where others stand in it.
        in_function: whether a call runs it, and not the import of the file.
        function: in which it stands.
        change: what, in words.
    """

    path: str
    node: int
    choice: int
    line: int
    lines: tuple[int, int]
    in_function: bool
    function: str
    change: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.change}"

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is, wherever in the file: file, function and change."""
        return self.path, self.function, self.change

    @property
    def identity(self) -> tuple[str, int, int]:
        """Which mutant of an unchanged file it is."""
        return self.path, self.node, self.choice


class _Place(NamedTuple):
    lines: tuple[int, int]
    in_function: bool
    function: str


def mutants_of(path: str, source: str) -> Iterator[Mutant]:
    """Yield every mutant of a file."""
    tree = ast.parse(source)
    places = dict(_places(tree, _Place((0, 0), in_function=False, function="")))
    for number, node in enumerate(ast.walk(tree)):
        place = places.get(id(node))
        if place is None:
            continue
        line = getattr(node, "lineno", 0)
        for choice, (_, change) in enumerate(_replacements(node)):
            yield Mutant(path, number, choice, line, *place, change)


def mutated(source: str, mutant: Mutant) -> ast.Module:
    """Return the syntax tree of a file with the change of a mutant."""
    tree = ast.parse(source)
    node = list(ast.walk(tree))[mutant.node]
    replacement, _ = list(_replacements(node))[mutant.choice]
    ast.copy_location(replacement, node)
    changed = _Replace(node, replacement).visit(tree)
    assert isinstance(changed, ast.Module)
    return ast.fix_missing_locations(changed)


class _Replace(ast.NodeTransformer):
    """Replaces one node, by identity."""

    def __init__(self, target: ast.AST, replacement: ast.AST) -> None:
        self._target, self._replacement = target, replacement

    def visit(self, node: ast.AST) -> ast.AST:
        """Replace the node, or look for it below."""
        return self._replacement if node is self._target else super().visit(node)


def _places(node: ast.AST, place: _Place) -> Iterator[tuple[int, _Place]]:
    """Yield where each node stands; decorators, annotations and assertions are left out."""
    if isinstance(node, ast.Assert):
        return
    if isinstance(node, ast.stmt):
        place = place._replace(lines=_lines_of(node))
    yield id(node), place
    inner = place
    if isinstance(node, (*_FUNCTIONS, ast.ClassDef)):
        name = getattr(node, "name", "<lambda>")
        within = f"{place.function}.{name}".lstrip(".")
        inner = place._replace(function=within)
    for field, value in ast.iter_fields(node):
        if field in ("decorator_list", "annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                run = isinstance(node, _FUNCTIONS) and field == "body"
                yield from _places(child, inner._replace(in_function=inner.in_function or run))


def _lines_of(statement: ast.stmt) -> tuple[int, int]:
    body = getattr(statement, "body", None)
    last = statement.end_lineno or statement.lineno
    if body and body[0].lineno > statement.lineno:
        last = body[0].lineno - 1
    return statement.lineno, last


def _replacements(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Yield replacements of a node, each with its description."""
    match node:
        case ast.BinOp(left=left, op=operator, right=right):
            for other in _OPERATORS.get(type(operator), ()):
                yield ast.BinOp(left, other(), right), f"{_text(node)}: {other.__name__}"
                yield left, f"{_text(node)}: only the left"
                yield right, f"{_text(node)}: only the right"
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert(), operand=operand):
            yield operand, f"{_text(node)}: without its sign"
        case ast.Compare() | ast.BoolOp():
            yield from _other_conditions(node)
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value), f"{value}: negated"
        case ast.Constant(value=float() as value):
            yield ast.Constant(value + 1.0), f"{value}: one more"
        case ast.Call():
            yield from _other_calls(node)
        case ast.If(test=ast.Name() | ast.Attribute() | ast.Call() as test):
            negated = ast.UnaryOp(ast.Not(), test)
            yield ast.If(negated, node.body, node.orelse), f"if {_text(test)}: negated"
        case ast.IfExp(test=ast.Name() | ast.Attribute() | ast.Call() as test):
            yield ast.IfExp(test, node.orelse, node.body), f"{_text(node)}: the other way round"


def _other_conditions(node: ast.Compare | ast.BoolOp) -> Iterator[tuple[ast.AST, str]]:
    match node:
        case ast.Compare(left=left, ops=[operator], comparators=[right]):
            for other in _COMPARISONS.get(type(operator), ()):
                yield ast.Compare(left, [other()], [right]), f"{_text(node)}: {other.__name__}"
        case ast.BoolOp(op=ast.And(), values=values):
            yield ast.BoolOp(ast.Or(), values), f"{_text(node)}: or"
        case ast.BoolOp(op=ast.Or(), values=values):
            yield ast.BoolOp(ast.And(), values), f"{_text(node)}: and"


def _other_calls(node: ast.Call) -> Iterator[tuple[ast.AST, str]]:
    """Yield one argument alone, or the opposite function of the same module."""
    called = node.func
    name = called.attr if isinstance(called, ast.Attribute) else _text(called)
    # Of a library or an Arithmetic both arguments stand for themselves; `min(values)` has one.
    choices = {"where": node.args[1:], "sqrt": node.args, "tan": node.args}
    if name in ("minimum", "maximum"):
        choices[name] = node.args[:2]
    for argument in choices.get(name, ()):
        yield argument, f"{_text(node)}: only {_text(argument)}"
    if name in _OPPOSITES and not (isinstance(called, ast.Name) and node.keywords):
        yield _opposite(node, name), f"{_text(node)}: opposite"


def _opposite(node: ast.Call, name: str) -> ast.Call:
    other = _OPPOSITES[name]
    called = node.func
    function: ast.expr = ast.Name(other, ast.Load())
    if isinstance(called, ast.Attribute):
        function = ast.Attribute(called.value, other, ast.Load())
    return ast.Call(function, node.args, node.keywords)


def _text(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())
